"""The benchmark as text."""

from collections.abc import Iterable

PAUSED = ("after_pause_ms", "feedback_after_pause_ms")


def table(report: dict) -> str:
    """Returns a report for a person to read."""
    solvers, loops, calls = report["solvers"], report["closed_loop"], report["first_call"]
    period, conditions = 1e3 * report["period_s"], report["conditions"]
    count = max(len(name) for name in solvers)
    head = (
        f"{'solver':{count}}  {'p50':>8} {'p99':>8} {'p99.9':>8} {'max':>8} "
        f"{'paused':>8} {'feedback':>8}  "
        f"{'of period':>9} {'speed':>7} {'iter.':>6} {'gap p50':>8} {'gap max':>8} {'failed':>7}"
    )
    lines = [
        f"Solve time [ms] on {report['problems']} logged problems of {report['scenario']}; "
        f"period {period:g} ms, OMP_NUM_THREADS {conditions['omp_num_threads']}",
        f"(processor time is {100 * conditions['processor_share']:.0f}% of it: less than 100% when "
        "others took the processor, more with several threads)",
        f"(back to back; paused: median after {conditions['pause_ms']:g} ms of sleep; feedback: "
        "that without what was prepared before the sleep)",
        head,
    ]
    for name, row in solvers.items():
        paused = [(row[key] or {}).get("p50") for key in PAUSED]
        times = [*row["solve_time_ms"].values(), *paused]
        lines.append(
            f"{name:{count}}  {_numbers(times, 8, '.3f')}  "
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
    design = report["ancillary_design_ms"]
    lines += [
        "",
        f"Ancillary DLQR design, checked: {design['p50']:.3f} ms median, "
        f"{design['p99']:.3f} ms p99",
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


def _numbers(values: Iterable[float | None], width: int, form: str) -> str:
    return " ".join(_number(value, width, form) for value in values)


def _number(value: float | None, width: int, form: str) -> str:
    return f"{'-':>{width}}" if value is None else f"{value:{width}{form}}"
