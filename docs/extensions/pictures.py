"""Draws the site's pictures from runs made while it is built, for light and for dark pages.

Each is written as generated/pictures/NAME-light.svg and NAME-dark.svg; the directive ``picture``
shows the one that fits the page, with its content as what the picture says to those who do not
see it.
"""

import dataclasses as dc
import itertools
import tempfile
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from docutils import nodes
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from mirte_drake.identification.synthetic_recording import synthetic_recording
from mirte_drake.model.model_file import load_model, load_model_file
from mirte_drake.replay import write_replay
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import save_run
from mirte_drake.scenario_file import load_scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "mathtext.fontset": "stix",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "mirte_drake",
    "savefig.transparent": True,
}
COLORED = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")


@dc.dataclass(frozen=True)
class Theme:
    """Colours of a picture."""

    name: str
    ink: str
    faint: str
    tube: str
    plan: str
    actual: str


THEMES = (
    Theme(
        "light", ink="#1c2430", faint="#7a828e", tube="#2166ac", plan="#2166ac", actual="#c62f2f"
    ),
    Theme("dark", ink="#dfe3ea", faint="#8e97a5", tube="#6fb1f2", plan="#6fb1f2", actual="#ff7b72"),
)


def boxes(axes: Axes, centers: np.ndarray, half: np.ndarray, color: str, alpha: float) -> None:
    """Adds boxes (M, 2) with half-widths (M, 2)."""
    patches = [
        Rectangle(tuple(c - h), 2 * h[0], 2 * h[1]) for c, h in zip(centers, half, strict=True)
    ]
    axes.add_collection(PatchCollection(patches, facecolor=color, edgecolor="none", alpha=alpha))
    outline = PatchCollection(patches, facecolor="none", edgecolor=color, lw=0.7, alpha=0.7)
    axes.add_collection(outline)


def path_picture(run: Run, theme: Theme) -> Figure:
    """Draws the whole path with its tube."""
    log = run.log
    width, height = np.ptp(log["reference"][:, :2], axis=0)
    figure = Figure(figsize=(7.4, 1.6 + 4.5 * min(height / width, 1.0)), layout="compressed")
    axes = figure.subplots()
    every = slice(None, None, 4)
    boxes(axes, log["nominal_pose"][every, :2], log["half_width"][every, :2], theme.tube, 0.10)
    axes.plot(
        *log["reference"][:, :2].T, color=theme.ink, lw=1.2, ls=(0, (5, 3)), label="reference"
    )
    axes.plot(*log["nominal_pose"][:, :2].T, color=theme.plan, lw=1.3, label="nominal")
    axes.plot(*log["pose"][:, :2].T, color=theme.actual, lw=1.5, label="robot")
    axes.plot(*log["pose"][0, :2], "o", color=theme.ink, ms=5, label="start")
    handle = Rectangle((np.nan, np.nan), 0, 0, fc=theme.tube, alpha=0.35, label="tube")
    axes.add_patch(handle)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    figure.legend(loc="outside upper center", ncols=5, frameon=False)
    return figure


def tube_picture(run: Run, theme: Theme) -> Figure:
    """Draws one moment of a run: what was, what is planned, and where the robot may be."""
    log, now, every = run.log, 34, 3
    model = load_model(run.scenario.prediction_model)
    plan = model.roll_out(log["nominal_pose"][now], log["nominal_plan"][now], run.scenario.period)
    half = log["half_width"][now, :2]
    figure = Figure(figsize=(7.4, 4.2), layout="constrained")
    axes = figure.subplots()
    past = slice(now % every, now, every)
    boxes(axes, log["nominal_pose"][past, :2], log["half_width"][past, :2], theme.faint, 0.10)
    boxes(axes, plan[::2, :2], np.tile(half, (len(plan[::2]), 1)), theme.tube, 0.15)
    axes.plot(*log["reference"][:, :2].T, color=theme.ink, lw=1.3, ls=(0, (5, 3)))
    axes.plot(*log["nominal_pose"][: now + 1, :2].T, color=theme.faint, lw=1.3)
    axes.plot(*plan[:, :2].T, "o-", color=theme.plan, lw=1.3, ms=3.5)
    axes.plot(*log["pose"][: now + 1, :2].T, color=theme.actual, lw=1.7)
    here, nominal = log["pose"][now, :2], plan[0, :2]
    axes.plot(*here, "o", color=theme.actual, ms=8)
    axes.plot(*nominal, "o", color=theme.plan, ms=6)

    def note(text: str, at: np.ndarray, offset: tuple[float, float], color: str) -> None:
        arrow = {"arrowstyle": "-", "color": color, "lw": 0.8, "shrinkB": 4}
        axes.annotate(text, at, xytext=at + offset, color=color, ha="center", arrowprops=arrow)

    note("reference", log["reference"][14, :2], (0.03, -0.10), theme.ink)
    note("measured pose $x_k$", here, (0.10, -0.12), theme.actual)
    note("nominal pose $\\hat{x}_k$: its box\nholds the measured one", nominal, (-0.19, 0.07),
         theme.plan)  # fmt: skip
    note("plan, ten samples ahead", plan[7, :2], (0.13, -0.09), theme.plan)
    note(
        "tube: where a bounded disturbance\ncan take the robot around the plan",
        plan[8, :2] + [-half[0], half[1]],
        (-0.15, 0.07),
        theme.tube,
    )
    axes.set(xlim=(-0.02, 0.93), ylim=(-0.13, 0.35), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    return figure


def sindyc_picture(_: Run, theme: Theme) -> Figure:
    """Draws a recording, the library of candidate terms over it, and the coefficients found."""
    recording = synthetic_recording(seed=0)
    u, yaw = recording.wheel_command, recording.pose[:, 2]
    inputs = [f"u{i + 1}" for i in range(4)]
    pairs = list(itertools.combinations_with_replacement(range(4), 2))
    names = [*inputs, *(f"{inputs[i]}*{inputs[j]}" for i, j in pairs)]
    names += [f"{f}(theta)*{name}" for f in ("sin", "cos") for name in inputs]
    products = np.array([u[:, i] * u[:, j] for i, j in pairs]).T
    library = np.hstack([u, products, np.sin(yaw)[:, None] * u, np.cos(yaw)[:, None] * u])
    library = library / np.abs(library).max(axis=0)
    tables = load_model_file("extended_kinematic").derivatives
    found = np.array(
        [[tables[state].get(name, 0.0) for state in ("x", "y", "theta")] for name in names]
    )
    shown = np.sign(found) * np.sqrt(np.abs(found) / np.abs(found).max(axis=0))

    figure = Figure(figsize=(7.4, 4.0), layout="constrained")
    left, middle, right = figure.subfigures(1, 3, width_ratios=(1.25, 1.5, 0.75))
    panels = left.subplots(2, 1, sharex=True)
    window = slice(0, 160)
    panels[0].plot(recording.time[window], u[window], lw=1.0)
    lines = panels[1].plot(recording.time[window], recording.body_velocity[window], lw=1.0)
    panels[1].legend(lines, ("$v_x$", "$v_y$", "$\\Omega$"), frameon=False, fontsize=8, ncols=3,
                     borderaxespad=0.1, handlelength=1.2)  # fmt: skip
    panels[0].set(ylabel="wheels [%]", title="1  record")
    panels[1].set(ylabel="velocity", xlabel="time [s]")
    axes = middle.subplots()
    image = {"cmap": "RdBu_r", "vmin": -1, "vmax": 1, "aspect": "auto", "interpolation": "none"}
    axes.imshow(library[:400:2], **image)
    axes.set(title="2  library $\\Theta(x, u)$", ylabel="samples", yticks=[], xlabel="terms")
    axes.set_xticks(range(len(names)), [_symbol(name) for name in names], rotation=90, fontsize=7.5)
    axes = right.subplots()
    axes.imshow(np.where(found == 0, np.nan, shown), **image)
    axes.set_title("3  sparse $\\Xi$")
    axes.set_xticks(range(3), ["$\\dot{x}$", "$\\dot{y}$", "$\\dot{\\theta}$"])
    axes.set_yticks(range(len(names)), [_symbol(name) for name in names], fontsize=7.5)
    axes.set_xticks(np.arange(0.5, 2), minor=True)
    axes.grid(which="minor", color=theme.faint, lw=0.4)
    return figure


def _symbol(name: str) -> str:
    """Returns a term as mathematics."""
    text = name.replace("(theta)", "\\theta\\,").replace("*", "\\,")
    text = text.replace("sin", "\\sin").replace("cos", "\\cos")
    for i in "1234":
        text = text.replace(f"u{i}", f"u_{i}")
    return f"${text}$"


# Faster than the study, so that a plan of a second is long beside its tube.
FAST = (
    "reference=!WaypointPath {speed: 0.2, corners: smooth, "
    "waypoints: [[0, 0], [0.3, 0], [0.6, 0.2], [0.9, 0.25]]}",
    "nominal_nmpc.reference_alignment=aligned",
)
RUNS = {
    "rectangle": load_scenario("rectangle"),
    "fast": load_scenario("rectangle", FAST),
    "own_path": load_scenario(str(EXAMPLES / "own_path.scenario.yaml")),
}
PICTURES: dict[str, tuple[str, Callable[[Run, Theme], Figure]]] = {  # Of which run.
    "path": ("rectangle", path_picture),
    "tube": ("fast", tube_picture),
    "own_path": ("own_path", path_picture),
    "sindyc": ("rectangle", sindyc_picture),
}


def draw_pictures(app: Sphinx) -> None:
    """Runs the scenarios and writes the pictures."""
    folder = Path(app.srcdir) / "generated" / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    runs = {name: simulate(scenario, name) for name, scenario in RUNS.items()}
    for theme in THEMES:
        with matplotlib.rc_context({**STYLE, **dict.fromkeys(COLORED, theme.ink)}):
            for name, (run, draw) in PICTURES.items():
                path = folder / f"{name}-{theme.name}.svg"
                draw(runs[run], theme).savefig(path, metadata={"Date": None}, bbox_inches="tight")


def write_replay_page(app: Sphinx, error: Exception | None) -> None:
    """Writes the replay that the tutorial shows beside its pages."""
    if error is None:
        with tempfile.TemporaryDirectory() as folder:
            save_run(simulate(RUNS["own_path"], "own_path"), Path(folder))
            write_replay(Path(folder), Path(app.outdir) / "replay.html")


class Picture(SphinxDirective):
    """Shows a picture by its name."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Returns both pictures, of which a page shows one."""
        (name,) = self.arguments
        if name not in PICTURES:
            raise self.error(f"picture: must be one of {', '.join(PICTURES)}, got {name}")
        alt = " ".join(self.content)
        return [
            nodes.image(
                uri=f"/generated/pictures/{name}-{theme.name}.svg",
                alt=alt,
                classes=[f"only-{theme.name}"],
            )
            for theme in THEMES
        ]


def setup(app: Sphinx) -> dict[str, bool]:
    """Has the pictures drawn before Sphinx looks for its sources."""
    app.connect("build-finished", write_replay_page)
    app.add_directive("picture", Picture)
    app.connect("builder-inited", draw_pictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
