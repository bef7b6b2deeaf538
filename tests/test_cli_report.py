import pytest
from cli_runner import check_wrong_use, run_cli

QUICK = ["--set", "duration=0.5"]


def test_simulate_writes_a_report(tmp_path, capsys):
    run_cli(capsys, "simulate", "circle", *QUICK, "--output", tmp_path)
    assert "<h1>circle</h1>" in (tmp_path / "report.html").read_text()
    run_cli(capsys, "simulate", "circle", *QUICK, "--no-plots", "--output", tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_report_of_one_and_of_two_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("circle", "baseline_circle"):
        run_cli(capsys, "simulate", name, *QUICK, "--no-plots")
    code, out, _ = run_cli(capsys, "report", "runs/circle")
    assert (code, out) == (0, "Written to runs/circle/report.html\n")
    assert (tmp_path / "runs/circle/report.html").is_file()
    code, out, _ = run_cli(capsys, "report", "runs/circle", "runs/baseline_circle")
    assert (code, out) == (0, "Written to runs/comparison.html\n")
    assert "2 runs, 2 settings" in (tmp_path / "runs/comparison.html").read_text()
    code, out, _ = run_cli(capsys, "report", "runs/circle", "--output", "mine.html")
    assert (code, out) == (0, "Written to mine.html\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["RUN_FOLDER"]),
        (["nowhere"], ["nowhere", "does not exist"]),
        (["."], ["log.npz", "is missing"]),
    ],
)
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, ["report", *arguments], words)
    assert list(tmp_path.iterdir()) == []
