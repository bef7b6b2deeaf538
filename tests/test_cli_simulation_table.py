from mirte_drake.cli.simulation import summary_table
from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario


def rows(*overrides) -> dict[str, str]:
    run = simulate(load_scenario("lagged_rectangle", ["duration=1.5", *overrides]), "lagged")
    lines = summary_table(summarise(run), tube=True).splitlines()
    return {line[:22].strip(): line[22:] for line in lines}


def test_coverage_is_told_and_a_set_that_is_too_small_warned_of():
    tight = rows(
        "coverage_monitor={window: 5}", "lagged_tube.innovation_bound=[1.0e-6, 1.0e-6, 1.0e-6]"
    )
    assert tight["held by the set"].startswith(("0.0% of", "6.7% of"))  # The first error is none.
    assert tight["warning"].endswith("widen it, or use the calibrated one")


def test_a_set_that_holds_all_gives_no_warning():
    wide = rows("coverage_monitor={window: 5}", "lagged_tube.innovation_bound=[0.1, 0.1, 0.1]")
    assert wide["held by the set"].startswith("100.0% of") and "warning" not in wide


def test_without_a_monitor_nothing_is_said_of_it():
    assert "held by the set" not in rows("coverage_monitor=null")
