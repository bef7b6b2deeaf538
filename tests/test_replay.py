import dataclasses as dc
import itertools
import json
import math

import numpy as np
import pytest

from mirte_drake.assembly import MakeDiagram
from mirte_drake.control.reference_paths import integrate_body_velocity
from mirte_drake.errors import UserError
from mirte_drake.geometry import body_velocity
from mirte_drake.replay import (
    MOST_FRAMES,
    MOST_PIECES,
    frames,
    load_run,
    rolled_wheel_angles,
    run_page,
    trails,
    write_replay,
)
from mirte_drake.run import samples as samples_of
from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run
from mirte_drake.scenario_file import load_scenario

LIMIT = 5_000_000  # Bytes.


def saved(folder, name="circle", *overrides):
    folder.mkdir(exist_ok=True)
    save_run(simulate(load_scenario(name, overrides), name), folder)
    return load_run(folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    saved(folder, "turning_circle", "duration=2")
    return folder


@pytest.fixture
def run(folder):
    return load_run(folder)


def test_wheels_of_a_robot_that_drives_straight_ahead_turn_alike():
    angles = rolled_wheel_angles(np.array([[0.0, 0, 0], [0.051, 0, 0], [0.153, 0, 0]]))
    np.testing.assert_allclose(angles, [[0] * 4, [1] * 4, [3] * 4], atol=1e-12)


def test_wheels_of_a_robot_that_drives_to_its_left_turn_against_each_other():
    # Heading along y, so that its left is -x; (2-2): fl and rr backward, fr and rl forward.
    yaw = np.pi / 2
    angles = rolled_wheel_angles(np.array([[0.0, 0, yaw], [-0.051, 0, yaw]]))
    np.testing.assert_allclose(angles[1], [-1, 1, -1, 1], atol=1e-12)


def test_wheels_of_a_robot_that_turns_on_the_spot_turn_right_ones_forward():
    angles = rolled_wheel_angles(np.array([[0.0, 0, 0], [0, 0, 0.1]]))
    expected = 0.1 * (0.09 + 0.135) / 0.051  # Yaw times reach over radius.
    np.testing.assert_allclose(angles[1], expected * np.array([-1, 1, 1, -1]))


def test_wheel_angles_give_back_the_body_velocity_that_was_driven():
    velocities = np.random.default_rng(0).uniform(-1, 1, (50, 3)) * [0.3, 0.3, 2.0]
    poses = integrate_body_velocity(velocities, np.array([1.0, 2.0, 3.0]), 0.1)
    angles = rolled_wheel_angles(poses)
    np.testing.assert_allclose(body_velocity(np.diff(angles, axis=0)) / 0.1, velocities, atol=1e-12)


def test_frames_have_what_the_log_has(run):
    shown = frames(run)
    assert len(shown) == 21
    for k in (0, 7, 20):
        for field, name in (
            *((name, name) for name in ("pose", "true_pose", "reference", "disturbance")),
            ("wheel_command", "applied_input"),
        ):
            np.testing.assert_array_equal(getattr(shown[k], field), run.log[name][k])
        np.testing.assert_allclose(shown[k].plan[0], run.log["nominal_pose"][k], atol=1e-9)
        np.testing.assert_allclose(shown[k].plan[1], run.log["nominal_next"][k], atol=1e-6)
        assert shown[k].plan.shape == shown[k].half_widths.shape == (11, 3)
    np.testing.assert_array_equal(shown[5].half_widths, run.log["half_width"][5:16])
    np.testing.assert_array_equal(shown[20].half_widths, [run.log["half_width"][20]] * 11)


def test_a_lagged_plan_goes_on_from_its_own_velocity(tmp_path):
    run = saved(tmp_path, "lagged_circle", "state_estimator.delay=2", "duration=2")
    shown = frames(run)
    plans = {}
    for context, _ in samples_of(diagram := MakeDiagram(run.scenario), run.scenario):
        plans[len(plans)] = diagram.GetOutputPort("plan").Eval(context).states[:, :3]
    for k in (0, 7, 17):
        np.testing.assert_allclose(shown[k].plan, plans[k], atol=1e-9)


@pytest.mark.parametrize("name", ["pid_circle", "lqr_circle"])
def test_a_controller_that_does_not_plan_has_neither_plan_nor_tube(name, tmp_path):
    run = saved(tmp_path, name, "duration=1")
    for k, frame in enumerate(frames(run)):
        np.testing.assert_array_equal(frame.plan, [run.log["pose"][k]] * 11)
        np.testing.assert_array_equal(frame.half_widths, np.zeros((11, 3)))
    np.testing.assert_array_equal(trails(run, 5)[1].nominal[0], run.log["pose"][5:7])
    assert not np.any(trails(run, 5)[0].half_widths)
    legend = run_page(run).split('<ul id="legend"')[1].split("</ul>")[0]
    assert "nominal plan" not in legend and "tube" not in legend


def test_trails_follow_each_other_to_the_end(run):
    pieces = trails(run, 3)
    assert [len(piece.poses) - 1 for piece in pieces] == [3] * 6 + [2]
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_array_equal(before.poses[-1], after.poses[0])
    np.testing.assert_array_equal(pieces[-1].poses[-1], run.log["pose"][-1])
    np.testing.assert_array_equal(pieces[1].nominal[0, 0], run.log["nominal_pose"][3])
    np.testing.assert_array_equal(pieces[1].nominal[0, 1], run.log["nominal_next"][3])
    np.testing.assert_array_equal(pieces[1].half_widths[2, 1], run.log["half_width"][6])


def test_the_page_needs_nothing_but_itself(run):
    page = run_page(run)
    assert page.startswith("<!DOCTYPE html>") and page.rstrip().endswith("</html>")
    assert "<title>turning_circle</title>" in page
    assert "sindyc robot, seed 0, RMSE" in page
    overlay = page.split('<div id="about"')[1]
    for words in ("measured pose", "nominal plan", "tube", "disturbance", "wheel command"):
        assert words in overlay
    assert "true pose" not in overlay  # It is the measured one.
    assert "@" not in overlay  # Every placeholder is filled.
    for tag in ("<script src", "<link", "<img", "<iframe", "new WebSocket(url)"):
        assert tag not in page


def test_the_legend_names_what_there_is(tmp_path):
    run = saved(tmp_path, "baseline_circle", "robot=!MultibodyRobotConfig {}", "duration=0.5")
    legend = run_page(run).split('<ul id="legend"')[1].split("</ul>")[0]
    assert "true pose" in legend and "multibody robot" in run_page(run)
    assert "tube" not in legend and "disturbance" not in legend


def test_a_name_cannot_become_part_of_the_page(folder, tmp_path):
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    summary = json.loads((tmp_path / "summary.json").read_text())
    summary["scenario"] = "<script>alert('@end@')</script>"
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    page = run_page(load_run(tmp_path))
    assert "<script>alert" not in page
    assert "<title>&lt;script&gt;alert(&#x27;@end@&#x27;)" in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "overrides", "samples"),
    [
        ("robot_circle", [], 315),
        ("rectangle", ["nominal_nmpc.horizon=40", "reference.duration=30"], 301),
        ("circle", ["reference.duration=39.9"], MOST_FRAMES),
        ("circle", ["reference.duration=120"], 1201),
    ],
)
def test_the_page_stays_below_its_limit(name, overrides, samples, tmp_path):
    run = saved(tmp_path, name, *overrides)
    assert len(run.log["pose"]) == samples
    # As of a robot that slips: with a trail of its own for the true pose.
    run = dc.replace(run, log={**run.log, "true_pose": 0.9 * run.log["pose"]})
    size = len(run_page(run).encode())
    assert 3_000_000 < size < LIMIT


def test_no_trail_has_more_pieces_than_its_most(run):
    for samples in (2, 21, MOST_PIECES, MOST_PIECES + 1, 2 * MOST_PIECES + 1, 1201):
        rows = np.arange(samples) % len(run.log["pose"])
        longer = dc.replace(run, log={name: array[rows] for name, array in run.log.items()})
        pieces = trails(longer, math.ceil(samples / MOST_PIECES))
        assert 0 < len(pieces) <= MOST_PIECES


def spoil(folder, tmp_path, **arrays):
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with np.load(folder / "log.npz") as log:
        kept = {**log, **arrays}
    np.savez(tmp_path / "log.npz", **{k: v for k, v in kept.items() if v is not None})
    return tmp_path


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"pose": None}, ["log.npz", "pose"]),
        ({"pose": np.zeros((21, 2))}, ["log.npz", "pose must have shape (21, 3)"]),
        ({"nominal_plan": np.zeros((21, 9, 4))}, ["nominal_plan must have shape (21, 10, 4)"]),
        ({"reference": np.zeros((20, 3))}, ["reference must have shape (21, 3)"]),
        ({"true_pose": np.full((21, 3), np.nan)}, ["true_pose must have finite numbers"]),
        ({"half_width": np.full((21, 3), "a")}, ["log.npz", "not the log of a run"]),
        ({"pose": np.zeros((0, 3))}, ["log.npz", "must have shape"]),
    ],
)
def test_a_log_of_something_else_is_a_user_error(arrays, words, folder, tmp_path):
    with pytest.raises(UserError) as caught:
        load_run(spoil(folder, tmp_path, **arrays))
    for word in (*words, "simulate anew"):
        assert word in str(caught.value)


@pytest.mark.parametrize("name", ["log.npz", "summary.json", "as_run.scenario.yaml"])
def test_a_missing_file_is_named_with_what_writes_it(name, folder, tmp_path):
    spoil(folder, tmp_path)
    (tmp_path / name).unlink()
    with pytest.raises(UserError, match=f"has no {name}; simulate writes it"):
        load_run(tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("log.npz", b"PK\x03\x04 and no more"),
        ("summary.json", b"{"),
        ("summary.json", b"[]"),
        ("summary.json", b"{}"),
        ("summary.json", b"\xff\xfe"),
        ("as_run.scenario.yaml", b"period: fast"),
    ],
)
def test_a_broken_file_is_a_user_error_that_names_it(name, content, folder, tmp_path):
    spoil(folder, tmp_path)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=name):
        load_run(tmp_path)


def test_nothing_is_half_written(folder, tmp_path, monkeypatch):
    path = tmp_path / "page.html"
    path.write_text("before")

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("pathlib.Path.write_text", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_replay(folder, path)
    monkeypatch.undo()
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]
