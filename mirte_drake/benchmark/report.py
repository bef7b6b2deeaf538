"""The benchmark as JSON and as text."""

import math
import os
import platform
from collections.abc import Sequence

import numpy as np

from mirte_drake.benchmark.measure import Measurement, percentiles
from mirte_drake.benchmark.scaling import Scaling, crossover, growth_exponent
from mirte_drake.benchmark.solvers import BASELINE, has_casadi
from mirte_drake.benchmark.study import Benchmark
from mirte_drake.run import versions

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
        "first_call": _call_report(benchmark.first_calls),
        "first_call_after_installation": _call_report(benchmark.installation_calls),
        "horizon": _scaling_report(benchmark.horizons, "horizon")
        | {"crossover": _crossover_report(benchmark.horizons)},
        "states": _scaling_report(benchmark.states, "num_states")
        | {"model": list(benchmark.states.labels)},
        "conditions": {
            "omp_num_threads": os.environ.get("OMP_NUM_THREADS", "not set"),
            "garbage_collection": "off while timing",
            "processor_share": _processor_share(benchmark),
            "machine": platform.machine(),
            "processors": os.cpu_count(),
        },
        "versions": versions() | _casadi_version(),
    }


def table(report: dict) -> str:
    """Returns a report for a person to read."""
    solvers, loops, calls = report["solvers"], report["closed_loop"], report["first_call"]
    period, conditions = 1e3 * report["period_s"], report["conditions"]
    count = max(len(name) for name in solvers)
    head = (
        f"{'solver':{count}}  {'p50':>8} {'p99':>8} {'p99.9':>8} {'max':>8}  "
        f"{'of period':>9} {'speed':>7} {'iter.':>6} {'gap p50':>8} {'gap max':>8} {'failed':>7}"
    )
    lines = [
        f"Solve time [ms] on {report['problems']} logged problems of {report['scenario']}; "
        f"period {period:g} ms, OMP_NUM_THREADS {conditions['omp_num_threads']}",
        f"(processor time is {100 * conditions['processor_share']:.0f}% of it: less than 100% when "
        "others took the processor, more with several threads)",
        head,
    ]
    for name, row in solvers.items():
        times = row["solve_time_ms"]
        lines.append(
            f"{name:{count}}  {_numbers(times.values(), 8, '.3f')}  "
            f"{100 * row['share_of_period']['max']:8.1f}% {_number(row['speedup'], 7, '.1f')} "
            f"{row['iterations']['p50']:6.0f} {_numbers(row['optimality_gap'].values(), 8, '.0e')} "
            f"{row['failures']:3d}/{row['solves']}"
        )
    lines += [
        "",
        "Closed loop",
        f"{'solver':{count}}  {'RMSE x [m]':>11} {'y [m]':>8} {'yaw [rad]':>10}  "
        f"{'p50 [ms]':>8} {'p99':>8} {'max':>8} {'failed':>7}",
    ]
    for name, row in loops.items():
        rmse, times = row["rmse"], row["solve_time_ms"]
        lines.append(
            f"{name:{count}}  {rmse['x_m']:11.5f} {rmse['y_m']:8.5f} {rmse['yaw_rad']:10.5f}  "
            f"{times['p50']:8.3f} {times['p99']:8.3f} {times['max']:8.3f} "
            f"{row['failures']:3d}/{row['samples']}"
        )
    lines += [
        "",
        "First call in a fresh process [s]",
        f"{'solver':{count}}  {'import':>8} {'build':>8} {'solve':>8} {'total':>8}",
    ]
    for name, row in calls.items():
        lines.append(f"{name:{count}}  {_numbers(row.values(), 8, '.2f')}")
    for name, row in report["first_call_after_installation"].items():
        lines.append(
            f"With nothing compiled yet, as after an installation: {name} {row['total_s']:.1f} s"
        )
    lines += ["", *_scaling_table(report["horizon"], "horizon", count, exponent=True)]
    crossing = report["horizon"]["crossover"]
    if crossing is not None:
        where = crossing["horizon"]
        lines.append(
            f"{crossing['sparse']} is faster than {crossing['condensed']} "
            + (f"from a horizon of about {where:.0f} on" if where else "at none of these horizons")
        )
    lines += ["", *_scaling_table(report["states"], "num_states", count, exponent=False)]
    return "\n".join(lines)


def _solver_report(benchmark: Benchmark, measurement: Measurement) -> dict[str, object]:
    times = percentiles(measurement.solve_time)
    baseline = benchmark.solves.get(BASELINE)
    gap = measurement.gap[measurement.success]
    return {
        "solves": len(measurement.solve_time),
        "failures": int(np.sum(~measurement.success)),
        "solve_time_ms": {key: 1e3 * value for key, value in times.items()},
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


def _scaling_table(rows: dict, size: str, width: int, *, exponent: bool) -> list[str]:
    what = size.replace("num_", "number of ")
    head = "".join(f" {value:>8}" for value in rows[size])
    lines = [f"Median solve time [ms] over the {what}", f"{'solver':{width}} {head}"]
    if "model" in rows:
        lines.insert(1, f"({', '.join(rows['model'])})")
    if exponent:
        lines[-1] += f" {'growth':>8}"
    for name, times in rows["solve_time_ms"].items():
        line = f"{name:{width}}  {_numbers(times, 8, '.2f')}"
        if exponent:
            line += f"  {_number(rows['growth_exponent'][name], 7, '.2f')}"
        lines.append(line)
    return lines


def _numbers(values: Sequence[float | None], width: int, form: str) -> str:
    return " ".join(_number(value, width, form) for value in values)


def _number(value: float | None, width: int, form: str) -> str:
    return f"{'-':>{width}}" if value is None else f"{value:{width}{form}}"


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
