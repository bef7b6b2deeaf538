"""A recording of the robot, and what is checked and repaired when one is read."""

import dataclasses as dc
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.vectors import WHEELS, YAW

MIN_ROWS = 20
LONGEST_GAP = 3.0  # [periods] Derivatives take the samples as evenly spaced.
PERIODS = (0.001, 2.0)  # [s] Mean sample times outside these are in another unit.
# [m/s, m/s, rad/s] Three times what 100 % PWM gives: 6 pi R, and that over a + b.
FASTEST = np.array([2.9, 2.9, 12.8])
STILL = 0.02  # [m/s, rad/s] Slower motion tells nothing about units.
RESET_MARGIN = {"x, y": 0.05, "yaw": 0.2}  # [m], [rad] Beyond three times the velocity.
UNIT_FACTORS = {57.3: "degrees for radians", 100.0: "cm for m", 1000.0: "mm for m"}

# A pose quantity, the velocity that belongs to it, their entries and their units.
MOTIONS = (
    ("x, y", "vx, vy", slice(0, 2), "m and m/s"),
    ("yaw", "yaw rate", slice(2, 3), "rad and rad/s"),
)


@dc.dataclass(frozen=True, eq=False)
class RecordedRun:
    """What was recorded, repaired; arrays are not to be written to.

    Two runs are equal when all their samples are, wherever they came from.
    """

    time: np.ndarray  # (N,) [s] from 0, evenly spaced or as stamped.
    pose: np.ndarray  # (N, 3) [m, m, rad] x, y, yaw, world frame, yaw unwrapped.
    body_velocity: np.ndarray  # (N, 3) [m/s, m/s, rad/s] mean over the sample before the row.
    wheel_command: np.ndarray  # (N, 4) [pwm] front left, front right, rear right, rear left.
    source: str = ""  # File it came from.
    sha256: str = ""  # Checksum of that file.
    repairs: tuple[str, ...] = ()  # What was found and repaired, one sentence each.

    @property
    def period(self) -> float:
        """Mean sample time [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def __eq__(self, other: object) -> bool:
        """Tells whether all samples are equal."""
        if not isinstance(other, RecordedRun):
            return NotImplemented
        arrays = ("time", "pose", "body_velocity", "wheel_command")
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in arrays)


def load_recorded_run(path: Path | str) -> RecordedRun:
    """Reads a recording from a CSV file or a ROS 2 bag.

    Args:
        path: CSV file; or bag: its folder, or its .mcap or .db3 file.

    Raises:
        UserError: when it cannot be read, or its content is of no use; see ``repaired``.
    """
    from mirte_drake.identification.bag_file import load_bag  # They import this module.
    from mirte_drake.identification.csv_file import load_csv

    path = Path(path)
    return load_bag(path) if path.is_dir() or path.suffix in (".mcap", ".db3") else load_csv(path)


def check_excitation(run: RecordedRun) -> None:
    """Checks that every wheel command varies, without which no model can be identified.

    Raises:
        UserError: when a wheel's command is constant over the run.
    """
    constant = np.ptp(run.wheel_command, axis=0) == 0
    if np.any(constant):
        names = ", ".join(name for name, still in zip(WHEELS, constant, strict=True) if still)
        raise UserError(
            f"{run.source}: the wheel command is constant ({names}): nothing can be identified "
            "from it; record a run that drives all four wheels"
        )


def repaired(run: RecordedRun, where: Callable[[int], str], origin: str) -> RecordedRun:
    """Returns a run as it was read after checking and repairing it.

    Coarse time stamps are rebuilt as evenly spaced and wrapped yaw is unwrapped; both are added
    to ``repairs``, beside what was found and kept: jitter and rows that repeat the row before.

    Args:
        run: As read; ``time`` [s] as stamped, from 0.
        where: Names a row, counted from 0, for messages.
        origin: File (and topic), for messages.

    Raises:
        UserError: when there are too few rows, a value that is not finite or beyond what the
            robot can do, time that goes backward, stands still or has a gap, a reset of the
            odometry, or pose and velocity in units or frames that do not fit.
    """
    repairs = list(run.repairs)
    try:
        _check_numbers(run, where)
        run = dc.replace(run, time=_repaired_time(run.time, where, repairs))
        _check_units(run)
        _check_speed(run, where)
        run = dc.replace(run, pose=_unwrapped(run.pose, repairs))
        _check_resets(run, where)
        _check_frame(run)
    except UserError as error:
        raise UserError(f"{origin}: {error}") from None
    samples = np.hstack([run.pose, run.body_velocity, run.wheel_command])
    repeated = int(np.count_nonzero(np.all(np.diff(samples, axis=0) == 0, axis=1)))
    if repeated:
        repairs.append(f"{_count(repeated, 'row')} equal to the row before (standstill); kept")
    return dc.replace(run, repairs=tuple(repairs))


def _check_numbers(run: RecordedRun, where: Callable[[int], str]) -> None:
    if len(run.time) < MIN_ROWS:
        raise UserError(f"has {len(run.time)} rows: at least {MIN_ROWS} are needed; record longer")
    columns = np.column_stack([run.time, run.pose, run.body_velocity, run.wheel_command])
    names = ("time", "x", "y", "yaw", "vx", "vy", "yaw rate", *WHEELS)
    for row, column in np.argwhere(~(np.abs(columns) < 1e12))[:1]:
        value = columns[row, column]
        raise UserError(
            f"{where(row)}: {names[column]} is {value:g}: must be a finite number; correct it, "
            "or cut the recording there"
        )
    command = np.abs(run.wheel_command)
    for row, wheel in np.argwhere(command > 100)[:1]:
        value = run.wheel_command[row, wheel]
        raise UserError(f"{where(row)}: {WHEELS[wheel]} is {value:g}: PWM percent is in +-100")
    if 0 < command.max() <= 1:
        raise UserError(
            f"all wheel commands are within +-{command.max():g}: they must be PWM percent, "
            "multiply them by 100"
        )


def _repaired_time(time: np.ndarray, where: Callable[[int], str], repairs: list[str]) -> np.ndarray:
    """Returns the stamps [s], rebuilt as evenly spaced where they are too coarse to tell rows."""
    steps = np.diff(time)
    for row in np.flatnonzero(steps < 0)[:1] + 1:
        raise UserError(
            f"{where(row)}: time goes back by {-steps[row - 1]:g} s: sort the rows, or cut the "
            "recording there"
        )
    period = (time[-1] - time[0]) / len(steps)
    if not PERIODS[0] <= period <= PERIODS[1]:
        raise UserError(f"the mean sample time is {period:g} s: time must advance, in seconds")
    resolution = _resolution(steps)
    coarse = bool(np.any(steps == 0)) and resolution >= period / 2
    for row in np.flatnonzero((steps == 0) & (not coarse))[:1] + 1:
        raise UserError(f"{where(row)}: has the time of the row before: delete one of the two")
    blur = resolution if coarse else 0.0
    for row in np.flatnonzero(steps > blur + LONGEST_GAP * period)[:1] + 1:
        raise UserError(
            f"{where(row)}: comes {steps[row - 1]:.3g} s after the row before, a gap of more than "
            f"{LONGEST_GAP:g} periods of {period:.3g} s: cut the recording there"
        )
    if coarse:
        repairs.append(
            f"time: stamps have a resolution of {resolution:g} s; rebuilt as {len(time)} evenly "
            f"spaced samples over {time[-1] - time[0]:.1f} s"
        )
        return np.linspace(time[0], time[-1], len(time))
    low, high = 0.98 * period, 1.02 * period
    if uneven := np.count_nonzero((steps < low) | (steps > high)):
        repairs.append(
            f"time: {uneven} of {len(steps)} intervals outside {1e3 * low:.3g}-{1e3 * high:.3g} ms"
            f" (shortest {1e3 * steps.min():.3g}, longest {1e3 * steps.max():.3g} ms); "
            "kept, but derivatives take the samples as evenly spaced"
        )
    return time


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _resolution(steps: np.ndarray) -> float:
    """Returns the coarsest power of ten [s], from 1 s to 1 us, that divides all steps."""
    for digits in range(6):
        if np.allclose(steps, np.round(steps, digits), rtol=0.0, atol=1e-6):
            return 10.0**-digits
    return 1e-6


def _check_units(run: RecordedRun) -> None:
    """Compares how far the pose moves with what the velocity says, where they are largest."""
    for moved, velocity, entries, unit in MOTIONS:
        measured = np.linalg.norm(np.diff(run.pose[:, entries], axis=0), axis=1) / run.period
        stated = np.linalg.norm(run.body_velocity[1:, entries], axis=1)
        size = np.maximum(measured, stated)
        strong = size >= np.quantile(size, 0.75)  # Medians over these ignore wraps and resets.
        distance, speed = np.median(measured[strong]), np.median(stated[strong])
        if max(distance, speed) < STILL or distance < 3 * speed < 9 * distance:
            continue
        slow, fast = sorted((distance, speed))
        factor = fast / slow if slow > 0 else np.inf
        hint = [text for usual, text in UNIT_FACTORS.items() if 0.8 < factor / usual < 1.25]
        raise UserError(
            f"{moved} changes by {distance:.3g} per second where {velocity} says {speed:.3g}: "
            f"both must be recorded, in {unit}" + "".join(f" (looks like {text})" for text in hint)
        )


def _check_speed(run: RecordedRun, where: Callable[[int], str]) -> None:
    for row, entry in np.argwhere(np.abs(run.body_velocity) > FASTEST)[:1]:
        name, unit = (("vx", "m/s"), ("vy", "m/s"), ("yaw rate", "rad/s"))[entry]
        raise UserError(
            f"{where(row)}: {name} is {run.body_velocity[row, entry]:g}, more than the robot can "
            f"({FASTEST[entry]:g}): give it in {unit}"
        )


def _unwrapped(pose: np.ndarray, repairs: list[str]) -> np.ndarray:
    jumps = int(np.count_nonzero(np.abs(np.diff(pose[:, YAW])) > np.pi))
    if not jumps:
        return pose
    repairs.append(f"yaw: {_count(jumps, 'jump')} of a turn unwrapped")
    return np.column_stack([pose[:, :YAW], np.unwrap(pose[:, YAW])])


def _check_resets(run: RecordedRun, where: Callable[[int], str]) -> None:
    duration = np.maximum(np.diff(run.time), run.period)
    for moved, velocity, entries, _ in MOTIONS:
        step = np.linalg.norm(np.diff(run.pose[:, entries], axis=0), axis=1)
        speed = np.linalg.norm(run.body_velocity[:, entries], axis=1)
        around = np.maximum(speed[:-1], speed[1:])
        around[:-1] = np.maximum(around[:-1], speed[2:])
        allowed = 3 * around * duration + RESET_MARGIN[moved]
        for row in np.flatnonzero(step > allowed)[:1] + 1:
            unit = "rad" if moved == "yaw" else "m"
            raise UserError(
                f"{where(row)}: {moved} jumps by {step[row - 1]:.3g} {unit}, where {velocity} "
                f"allows {allowed[row - 1]:.2g} {unit} (odometry reset?): cut the recording there"
            )


def _check_frame(run: RecordedRun) -> None:
    """Compares the direction of motion with that of the velocity turned into the world frame."""
    turned = np.einsum("nij,nj->ni", rotation(run.pose[1:, YAW]), run.body_velocity[1:])
    for moved, velocity, entries, _ in MOTIONS:
        step, stated = np.diff(run.pose[:, entries], axis=0), turned[:, entries]
        length, speed = np.linalg.norm(step), np.linalg.norm(stated)
        moving = speed > STILL * np.sqrt(len(stated))
        if moving and np.sum(step * stated) < 0.5 * length * speed:
            raise UserError(
                f"{moved} moves in another direction than {velocity} says: the velocity must be "
                "in the body frame, x forward, y left, yaw counter-clockwise"
            )
