from matplotlib.figure import Figure

from mirte_drake.visualization.thesis_page import (
    Table,
    ThesisFigure,
    figure_files,
    save_thesis_figure,
    save_thesis_page,
)


def draw():
    figure = Figure(figsize=(2, 2))
    figure.subplots().plot([0, 1], [0, 1])
    return figure


FIGURE = ThesisFigure(
    "4-2", "A title", {"a": ("Path.", draw), "b": ("Error < 1.", draw)}, ours="a run.",
    published="a number.", table=Table(("RMSE", "x [m]"), [["tube", "0.01"]]),
)  # fmt: skip


def test_every_part_is_a_file(tmp_path):
    written = save_thesis_figure(FIGURE, tmp_path)
    assert [path.name for path in written] == figure_files({"4-2": 2})
    assert written[0].name == "figure_4-2a.pdf" and len(written) == 6
    assert all(path.stat().st_size > 500 for path in written)


def test_the_page_has_captions_and_numbers(tmp_path):
    path = save_thesis_page([FIGURE], ["3-2", "3-3"], {"drake": "1.0"}, tmp_path)
    text = path.read_text()
    assert path.name == "index.html"
    assert "<b>Ours:</b> a run." in text and "<b>Published:</b> a number." in text
    assert "<b>(b)</b> Error &lt; 1." in text
    assert '<th scope="row">tube</th><td class="number">0.01</td>' in text
    assert "Figures 3-2, 3-3 need the robot" in text and "drake 1.0" in text
    assert text.count("<svg") == 2
    assert "need the robot" not in save_thesis_page([FIGURE], [], {}, tmp_path).read_text()
