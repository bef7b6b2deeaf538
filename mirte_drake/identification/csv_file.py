"""The CSV format of the robot's recordings: one header, one row per sample, columns by name."""

import csv
import dataclasses as dc
import hashlib
import io
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from mirte_drake.errors import UserError
from mirte_drake.files import read_text, replacing
from mirte_drake.identification.recorded_run import RecordedRun, repaired

TIME_COLUMN = "Timestamp"
POSE_COLUMNS = ("X", "Y", "Yaw")
VELOCITY_COLUMNS = ("VX", "VY", "VYaw")
# In our order of the wheels; the files have another one, see HEADER.
WHEEL_COLUMNS = ("Left_Front_Input", "Right_Front_Input", "Right_Rear_Input", "Left_Rear_Input")
COLUMNS = (*POSE_COLUMNS, *VELOCITY_COLUMNS, *WHEEL_COLUMNS)
HEADER = (TIME_COLUMN, *COLUMNS[:8], "Left_Rear_Input", "Right_Rear_Input")

STAMP = re.compile(r"(\d{4}-\d{2}-\d{2}[ T])?(\d{1,2}:\d{2}:\d{2}.*)", re.ASCII)

DELIMITERS = (",", ";", "\t")  # As spreadsheets write them.


def load_csv(path: Path) -> RecordedRun:
    """Reads a recording from a CSV file; further columns are ignored.

    Time stamps are ISO dates and times, HH:MM:SS, or seconds.

    Raises:
        UserError: when the file cannot be read, columns are missing, a cell is no number, or the
            content is of no use; see ``recorded_run.repaired``.
    """
    text = read_text(path).removeprefix("\ufeff")
    try:
        run, lines = _parse(text)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    run = dc.replace(run, source=path.name, sha256=sha256)
    return repaired(run, lambda row: f"row {lines[row]}", str(path))


def save_csv(run: RecordedRun, path: Path) -> None:
    """Writes a recording as a CSV file, time in seconds, complete or not at all.

    Reading it returns an equal run.

    Raises:
        UserError: when it cannot be written.
    """
    table = np.column_stack([run.time, run.pose, run.body_velocity, run.wheel_command])
    order = [(TIME_COLUMN, *COLUMNS).index(name) for name in HEADER]
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(table[:, order].tolist())


def _parse(text: str) -> tuple[RecordedRun, list[int]]:
    """Returns the run as it stands in the text, and the line of each row."""
    first = text.split("\n", 1)[0]
    delimiter = max(DELIMITERS, key=first.count)
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        rows = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
    except csv.Error as error:
        raise UserError(f"row {reader.line_num}: cannot be read as CSV: {error}") from None
    if not rows:
        raise UserError(f"is empty: must have the columns {', '.join(HEADER)}")
    header = [name.strip() for name in rows.pop(0)[1]]
    if missing := [name for name in HEADER if name not in header]:
        raise UserError(
            f"columns missing: {', '.join(missing)}; the header is {', '.join(header)!r:.200}"
        )
    if twice := [name for name in HEADER if header.count(name) > 1]:
        raise UserError(f"columns given twice: {', '.join(twice)}; rename or remove one of each")
    needed = 1 + max(header.index(name) for name in HEADER)
    repairs = []
    # Where the text ends within or right after the last cell needed, digits may be missing.
    uncertain = needed + (not text.endswith("\n"))
    if rows and len(rows[-1][1]) < uncertain:
        line, _ = rows.pop()
        repairs.append(f"row {line}: the last one is cut off; dropped")
    for line, cells in rows:
        if len(cells) < needed:
            raise UserError(
                f"row {line}: has {len(cells)} cells of {needed}: complete or delete it"
            )
    lines = [line for line, _ in rows]
    stamps = [cells[header.index(TIME_COLUMN)] for _, cells in rows]
    time = _seconds(stamps, lines, repairs)
    index = [header.index(name) for name in COLUMNS]
    table = np.array(
        [
            [_number(cells[i], line, name) for i, name in zip(index, COLUMNS, strict=True)]
            for line, cells in rows
        ]
    ).reshape(-1, len(COLUMNS))
    pose, velocity, command = table[:, :3], table[:, 3:6], table[:, 6:]
    return RecordedRun(time, pose, velocity, command, repairs=tuple(repairs)), lines


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(cell: str, line: int, name: str) -> float:
    if not _is_number(cell):
        found = f"{cell!r:.40}" if cell.strip() else "empty"
        raise UserError(f"row {line}: {name} is {found}: must be a number")
    return float(cell)


def _seconds(stamps: list[str], lines: list[int], repairs: list[str]) -> np.ndarray:
    """Returns time stamps in seconds from the first; all are of the first one's kind."""
    if not stamps:
        return np.zeros(0)
    if _is_number(stamps[0]):
        seconds = np.array(
            [_number(text, line, TIME_COLUMN) for text, line in zip(stamps, lines, strict=True)]
        )
        return seconds - seconds[0]
    dated = "-" in stamps[0][:8]  # Otherwise a time of day.
    times = [_datetime(text, line, dated) for text, line in zip(stamps, lines, strict=True)]
    seconds = np.array([(time - times[0]).total_seconds() for time in times])
    days = np.concatenate([[0], np.cumsum(np.diff(seconds) < -43_200)])
    if dated or not days[-1]:
        return seconds
    repairs.append("time: passes midnight; a day added from there on")
    return seconds + 86_400 * days


def _datetime(text: str, line: int, dated: bool) -> datetime:
    """Returns a time stamp; a time of day is taken on one fixed day."""
    match = STAMP.fullmatch(text.strip())
    try:
        if match is None or bool(match[1]) != dated:
            raise ValueError
        clock = "0" + match[2] if match[2][1] == ":" else match[2]
        time = datetime.fromisoformat((match[1] or "1970-01-01 ") + clock)
    except ValueError:
        raise UserError(
            f"row {line}: {TIME_COLUMN} is {text!r:.40}: must be seconds, HH:MM:SS or "
            "YYYY-MM-DD HH:MM:SS, as in the first row"
        ) from None
    return time if time.tzinfo else time.replace(tzinfo=UTC)
