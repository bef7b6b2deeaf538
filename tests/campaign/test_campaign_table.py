import csv
import dataclasses as dc
import json

import numpy as np
import pytest

from mirte_drake.campaign.grid import Cell, Trial, Variation
from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.campaign.statistics import summarise_cells
from mirte_drake.campaign.table import TABLE_FILES, rows, save_tables, summary_text
from mirte_drake.scenario import Scenario

VARIED = [Variation("robot.floor_friction", ("0.1", "0.8"))]
SLIPPERY, DRY = Cell("circle", ("0.1",), Scenario()), Cell("circle", ("0.8",), Scenario())
NONE = {"tube_violations": None, "successor_violations": None, "true_violations": None}
GOOD = Outcome(
    samples=11,
    delay=0,
    x_m=1 / 3,
    y_m=0.002,
    yaw_rad=0.003,
    true_x_m=0.0041,
    true_y_m=0.005,
    true_yaw_rad=0.006,
    max_distance_m=0.007,
    max_yaw_rad=0.008,
    lost=False,
    saturation=0.25,
    oscillation=1.5,
    solve_failures=0,
    input_violations=1,
    rate_violations=2,
    tube_violations=0,
    successor_violations=5,
    true_violations=11,
    errors=None,
    in_use_misses=None,
    calibrated_misses=None,
)
TRIALS = [*(Trial(SLIPPERY, seed) for seed in range(3)), *(Trial(DRY, seed) for seed in range(6))]
RESULTS = [
    dc.replace(GOOD, lost=True, true_x_m=2.0, **NONE),
    Failure('it said: "no",\nand left'),
    dc.replace(GOOD, true_x_m=np.nan, **NONE),
    *(dc.replace(GOOD, true_x_m=0.001 * number) for number in range(1, 7)),
]


@pytest.fixture
def saved(tmp_path):
    save_tables(rows(VARIED, TRIALS, RESULTS), VARIED, summarise_cells(TRIALS, RESULTS), tmp_path)
    return tmp_path


def test_every_run_is_a_row_of_the_csv_file(saved):
    with (saved / "runs.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 9
    assert list(table[0])[:4] == ["scenario", "robot.floor_friction", "seed", "error"]
    for trial, result, row in zip(TRIALS, RESULTS, table, strict=True):
        assert row["scenario"] == "circle" and row["seed"] == str(trial.seed)
        assert row["robot.floor_friction"] == trial.cell.values[0]
        for key, value in dc.asdict(result).items():
            assert row[key] == ("" if value is None else str(value))
    assert table[1]["x_m"] == "" and table[0]["error"] == ""
    assert float(table[0]["x_m"]) == 1 / 3


def test_the_parquet_file_has_the_same_rows_with_their_types(saved):
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet: mirte-drake[parquet]")
    table = parquet.read_table(saved / "runs.parquet")
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds["robot.floor_friction"] == kinds["error"] == "string"
    assert kinds["seed"] == kinds["true_violations"] == kinds["samples"] == "int64"
    assert kinds["x_m"] == "double" and kinds["lost"] == "bool"
    np.testing.assert_equal(table.to_pylist(), rows(VARIED, TRIALS, RESULTS))


def test_the_summary_has_every_cell(saved):
    summary = json.loads((saved / "summary.json").read_text())
    slippery, dry = summary["cells"]
    assert (slippery["scenario"], slippery["robot.floor_friction"]) == ("circle", "0.1")
    assert (slippery["runs"], slippery["failed"], slippery["lost"]["value"]) == (3, 1, 0.5)
    assert slippery["medians"]["true_x_m"] is slippery["samples"]["true_inside"] is None
    assert slippery["medians"]["x_m"] == {"value": 1 / 3, "low": None, "high": None}
    x = dry["medians"]["true_x_m"]
    assert (x["value"], x["low"], x["high"]) == (pytest.approx(0.0035), 0.001, 0.006)
    assert dry["samples"]["successor_inside"]["value"] == 0.5
    assert dry["samples"]["input_violations"] == 6
    assert summary["confidence"] == 0.95 and "drake" in summary["versions"]


def test_the_text_by_hand():
    head, slippery, dry = summary_text(VARIED, summarise_cells(TRIALS, RESULTS)).splitlines()
    assert head.split()[:5] == ["scenario", "floor_friction", "runs", "failed", "lost"]
    assert slippery.split() == "circle 0.1 3 1 1 - 5 6 1.50 25.0 - -".split()
    assert dry.split()[:5] == ["circle", "0.8", "6", "0", "0"]
    assert dry.split()[5:9] == ["4", "(1-6)", "5", "(5-5)"]
    assert dry.endswith("0.0 (0.0-5.4)  50.0 (36.8-63.2)")
    assert len({len(line) for line in (head, slippery, dry)}) == 1


def test_coverage_is_shown_where_it_was_watched():
    watched = [
        dc.replace(result, errors=40, in_use_misses=20, calibrated_misses=4)
        if trial.cell is DRY
        else result
        for trial, result in zip(TRIALS, RESULTS, strict=True)
    ]
    head, slippery, dry = summary_text(VARIED, summarise_cells(TRIALS, watched)).splitlines()
    assert head.split()[-4:] == ["set", "[%]", "calibrated", "[%]"]
    assert slippery.split()[-2:] == ["-", "-"]
    assert dry.split()[-4:] == ["50.0", "(43.5-56.5)", "90.0", "(85.5-93.5)"]


def test_tables_do_not_change_a_bit(saved, tmp_path):
    again = tmp_path / "again"
    again.mkdir()
    save_tables(rows(VARIED, TRIALS, RESULTS), VARIED, summarise_cells(TRIALS, RESULTS), again)
    for name in TABLE_FILES:
        if (saved / name).exists():
            assert (again / name).read_bytes() == (saved / name).read_bytes()


def test_without_pyarrow_there_is_no_parquet_file(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    save_tables(rows(VARIED, TRIALS, RESULTS), VARIED, summarise_cells(TRIALS, RESULTS), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"runs.csv", "summary.json"}
