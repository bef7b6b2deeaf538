"""The benchmark as JSON."""

import math
import os
import platform

import numpy as np

from mirte_drake.benchmark.measure import PAUSE, Measurement, percentiles
from mirte_drake.benchmark.scaling import Scaling, crossover, growth_exponent
from mirte_drake.benchmark.solvers import BASELINE, has_casadi
from mirte_drake.benchmark.study import Benchmark
from mirte_drake.run_summary import versions

REPORT_FILE = "benchmark.json"

# The fastest solver of each form that finds the optimum.
CONDENSED, SPARSE = "converged", "casadi_sqp_hpipm"


def report(benchmark: Benchmark) -> dict[str, object]:
    """Returns what ``benchmark.json`` holds; what is not known is null."""
    return {
        "scenario": benchmark.name,
        "period_s": benchmark.period,
        "problems": benchmark.problems,
        "repeats": benchmark.settings.repeats,
        "pause_repeats": benchmark.settings.pause_repeats,
        "solvers": {
            name: _solver_report(benchmark, measurement)
            for name, measurement in benchmark.solves.items()
        },
        "closed_loop": {
            name: {
                "samples": len(loop.error),
                "rmse": dict(zip(("x_m", "y_m", "yaw_rad"), map(float, loop.rmse), strict=True)),
                "solve_time_ms": percentiles(1e3 * loop.solve_time),
                "failures": int(np.sum(~loop.success)),
            }
            for name, loop in benchmark.closed_loops.items()
        },
        "ancillary_design_ms": percentiles(1e3 * benchmark.design_time),
        "first_call": _call_report(benchmark.first_calls),
        "first_call_after_installation": _call_report(benchmark.installation_calls),
        "horizon": _scaling_report(benchmark.horizons, "horizon")
        | {"crossover": _crossover_report(benchmark.horizons)},
        "states": _scaling_report(benchmark.states, "num_states")
        | {"model": list(benchmark.states.labels)},
        "conditions": {
            "omp_num_threads": os.environ.get("OMP_NUM_THREADS", "not set"),
            "garbage_collection": "off while timing",
            "pause_ms": 1e3 * PAUSE,
            "processor_share": _processor_share(benchmark),
            "machine": platform.machine(),
            "processors": os.cpu_count(),
        },
        "versions": versions() | _casadi_version(),
    }


def _solver_report(benchmark: Benchmark, measurement: Measurement) -> dict[str, object]:
    times = percentiles(measurement.solve_time)
    baseline = benchmark.solves.get(BASELINE)
    gap = measurement.gap[measurement.success]
    return {
        "solves": len(measurement.solve_time),
        "failures": int(np.sum(~measurement.success)),
        "solve_time_ms": {key: 1e3 * value for key, value in times.items()},
        "after_pause_ms": _tails(measurement.after_pause),
        "preparation_ms": _tails(measurement.preparation),
        "feedback_after_pause_ms": _tails(measurement.feedback),
        "share_of_period": {key: value / benchmark.period for key, value in times.items()},
        "processor_share": float(
            np.sum(measurement.processor_time) / np.sum(measurement.solve_time)
        ),
        "speedup": None if baseline is None else _speedup(baseline, measurement),
        "iterations": {
            "p50": float(np.median(measurement.iterations)),
            "max": int(np.max(measurement.iterations)),
        },
        "optimality_gap": {
            "p50": _known(np.median(gap)) if gap.size else None,
            "max": _known(np.max(gap)) if gap.size else None,
        },
        "rate_violation_pwm": _known(
            np.max(measurement.rate_violation, initial=0.0, where=measurement.success)
        ),
    }


def _tails(times: np.ndarray) -> dict[str, float] | None:
    """Returns median and 99th percentile [ms] of times [s]."""
    if not times.size:
        return None
    every = percentiles(1e3 * times)
    return {key: every[key] for key in ("p50", "p99")}


def _processor_share(benchmark: Benchmark) -> float:
    """Processor time over wall clock, all solves: 1 is one thread that was never interrupted."""
    rows = benchmark.solves.values()
    busy = sum(float(np.sum(row.processor_time)) for row in rows)
    return busy / sum(float(np.sum(row.solve_time)) for row in rows)


def _speedup(baseline: Measurement, measurement: Measurement) -> float:
    """How many times the baseline's median the measured one goes into."""
    return float(np.median(baseline.solve_time) / np.median(measurement.solve_time))


def _scaling_report(scaling: Scaling, size: str) -> dict[str, object]:
    return {
        size: list(scaling.sizes),
        "solve_time_ms": {
            name: [_known(1e3 * value) for value in times]
            for name, times in scaling.solve_time.items()
        },
        "growth_exponent": {
            name: _known(growth_exponent(scaling.sizes, times))
            for name, times in scaling.solve_time.items()
        },
    }


def _crossover_report(scaling: Scaling) -> dict[str, object] | None:
    if not {CONDENSED, SPARSE} <= set(scaling.solve_time):
        return None
    condensed, sparse = scaling.solve_time[CONDENSED], scaling.solve_time[SPARSE]
    horizon = _known(crossover(scaling.sizes, condensed, sparse))
    return {"condensed": CONDENSED, "sparse": SPARSE, "horizon": horizon}


def _known(value: float) -> float | None:
    """JSON has neither NaN nor infinity."""
    return float(value) if math.isfinite(value) else None


def _call_report(calls: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    return {name: stages | {"total_s": sum(stages.values())} for name, stages in calls.items()}


def _casadi_version() -> dict[str, str]:
    if not has_casadi():
        return {}
    from importlib.metadata import version

    return {"casadi": version("casadi")}
