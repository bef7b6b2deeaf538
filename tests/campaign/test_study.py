import dataclasses as dc
import functools

import pytest

from mirte_drake.campaign import study
from mirte_drake.campaign.grid import Trial, Variation, cells, trials
from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.campaign.store import load_result, scenario_key
from mirte_drake.robots.sindyc_robot import SindycRobotConfig

ROBOTS = Variation("robot", ("!SindycRobotConfig {}", "!MultibodyRobotConfig {motors: fitted}"))
run_here = functools.partial(study.run_trials, backend="serial")


@functools.cache
def grid(duration=0.5):
    return tuple(cells(["baseline_rectangle"], [ROBOTS], [f"duration={duration}"]))


def todo(runs=2) -> list[Trial]:
    return trials(grid(), range(runs))


def failing() -> Trial:
    cell = grid()[0]
    scenario = dc.replace(cell.scenario, robot=SindycRobotConfig(model="rocket"))
    return Trial(dc.replace(cell, scenario=scenario), 0)


def test_results_are_in_the_order_of_the_trials():
    outcomes = run_here(todo())
    assert all(isinstance(result, Outcome) and result.samples == 6 for result in outcomes)
    assert run_here(todo()[::-1]) == outcomes[::-1]
    assert len(set(outcomes)) == 4  # Each robot and seed drives in its own way.


@pytest.mark.slow
def test_processes_give_what_one_gives():
    calls = []
    many = study.run_trials(todo(), jobs=2, on_run=lambda: calls.append(1))
    assert many == run_here(todo())
    assert len(calls) == 4


def test_what_is_stored_is_not_run_again(tmp_path, monkeypatch):
    first = run_here(todo(1), store=tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    ran, calls = [], []

    def run_outcome(scenario):
        ran.append(scenario.seed)
        return first[0]

    monkeypatch.setattr(study, "run_outcome", run_outcome)
    again = run_here(todo(2), store=tmp_path, on_run=lambda: calls.append(1))
    assert ran == [1, 1] and len(calls) == 4
    assert [again[0], again[2]] == first


def test_half_a_file_is_run_again(tmp_path):
    first = run_here(todo(1), store=tmp_path)
    one, _ = sorted(tmp_path.iterdir())
    one.write_text(one.read_text()[:50])
    (tmp_path / ".partial-killed").mkdir()
    assert run_here(todo(1), store=tmp_path) == first
    assert len(list(tmp_path.iterdir())) == 2


def test_a_failed_run_is_a_result_and_stays_one(tmp_path):
    one, failure, other = run_here([todo()[0], failing(), todo()[1]], store=tmp_path)
    assert isinstance(one, Outcome) and isinstance(other, Outcome)
    assert isinstance(failure, Failure) and "rocket" in failure.error
    assert load_result(tmp_path, f"{scenario_key(failing().scenario)}-0") == failure


def test_a_run_whose_process_died_is_tried_again_next_time(tmp_path, monkeypatch):
    def die(*_):
        raise OSError("the process died")

    with monkeypatch.context() as patch:
        patch.setattr(study, "run_outcome", die)
        results = run_here(todo(1), store=tmp_path)
    assert results == [Failure("OSError: the process died")] * 2
    assert list(tmp_path.iterdir()) == []
    assert all(isinstance(result, Outcome) for result in run_here(todo(1), store=tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_a_cluster_gives_what_one_process_gives(backend):
    pytest.importorskip("distributed" if backend == "dask" else "ray")
    assert study.run_trials(todo(1), backend=backend, jobs=2) == run_here(todo(1))
