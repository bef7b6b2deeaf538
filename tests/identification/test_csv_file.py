import csv
import hashlib
import io
from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import csv_text, moving_run

from mirte_drake.errors import UserError
from mirte_drake.identification.csv_file import HEADER, load_csv, save_csv
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.csv"


@pytest.fixture
def text(path):
    return csv_text(path)


def load(path, text: str) -> RecordedRun:
    path.write_text(text, encoding="utf-8")
    return load_recorded_run(path)


def load_error(path, text: str | bytes) -> str:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(UserError) as caught:
        load_recorded_run(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message


def with_cell(text: str, row: int, column: str, cell: str) -> str:
    """Text with one cell replaced; the header is row 1, as in an editor."""
    lines = text.splitlines()
    cells = lines[row - 1].split(",")
    cells[HEADER.index(column)] = cell
    lines[row - 1] = ",".join(cells)
    return "\n".join(lines) + "\n"


def with_stamps(text: str, stamps: list[str]) -> str:
    lines = text.splitlines()
    rows = [f"{s},{line.split(',', 1)[1]}" for s, line in zip(stamps, lines[1:], strict=True)]
    return "\n".join([lines[0], *rows]) + "\n"


# Saving and loading.


@pytest.mark.parametrize("period", [0.1, 1 / 3, 0.0999997])
def test_a_saved_run_is_read_back_equal(path, period):
    run = moving_run(60, period)
    save_csv(run, path)
    back = load_recorded_run(path)
    assert back == run and back.repairs == ()
    assert back.source == "run.csv"
    assert back.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_columns_go_by_name(path, text):
    rows = list(csv.DictReader(io.StringIO(text)))
    names = [*HEADER[::-1], "X_ref", ""]
    out = io.StringIO()
    writer = csv.DictWriter(out, names, restval="")
    writer.writeheader()
    writer.writerows(rows)
    assert load(path, out.getvalue()) == moving_run(40)


def test_wheel_order_of_the_file(path):
    save_csv(moving_run(40), path)
    row = next(csv.DictReader(path.open()))
    front_left, front_right, rear_right, rear_left = moving_run(40).wheel_command[0]
    assert float(row["Left_Front_Input"]) == front_left
    assert float(row["Right_Front_Input"]) == front_right
    assert float(row["Right_Rear_Input"]) == rear_right
    assert float(row["Left_Rear_Input"]) == rear_left
    assert path.read_text().startswith(
        "Timestamp,X,Y,Yaw,VX,VY,VYaw,"
        "Left_Front_Input,Right_Front_Input,Left_Rear_Input,Right_Rear_Input\n"
    )


def test_saving_replaces_a_file_at_once(path, monkeypatch):
    path.write_text("precious")
    monkeypatch.setattr(csv, "writer", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        save_csv(moving_run(), path)
    assert path.read_text() == "precious"
    assert list(path.parent.iterdir()) == [path]


def test_saving_where_one_cannot(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        save_csv(moving_run(), tmp_path / "file" / "run.csv")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", ",,\n"),
        lambda text: text.replace("\n", "\n\n") + ",,,,,,,,,,,\n",
        lambda text: text.replace("X,", " X ,", 1),
        lambda text: text.replace("\n", ",\n")[:-1],
    ],
)
def test_harmless_variations(path, text, change):
    back = load(path, change(text))
    assert back == moving_run(40) and back.repairs == ()


# Time stamps.

START = datetime(2025, 12, 31, 23, 59, 58)


def stamps(format_: str, start: datetime = START, **step) -> list[str]:
    return [f"{start + k * timedelta(**step):{format_}}" for k in range(40)]


def test_iso_stamps_over_the_new_year(path, text):
    run = load(path, with_stamps(text, stamps("%Y-%m-%d %H:%M:%S.%f", milliseconds=100)))
    np.testing.assert_allclose(run.time, moving_run(40).time, rtol=0, atol=1e-12)
    assert run.repairs == ()


@pytest.mark.parametrize("zone", ["Z", "+02:00", "-03:30"])
def test_iso_stamps_with_a_zone(path, text, zone):
    run = load(path, with_stamps(text, stamps("%Y-%m-%dT%H:%M:%S.%f" + zone, milliseconds=100)))
    np.testing.assert_allclose(run.time, moving_run(40).time, rtol=0, atol=1e-12)


def test_time_of_day_over_midnight(path, text):
    run = load(path, with_stamps(text, stamps("%H:%M:%S.%f", milliseconds=100)))
    np.testing.assert_allclose(run.time, moving_run(40).time, rtol=0, atol=1e-9)
    assert run.repairs == ("time: passes midnight; a day added from there on",)


def test_coarse_time_of_day(path, text):
    start = START.replace(hour=9, minute=5)
    run = load(path, with_stamps(text, [s[1:] for s in stamps("%H:%M:%S", start, seconds=0.1)]))
    np.testing.assert_array_equal(run.time, np.linspace(0, 3, 40))
    assert run.repairs == (
        "time: stamps have a resolution of 1 s; rebuilt as 40 evenly spaced samples over 3.0 s",
    )


@pytest.mark.parametrize("digits", [1, 3, 6, 9])
def test_fractions_of_any_length(path, text, digits):
    day = [f"9:05:{2 + k / 10:0{3 + digits}.{digits}f}" for k in range(40)]
    for times in (day, [f"2025-01-01 {stamp:0>{9 + digits}}" for stamp in day]):
        run = load(path, with_stamps(text, times))
        np.testing.assert_allclose(run.time, moving_run(40).time, rtol=0, atol=1e-9)


def test_seconds_since_1970(path, text):
    run = load(path, with_stamps(text, [f"{1756120957 + 0.1 * k:.3f}" for k in range(40)]))
    np.testing.assert_allclose(run.time, moving_run(40).time, rtol=0, atol=1e-6)


@pytest.mark.parametrize("stamp", ["", "yesterday", "22:37.2", "12:61:00", "2025-13-01 00:00:00"])
@pytest.mark.parametrize("first", ["0.4", "00:00:00.4", "2025-01-01 00:00:00.4"])
def test_stamps_that_cannot_be_read(path, text, first, stamp):
    assert "row 7: Timestamp is" in load_error(path, with_stamps(text, [first] * 5 + [stamp] * 35))


def test_time_that_goes_back(path, text):
    message = load_error(path, with_cell(text, 12, "Timestamp", "0.55"))
    assert "row 12: time goes back by 0.35 s" in message


# Malformed files, each one line.


@pytest.mark.parametrize("column", HEADER)
def test_missing_columns_are_named(path, text, column):
    message = load_error(path, text.replace(column + ("," if column != HEADER[-1] else ""), "", 1))
    assert f"columns missing: {column};" in message


def test_all_missing_columns_are_named(path):
    message = load_error(path, "time;x;y\n0;1;2\n")
    assert f"columns missing: {', '.join(HEADER)}; the header is 'time, x, y'" in message


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_other_delimiters_are_understood(path, text, delimiter):
    path.write_text(text)
    run = load_csv(path)
    path.write_text(text.replace(",", delimiter))
    assert load_csv(path) == run


def test_columns_given_twice(path, text):
    assert "columns given twice: X" in load_error(path, text.replace("\n", ",X\n", 1))


@pytest.mark.parametrize("content", ["", "\n", " \n,,\n"])
def test_empty_files(path, content):
    assert "is empty" in load_error(path, content)


def test_a_header_alone(path, text):
    assert "has 0 rows: at least 20" in load_error(path, text.splitlines()[0] + "\n")


@pytest.mark.parametrize("column", HEADER[1:])
@pytest.mark.parametrize(
    ("cell", "said"),
    [("", "empty"), ("fast", "'fast'"), ("1.2.3", "'1.2.3'"), ("nan", "nan"), ("-inf", "-inf")],
)
def test_cells_that_are_no_numbers(path, text, column, cell, said):
    message = load_error(path, with_cell(text, 9, column, cell))
    assert "row 9: " in message and said in message and "number" in message


def test_a_short_row(path, text):
    lines = text.splitlines()
    lines[8] = lines[8][:30]
    message = load_error(path, "\n".join(lines) + "\n")
    assert "row 9: has 2 cells of 11: complete or delete it" in message


def test_not_utf8(path, text):
    assert "not UTF-8" in load_error(path, text.encode() + b"\xff\xfe")


def test_an_overlong_cell(path, text):
    assert "cannot be read as CSV" in load_error(path, with_cell(text, 9, "X", "1" * 200_000))


def test_a_missing_file(path):
    with pytest.raises(UserError, match=r"run\.csv: cannot be read: No such file"):
        load_recorded_run(path)


def test_a_folder(tmp_path):
    with pytest.raises(UserError, match=r"folder without metadata\.yaml"):
        load_recorded_run(tmp_path)
    with pytest.raises(UserError, match="cannot be read: Is a directory"):
        load_csv(tmp_path)


def test_a_cut_file_loses_its_last_row(path, text):
    """Wherever it is cut, no half number is taken for a whole one."""
    whole = moving_run(40)
    last = text.rstrip("\n").rindex("\n") + 1
    for end in range(last + 1, len(text)):
        run = load(path, text[:end])
        assert run.repairs == ("row 41: the last one is cut off; dropped",)
        np.testing.assert_array_equal(run.pose, whole.pose[:39])
    assert load(path, text[:last]).repairs == ()


def test_a_file_padded_with_zeros(path, text):
    run = load(path, text + 512 * "\0")
    assert run == moving_run(40)
    assert run.repairs == ("row 42: the last one is cut off; dropped",)


# Whatever the bytes, a run with finite samples or one line.


def check_loads_or_says_why(path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        run = load_recorded_run(path)
    except UserError as error:
        assert "\n" not in str(error)
        return
    for array in (run.time, run.pose, run.body_velocity, run.wheel_command):
        assert np.all(np.isfinite(array)) and len(array) >= 20
    assert np.all(np.diff(run.time) > 0)
    assert all("\n" not in repair for repair in run.repairs)


FUZZ = settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@FUZZ
@given(st.binary(max_size=300))
def test_arbitrary_bytes(path, content):
    check_loads_or_says_why(path, content)


@FUZZ
@given(st.binary(max_size=60), st.integers(0, 10**4), st.integers(0, 60))
def test_bytes_replaced_in_a_good_file(path, patch, start, length):
    good = csv_text(path).encode()
    start %= len(good)
    check_loads_or_says_why(path, good[:start] + patch + good[start + length :])


CELLS = st.one_of(
    st.floats().map(repr),
    st.integers().map(str),
    st.datetimes().map(str),
    st.times().map(str),
    st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    st.sampled_from(["1e308", "-1e308", "1e-320", "24:00:00", "0001-01-01T00:00:00+14:00", '"']),
)


@FUZZ
@given(st.lists(st.tuples(st.integers(1, 41), st.sampled_from(HEADER), CELLS), max_size=4))
def test_cells_replaced_in_a_good_file(path, changes):
    text = csv_text(path)
    for row, column, cell in changes:
        lines = text.split("\n")
        cells = lines[row - 1].split(",")
        if HEADER.index(column) < len(cells):
            cells[HEADER.index(column)] = cell
        lines[row - 1] = ",".join(cells)
        text = "\n".join(lines)
    check_loads_or_says_why(path, text.encode())


@FUZZ
@given(st.sampled_from(HEADER), st.lists(CELLS, min_size=40, max_size=40))
def test_a_column_replaced_in_a_good_file(path, column, cells):
    lines = csv_text(path).splitlines()
    for row, cell in enumerate(cells, start=1):
        line = lines[row].split(",")
        line[HEADER.index(column)] = cell
        lines[row] = ",".join(line)
    check_loads_or_says_why(path, "\n".join([*lines, ""]).encode())
