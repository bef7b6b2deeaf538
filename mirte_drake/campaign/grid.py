"""What a campaign runs: scenarios, the values of fields that are varied, and seeds."""

import dataclasses as dc
import itertools
from collections.abc import Sequence

import yaml

from mirte_drake.errors import UserError
from mirte_drake.scenario import Scenario, WiredRobotConfig
from mirte_drake.scenario_file import load_scenario, scenario_names, scenario_stem

# Of the scenarios that drive the same path by different controllers.
CONTROLLERS = ("pid_", "lqr_", "baseline_", "", "rigorous_", "lagged_")


@dc.dataclass(frozen=True)
class Variation:
    """A field of the scenario and the values that it takes, as YAML text."""

    field: str
    values: tuple[str, ...]


@dc.dataclass(frozen=True)
class Cell:
    """What the seeds of a campaign repeat: one scenario with one value of every varied field."""

    name: str
    values: tuple[str, ...]  # Of the varied fields, as given.
    scenario: Scenario


@dc.dataclass(frozen=True)
class Trial:
    """One run of a campaign."""

    cell: Cell
    seed: int

    @property
    def scenario(self) -> Scenario:
        """The scenario with the seed."""
        return dc.replace(self.cell.scenario, seed=self.seed)


def parse_variation(text: str) -> Variation:
    """Returns the variation of ``path.to.field=[value, value, ...]``; the values are YAML.

    Raises:
        UserError: when it is not of that form.
    """
    origin = f"--vary {text}"
    field, _, values = text.partition("=")
    field = field.strip()
    if field == "seed":
        raise UserError(f"{origin}: seeds are given by --runs and --seed")
    try:
        root = yaml.compose(values, Loader=yaml.SafeLoader)
    except yaml.YAMLError:
        root = None
    if not isinstance(root, yaml.SequenceNode) or not root.value:
        raise UserError(f"{origin}: must be path.to.field=[value, value, ...]")
    given = [values[node.start_mark.index : node.end_mark.index].strip() for node in root.value]
    return Variation(field, tuple(dict.fromkeys(given)))


def cells(
    names: Sequence[str], variations: Sequence[Variation] = (), overrides: Sequence[str] = ()
) -> list[Cell]:
    """Returns every scenario with every combination of the values, each checked.

    Overrides of a part come before those of its fields, whichever were given first.

    Raises:
        UserError: when a scenario does not load, a field is varied twice, or the robot is beyond
            a wire.
    """
    fields = [variation.field for variation in variations]
    for field in fields:
        if fields.count(field) > 1:
            raise UserError(f"--vary {field}: stands twice; give all its values in one list")
    grid = []
    for name in dict.fromkeys(names):
        for values in itertools.product(*(variation.values for variation in variations)):
            varied = [f"{field}={value}" for field, value in zip(fields, values, strict=True)]
            settings = sorted((*overrides, *varied), key=_depth)
            scenario = load_scenario(name, settings)
            if isinstance(scenario.robot, WiredRobotConfig):
                raise UserError(f"{name}: robot: is beyond a wire; a campaign runs simulated ones")
            grid.append(Cell(scenario_stem(name), values, scenario))
    return grid


def _depth(override: str) -> int:
    return override.partition("=")[0].count(".")


def trials(grid: Sequence[Cell], seeds: Sequence[int]) -> list[Trial]:
    """Returns every cell with every seed, cell by cell."""
    return [Trial(cell, seed) for cell in grid for seed in seeds]


def with_controllers(names: Sequence[str]) -> list[str]:
    """Returns, for each scenario, those that drive its path by every controller there is.

    Raises:
        UserError: when no scenario has such a name.
    """
    known = scenario_names()
    for name in names:
        if name not in known:
            load_scenario(name)  # Says what is known.
            raise UserError(f"{name}: with --controllers it must be one of {', '.join(known)}")
    family = [prefix + name for name in names for prefix in CONTROLLERS]
    return [name for name in dict.fromkeys(family) if name in known]
