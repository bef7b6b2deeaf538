import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.cli.figures import PARTS
from mirte_drake.thesis.recorded import FILES
from mirte_drake.thesis.simulated import EXPERIMENTS, STUDIES
from mirte_drake.visualization.thesis_page import Table, ThesisFigure


@pytest.fixture
def quick(monkeypatch, blank_figures):
    """Figures without what takes long: runs and drawing."""

    def figure(number, data=None):
        return ThesisFigure(number, "A title", {}, "a run.", "a number.", Table((), ()))

    monkeypatch.setattr("mirte_drake.thesis.simulated.simulated_figure", figure)
    monkeypatch.setattr("mirte_drake.thesis.recorded.recorded_figure", figure)


def drawn(folder):
    text = (folder / "index.html").read_text()
    return [number for number in PARTS if f'<h2 id="figure-{number}">' in text]


def test_every_figure_comes_from_somewhere():
    assert sorted(PARTS) == sorted([*FILES, *STUDIES, *EXPERIMENTS])


def test_one_figure_is_drawn_and_written(tmp_path, capsys):
    code, out, err = run_cli(capsys, "figures", "5-2", "--output", tmp_path)
    assert code == 0 and str(tmp_path / "index.html") in out
    assert "Without" not in err
    assert drawn(tmp_path) == ["5-2"]
    names = {f"figure_5-2{part}.{suffix}" for part in "abc" for suffix in ("pdf", "png", "svg")}
    assert {path.name for path in tmp_path.iterdir()} == {"index.html", *names}


def test_without_recordings_the_others_are_drawn(tmp_path, capsys, quick):
    code, _, err = run_cli(capsys, "figures", "--output", tmp_path)
    assert code == 0
    assert "Without 3-2, 3-3, 3-4: they need the robot's recordings, --data FOLDER" in err
    assert drawn(tmp_path) == ["4-2", "4-3", "5-2", "5-3", "5-4", "5-5"]


def test_with_recordings_all_are_drawn(tmp_path, capsys, quick):
    code, _, err = run_cli(capsys, "figures", "--data", tmp_path, "--output", tmp_path / "new")
    assert code == 0 and "Without" not in err
    assert drawn(tmp_path / "new") == list(PARTS)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["3-3"], ["3-3", "--data"]),
        (["3-3", "--data", "."], ["validation_turn_rect.csv", "3-3"]),
        (["--data", "nowhere"], ["nowhere", "does not exist"]),
        (["2-1"], ["2-1", "4-2"]),
    ],
)
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, ["figures", *arguments], words)
