"""The command that runs campaigns."""

import csv
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.campaign.workers import ORPHAN_TIME

SHORT = ["--set", "duration=0.5"]


def test_campaign_writes_and_prints_its_tables(tmp_path, capsys):
    code, out, _ = run_cli(
        capsys, "campaign", "rectangle", "baseline_circle", "--runs", 2, "--seed", 3,
        "--vary", "input_limit=[50, 100]", "--robot", "dynamic", *SHORT,
        "--backend", "serial", "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    with (tmp_path / "runs.csv").open(newline="") as file:
        runs = [(row["scenario"], row["input_limit"], row["seed"]) for row in csv.DictReader(file)]
    names, limits, seeds = ("rectangle", "baseline_circle"), ("50", "100"), ("3", "4")
    assert runs == list(itertools.product(names, limits, seeds))
    cells = json.loads((tmp_path / "summary.json").read_text())["cells"]
    for line, cell in zip(out.splitlines()[1:5], cells, strict=True):
        assert line.split()[:3] == [cell["scenario"], cell["input_limit"], "2"]
    assert len(list((tmp_path / "results").iterdir())) == 8
    assert f"Written to {tmp_path}" in out


def test_controllers_are_those_of_the_path(tmp_path, capsys):
    code, out, _ = run_cli(
        capsys, "campaign", "circle", "--controllers", "--runs", 1, *SHORT,
        "--backend", "serial", "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    names = [line.split()[0] for line in out.splitlines()[1:-1]]
    assert names.index("baseline_circle") < names.index("circle")


def test_a_failed_run_is_told(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise ValueError("no such floor")

    monkeypatch.setattr("mirte_drake.campaign.outcome.simulate", fail)
    code, _, err = run_cli(
        capsys, "campaign", "circle", "--runs", 2, *SHORT, "--backend", "serial",
        "--output", tmp_path,
    )  # fmt: skip
    assert code == 1 and "2 of 2 runs failed, the first by ValueError: no such floor" in err
    assert (tmp_path / "runs.csv").read_text().count("no such floor") == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["campaign"], ["NAME"]),
        (["campaign", "squircle"], ["squircle", "did you mean 'circle'"]),
        (["campaign", "circle", "--runs", "0"], ["--runs"]),
        (["campaign", "circle", "--jobs", "0"], ["--jobs"]),
        (["campaign", "circle", "--seed", "-1"], ["--seed"]),
        (["campaign", "circle", "--backend", "threads"], ["--backend", "threads", "loky"]),
        (["campaign", "circle", "--vary", "period"], ["--vary period", "[value, value, ...]"]),
        (["campaign", "circle", "--vary", "speed=[1]"], ["--set speed=1", "speed"]),
        (["campaign", "circle", "--address", "tcp://there:1"], ["--address", "--backend dask"]),
    ],
)
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert not list(tmp_path.rglob("*.*"))


def start(folder: Path, runs: int, jobs: int = 2) -> subprocess.Popen:
    command = [
        *(sys.executable, "-m", "mirte_drake", "campaign", "baseline_rectangle", "rectangle"),
        *("--vary", "robot=[!SindycRobotConfig {}, !MultibodyRobotConfig {motors: fitted}]"),
        *("--runs", str(runs // 4), "--jobs", str(jobs), "--set", "duration=0.3"),
        *("--output", str(folder)),
    ]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def finished(folder: Path) -> int:
    return len(list((folder / "results").glob("*.json")))


def children(process: int) -> list[int]:
    return [
        int(child)
        for task in Path(f"/proc/{process}/task").iterdir()
        for child in (task / "children").read_text().split()
    ]


def runs_on(process: int) -> bool:
    """Whether a process is there, and more than an entry that nobody has asked for yet."""
    try:
        return "(zombie)" not in Path(f"/proc/{process}/status").read_text()
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="looks for processes in /proc")
def test_a_campaign_that_is_killed_goes_on_to_the_same_table(tmp_path):
    """CAMPAIGN_RUNS=200 in the environment has so many runs, and five kills."""
    runs = int(os.environ.get("CAMPAIGN_RUNS", "20"))
    kills = max(2, runs // 40)
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert start(whole, runs).wait() == 0
    assert finished(whole) == runs
    orphans = []
    for kill in range(1, kills + 1):
        process = start(broken, runs)
        # Somewhere in the middle of a run.
        while finished(broken) < kill * runs // (kills + 1):
            assert process.poll() is None
            time.sleep(0.01)
        orphans += children(process.pid)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        assert not (broken / "runs.csv").exists()
    assert 0 < finished(broken) < runs
    before = {path: path.stat().st_mtime_ns for path in (broken / "results").glob("*.json")}
    assert start(broken, runs).wait() == 0
    assert finished(broken) == runs
    # What was done was not done again.
    assert {path: path.stat().st_mtime_ns for path in before} == before
    names = sorted(path.name for path in whole.iterdir() if path.is_file())
    assert {"runs.csv", "summary.json"} <= set(names)
    assert names == sorted(path.name for path in broken.iterdir() if path.is_file())
    for name in names:
        assert (broken / name).read_bytes() == (whole / name).read_bytes()
    assert len(orphans) >= 2
    end = time.monotonic() + ORPHAN_TIME + 5.0
    while any(map(runs_on, orphans)) and time.monotonic() < end:
        time.sleep(0.5)
    assert not any(map(runs_on, orphans))


@pytest.mark.slow
@pytest.mark.realtime  # Alone on its processors.
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="two workers need two processors")
def test_two_workers_are_faster_than_one(tmp_path):
    times = []
    for jobs in (1, 2):
        begin = time.monotonic()
        assert start(tmp_path / str(jobs), 40, jobs).wait() == 0
        times.append(time.monotonic() - begin)
    assert times[1] < times[0]
