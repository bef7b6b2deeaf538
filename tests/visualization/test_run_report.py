import dataclasses as dc
import re

import pytest

from mirte_drake.visualization.run_report import run_report

DIAGRAM = "<svg><text>Nominal NMPC</text></svg>"


def headline(text):
    items = re.findall(
        r'<dt>(.*?)</dt><dd class="value.*?">(.*?)</dd><dd class="note">(.*?)<', text
    )
    return {label: (value, note) for label, value, note in items}


def table(text):
    rows = re.findall(r'<th scope="row">(.*?)</th><td class="number">(.*?)</td>', text)
    return {label: value.replace("\u00a0", " ") for label, value in rows}


def test_numbers_are_those_of_the_summary(reported_runs, blank_figures):
    run = reported_runs["rectangle"]
    text = run_report(run, diagram=DIAGRAM)
    rmse, solve = run.summary["rmse"], run.summary["solve_time_ms"]
    shown = headline(text)
    assert shown["RMSE x"] == (f"{1e3 * rmse['x_m']:.1f}\u00a0mm", "against the reference")
    assert shown["Failed solves"] == ("0", "of 21")
    assert shown["Next sample in the tube"][1].endswith("of 20")
    numbers = table(text)
    expected = ", ".join(f"{solve[key]:.2f}" for key in ("p50", "p99", "max"))
    assert numbers["solve time"] == f"{expected} ms"
    assert numbers["next sample outside the tube"] == str(run.summary["successor_violations"])
    assert f"drake {run.summary['versions']['drake']}" in text


def test_figures_diagram_and_scenario_are_there(reported_runs):
    run = reported_runs["rectangle"]
    text = run_report(run, diagram=DIAGRAM)
    assert text.count('<figure class="plot">') == 5
    assert "Nominal NMPC" in text and "terminal_weight:" in text
    assert "<h1>rectangle</h1>" in text
    assert run.description in text
    assert "Tube NMPC on the sindyc robot, solver converged; 21 samples in 2.0 s, seed 0." in text


def test_the_baseline_has_no_tube(reported_runs, blank_figures):
    text = run_report(reported_runs["baseline_rectangle"], diagram=DIAGRAM)
    assert headline(text)["Next sample in the tube"] == ("no tube", "baseline NMPC")
    assert text.count('<figure class="plot">') == 4
    assert "next sample outside the tube" not in table(text)


def test_where_odometry_measures_the_truth_stands_beside_it(reported_runs):
    run = reported_runs["dynamic"]
    text = run_report(run, diagram=DIAGRAM)
    true = f"{1e3 * run.summary['true_rmse']['x_m']:.1f}\u00a0mm"
    assert headline(text)["RMSE x"][1] == f"measured; truly {true}"
    assert ">true</text>" in text  # In the legends of path and errors.


def test_a_robot_on_the_wire_has_no_truth_but_says_how_the_wire_was(reported_runs, blank_figures):
    run = reported_runs["rectangle"]
    log = {key: value for key, value in run.log.items() if key != "true_pose"}
    wire = {
        "ended": "the guard stopped the robot",
        "command_latency_ms": {"p50": 1.0, "p99": 2.0, "max": 3.25},
        "missed_odometry": 4,
    }
    summary = {**run.summary, "true_rmse": None, "wire": wire}
    text = run_report(dc.replace(run, log=log, summary=summary), diagram=DIAGRAM)
    numbers = table(text)
    assert numbers["RMSE, true pose"] == "unknown"
    assert numbers["command latency"] == "1.00, 2.00, 3.25 ms"
    assert numbers["missed odometry"] == "4"
    assert headline(text)["RMSE x"][1] == "measured by odometry"
    assert "mirte-drake&nbsp;drive&nbsp;as_run.scenario.yaml" in text
    assert "It ended before its time: the guard stopped the robot." in text


def test_failed_solves_stand_out(reported_runs, blank_figures):
    run = reported_runs["rectangle"]
    failed = dc.replace(run, summary={**run.summary, "solve_failures": 3})
    assert '<dd class="value bad">3</dd>' in run_report(failed, diagram=DIAGRAM)


def test_a_replay_is_within_the_page(reported_runs, blank_figures):
    replay = "<html><script>if (1 < 2 && \"a\" > 'b') go()</script></html>"
    text = run_report(reported_runs["rectangle"], diagram=DIAGRAM, replay=replay)
    (frame,) = re.findall(r"<iframe [^>]*>", text)
    assert 'srcdoc="&lt;html&gt;&lt;script&gt;if (1 &lt; 2 &amp;&amp; &#34;a&#34;' in frame
    assert "<script>" not in text
    assert "iframe" not in re.sub("<style>.*?</style>", "", run_report(
        reported_runs["rectangle"], diagram=DIAGRAM), flags=re.S)  # fmt: skip


def test_without_a_picture_it_says_why(reported_runs, blank_figures):
    text = run_report(reported_runs["rectangle"], diagram="", no_diagram="no <wire> here")
    assert "No picture: no &lt;wire&gt; here" in text


@pytest.mark.parametrize("name", ["pid_rectangle", "lqr_rectangle"])
def test_a_controller_that_does_not_plan_has_neither_solver_nor_tube(name, reported_runs):
    run = reported_runs[name]
    text = run_report(run, diagram=DIAGRAM)
    assert list(headline(text)) == ["RMSE x", "RMSE y", "RMSE yaw"]
    assert list(table(text)) == ["RMSE, measured pose", "RMSE, true pose", "wall time"]
    assert text.count('<figure class="plot">') == 3
    assert f"Pose {name[:3].upper()} on the sindyc robot; 21 samples in 2.0 s, seed 0." in text


@pytest.mark.parametrize("name", ["rigorous_rectangle", "lagged_rectangle"])
def test_other_tubes_have_all_that_the_published_one_has(name, reported_runs):
    run = reported_runs[name]
    text = run_report(run, diagram=DIAGRAM)
    assert text.count('<figure class="plot">') == (6 if name == "lagged_rectangle" else 5)
    assert "Tube NMPC on the" in text and "linearised" not in text
    assert table(text)["next sample outside the tube"] == str(run.summary["successor_violations"])


def test_coverage_is_told_where_it_was_watched(reported_runs, blank_figures):
    run = reported_runs["lagged_rectangle"]
    coverage, numbers = run.summary["coverage"], table(run_report(run, diagram=DIAGRAM))
    assert numbers["held by the set in use"] == f"{coverage['in_use']:.1%}"
    assert numbers["held by the calibrated set"] == f"{coverage['calibrated']:.1%}"
    assert numbers["warnings, set in use"] == str(coverage["warnings"]["in_use"])
    unwatched = table(run_report(reported_runs["rectangle"], diagram=DIAGRAM))
    assert not any("held by" in label for label in unwatched)


@pytest.mark.parametrize("name", ["rectangle", "baseline_rectangle", "lqr_rectangle"])
def test_headings_go_down_one_by_one(name, reported_runs, blank_figures):
    levels = re.findall(r"<h(\d)", run_report(reported_runs[name], diagram=DIAGRAM))
    assert levels == ["1", *["2"] * (len(levels) - 1)]


def test_a_run_of_one_sample_has_a_report(reported_runs):
    """As of a drive that is stopped at once."""
    run = reported_runs["rectangle"]
    log = {key: values[:1] for key, values in run.log.items()}
    summary = {**run.summary, "steps": 1, "simulated_time_s": 0.0, "successor_violations": 0}
    none = tuple(values[:0] for values in run.tube)
    text = run_report(dc.replace(run, log=log, tube=none, summary=summary), diagram=DIAGRAM)
    assert headline(text)["Next sample in the tube"] == ("100.0 %", "outside at 0 of 1")
