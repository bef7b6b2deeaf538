import json

import pytest
from cli_runner import check_wrong_use, run_cli

QUICK = ["--quick", "--problems", 3, "--repeats", 1, "--solver", "snopt", "--set", "seed=1"]


def test_benchmark_writes_what_it_says(tmp_path, capsys):
    code, out, _ = run_cli(capsys, "benchmark", "circle", *QUICK, "--output", tmp_path)
    assert code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "benchmark.json",
        "benchmark.pdf",
        "benchmark.png",
        "benchmark.svg",
    ]
    summary = json.loads((tmp_path / "benchmark.json").read_text())
    assert set(summary) == {
        "scenario", "period_s", "problems", "repeats", "pause_repeats", "solvers", "closed_loop",
        "ancillary_design_ms", "first_call", "first_call_after_installation",
        "horizon", "states", "conditions", "versions",
    }  # fmt: skip
    assert (summary["scenario"], summary["problems"], summary["repeats"]) == ("circle", 3, 1)
    row = summary["solvers"]["snopt"]
    assert set(row) == {
        "solves", "failures", "solve_time_ms", "after_pause_ms", "preparation_ms",
        "feedback_after_pause_ms", "share_of_period", "processor_share", "speedup", "iterations",
        "optimality_gap", "rate_violation_pwm",
    }  # fmt: skip
    assert row["solves"] == 3 and row["failures"] == 0
    assert set(row["solve_time_ms"]) == {"p50", "p99", "p99_9", "max"}
    assert set(row["after_pause_ms"]) == {"p50", "p99"}
    assert row["feedback_after_pause_ms"] is None  # SNOPT has nothing to prepare.
    assert summary["horizon"]["horizon"] == [10, 20]
    assert summary["states"]["num_states"] == [3, 3, 6]
    assert f"{row['solve_time_ms']['p50']:.3f}" in out and str(tmp_path) in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["rectangel"], ["did you mean 'rectangle'"]),
        (["--solver", "acados"], ["'acados' is not known", "snopt"]),
        (["--problems", "0"], ["--problems"]),
        (["--repeats", "-1"], ["--repeats"]),
        (["--set", "nominal_nmpc.horizn=4"], ["horizn"]),
        (["--output", "/dev/null/x", "--quick"], ["/dev/null/x", "cannot be"]),
        (["--fast"], ["--fast"]),
    ],
)
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, ["benchmark", *arguments], words)
    assert list(tmp_path.iterdir()) == []
