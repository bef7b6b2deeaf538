import dataclasses as dc
import json

import numpy as np
import pytest

from mirte_drake.benchmark.closed_loop import ClosedLoop
from mirte_drake.benchmark.measure import Measurement
from mirte_drake.benchmark.report import report
from mirte_drake.benchmark.scaling import Scaling
from mirte_drake.benchmark.solvers import available_solvers, check_solvers
from mirte_drake.benchmark.study import QUICK, Benchmark
from mirte_drake.benchmark.table import table
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import load_model


def measurement(milliseconds, gaps=(1e-6, 3e-6, np.nan), prepared=()) -> Measurement:
    gap = np.array(gaps)
    success = ~np.isnan(gap)
    times = 1e-3 * np.array(milliseconds)
    violation = np.where(success, 1e-7, np.nan)
    return Measurement(
        times, 0.5 * times, np.array([2, 4, 3]), gap, violation, success,
        after_pause=2.0 * times,
        preparation=1e-3 * np.array(prepared),
        feedback=3e-3 * np.array(prepared),
    )  # fmt: skip


@pytest.fixture
def benchmark() -> Benchmark:
    error = np.array([[3.0, 0.0, 1.0], [4.0, 0.0, -1.0]])
    loop = ClosedLoop(error, np.array([0.001, 0.003]), np.ones(2), np.array([True, False]))
    fast, slow = 1e-6 * np.array([1.0, 8.0]), 4e-6 * np.array([1.0, 2.0])
    return Benchmark(
        name="rectangle",
        period=0.1,
        settings=QUICK,
        problems=3,
        solves={
            "casadi_ipopt": measurement([3.0, 4.0, 5.0]),
            "converged": measurement([0.1, 0.2, 0.3], prepared=[0.01, 0.02]),
            "broken": measurement([1.0, 1.0, 1.0], [np.nan] * 3),
        },
        closed_loops={"converged": loop},
        design_time=np.array([2e-5, 3e-5, 9e-5]),
        first_calls={
            "converged": {"import_s": 1.0, "construction_s": 2.0, "first_solve_s": 4.0},
        },
        installation_calls={"converged": {"import_s": 1.0, "first_solve_s": 12.25}},
        horizons=Scaling((10, 20), ("10", "20"), {"converged": fast, "casadi_sqp_hpipm": slow}),
        states=Scaling((3, 6), ("kinematic", "dynamic"), {"converged": np.array([1e-3, np.nan])}),
    )


def test_report_of_known_numbers(benchmark):
    result = report(benchmark)
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    row = result["solvers"]["converged"]
    assert (row["solves"], row["failures"]) == (3, 1)
    assert row["solve_time_ms"]["p50"] == pytest.approx(0.2)
    assert row["solve_time_ms"]["max"] == pytest.approx(0.3)
    assert row["after_pause_ms"] == pytest.approx({"p50": 0.4, "p99": 0.596})
    assert row["preparation_ms"] == pytest.approx({"p50": 0.015, "p99": 0.0199})
    assert row["feedback_after_pause_ms"] == pytest.approx({"p50": 0.045, "p99": 0.0597})
    assert result["solvers"]["casadi_ipopt"]["feedback_after_pause_ms"] is None
    assert row["share_of_period"]["max"] == pytest.approx(0.003)
    assert row["speedup"] == pytest.approx(20.0)
    assert result["solvers"]["casadi_ipopt"]["speedup"] == 1.0
    assert row["processor_share"] == result["conditions"]["processor_share"] == pytest.approx(0.5)
    assert row["iterations"] == {"p50": 3.0, "max": 4}
    assert row["optimality_gap"] == pytest.approx({"p50": 2e-6, "max": 3e-6})
    assert row["rate_violation_pwm"] == pytest.approx(1e-7)
    loop = result["closed_loop"]["converged"]
    assert loop["rmse"] == pytest.approx({"x_m": np.sqrt(12.5), "y_m": 0.0, "yaw_rad": 1.0})
    assert loop["failures"] == 1 and loop["solve_time_ms"]["p50"] == pytest.approx(2.0)
    assert result["ancillary_design_ms"]["p50"] == pytest.approx(0.03)
    assert "DLQR design, checked: 0.030 ms median" in table(result)
    assert result["first_call"]["converged"]["total_s"] == 7.0
    assert result["first_call_after_installation"]["converged"]["total_s"] == 13.25
    horizon = result["horizon"]
    assert horizon["growth_exponent"] == pytest.approx({"converged": 3, "casadi_sqp_hpipm": 1})
    # 1 * 2^(3 s) = 4 * 2^s at s = 1: they meet at 20, where neither is faster.
    assert horizon["crossover"]["horizon"] is None
    assert result["states"]["solve_time_ms"]["converged"] == [1.0, None]
    assert result["states"]["growth_exponent"]["converged"] is None


def test_what_no_solve_gave_is_null(benchmark):
    row = report(benchmark)["solvers"]["broken"]
    assert row["failures"] == 3
    assert row["optimality_gap"] == {"p50": None, "max": None}


def test_without_the_baseline_there_is_no_speedup(benchmark):
    solves = {"converged": benchmark.solves["converged"]}
    result = report(dc.replace(benchmark, solves=solves))
    assert result["solvers"]["converged"]["speedup"] is None
    table(result)


def test_table_has_every_part(benchmark):
    text = table(report(benchmark))
    assert "converged" in text and "20.0" in text and "1/3" in text
    row = next(line for line in text.splitlines() if line.startswith("converged"))
    assert row.split()[1:7] == ["0.200", "0.298", "0.300", "0.300", "0.400", "0.045"]
    row = next(line for line in text.splitlines() if line.startswith("casadi_ipopt"))
    assert row.split()[5:7] == ["8.000", "-"]
    assert "paused: median after 5 ms of sleep" in text
    assert "With nothing compiled yet, as after an installation: converged 13.2 s" in text
    assert "is faster than converged at none of these horizons" in text
    crossing = dc.replace(
        benchmark.horizons,
        solve_time={"converged": np.array([1.0, 8.0]), "casadi_sqp_hpipm": np.array([2.0, 4.0])},
    )
    text = table(report(dc.replace(benchmark, horizons=crossing)))
    assert "casadi_sqp_hpipm is faster than converged from a horizon of about 14 on" in text


def test_solvers_are_checked_by_name():
    assert check_solvers(["snopt", "ipopt", "snopt"]) == ("snopt", "ipopt")
    assert set(check_solvers(["snopt"])) <= set(available_solvers())
    with pytest.raises(UserError, match="'acados' is not known: use some of"):
        check_solvers(["acados"])


def test_solvers_that_need_a_model_of_terms_are_not_for_a_lagged_one():
    lagged = load_model("lagged")
    assert "converged" in available_solvers(lagged)
    assert "casadi_ipopt" not in available_solvers(lagged)
    if "casadi_ipopt" in available_solvers():
        with pytest.raises(UserError, match="cannot have the model 'lagged': use realtime, "):
            check_solvers(["casadi_ipopt"], lagged)


def test_a_missing_package_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setattr("mirte_drake.benchmark.solvers.has_casadi", lambda: False)
    assert "casadi_ipopt" not in available_solvers()
    with pytest.raises(UserError, match=r"pip install mirte-drake\[benchmark\]"):
        check_solvers(["casadi_ipopt"])
