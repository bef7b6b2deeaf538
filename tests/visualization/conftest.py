import pytest

from mirte_drake.reporting import load_run
from mirte_drake.robots.names import robot_override
from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run
from mirte_drake.scenario_file import load_scenario

SETTINGS = {
    "rectangle": ("rectangle", []),
    "rectangle_1": ("rectangle", ["seed=1"]),
    "baseline_rectangle": ("baseline_rectangle", []),
    "dynamic": ("rectangle", [robot_override("dynamic")]),
    "circle": ("circle", []),
    "rigorous_rectangle": ("rigorous_rectangle", []),
    "lagged_rectangle": ("lagged_rectangle", ["state_estimator.delay=2"]),
    "pid_rectangle": ("pid_rectangle", []),
    "lqr_rectangle": ("lqr_rectangle", []),
}


@pytest.fixture(scope="session")
def run_folders(tmp_path_factory):
    """Folders of runs of two seconds, by their names."""
    folder = tmp_path_factory.mktemp("runs")
    for name, (scenario, overrides) in SETTINGS.items():
        loaded = load_scenario(scenario, [*overrides, "duration=2"])
        save_run(simulate(loaded, scenario), folder / name)
    return {name: folder / name for name in SETTINGS}


@pytest.fixture(scope="session")
def reported_runs(run_folders):
    return {name: load_run(folder) for name, folder in run_folders.items()}
