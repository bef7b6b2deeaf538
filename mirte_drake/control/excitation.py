"""The wheel commands that excite a robot for identification: algorithm 1, as a pure function.

It stands here and not in ``identification``, because a system plays it on the robot and systems
know ``control`` only.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.checks import check_number
from mirte_drake.control.reference_paths import slew
from mirte_drake.sampling import sample_number

# Signs of u1..u4 that move along one axis, by (2-2): x, y, yaw.
MODES = np.array([[1, 1, 1, 1], [-1, 1, -1, 1], [-1, 1, 1, -1]])
# Signs of the patterns and of their opposites: the modes, the diagonals, a turn about one side.
PATTERNS = np.vstack([MODES, [[1, 0, 1, 0], [0, 1, 0, 1], [1, 0, 0, 1], [0, 1, 1, 0]]])
PATTERNS = np.vstack([PATTERNS, -PATTERNS])


@dc.dataclass
class ExcitationConfig:
    """Settings of algorithm 1; the defaults are the thesis's."""

    duration: float = 120.0  # [s] T.
    control_interval: float = 0.3  # [s] Delta t, between changes of the command.
    template_interval: float = 1.0  # [s] Delta t_u, rounded up to whole control intervals.
    # [s] The algorithm says 60 s, half of T; the text above it 75 %.
    random_duration: float = 60.0
    min_magnitude: float = 30.0  # [pwm] Of a wheel in a random template.
    max_magnitude: float = 100.0  # [pwm] The same; |u_max|.
    pattern_magnitude: float = 50.0  # [pwm] Of every turning wheel in a pattern.
    max_change: float = 20.0  # [pwm] |Delta u_max|, of a wheel in one control interval.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("control_interval", self.control_interval, above=0)
        check_number("template_interval", self.template_interval, minimum=self.control_interval)
        check_number("duration", self.duration, minimum=self.template_interval)
        check_number("random_duration", self.random_duration, minimum=0, maximum=self.duration)
        check_number("max_magnitude", self.max_magnitude, above=0, maximum=100)
        check_number("min_magnitude", self.min_magnitude, minimum=0, maximum=self.max_magnitude)
        check_number("pattern_magnitude", self.pattern_magnitude, above=0, maximum=100)
        check_number("max_change", self.max_change, above=0)


def template_targets(config: ExcitationConfig, seed: int) -> np.ndarray:
    """Returns the commands that the wheels are slewed to, one row per control interval.

    Random templates pass through x, y and yaw in a new random order every three, so that none is
    ahead by more than one; direction and each wheel's magnitude are random. Patterns pass through
    their list likewise.

    Deviation: the end aims at rest, so that the wheels stop within the slew limit; the thesis's
    program cuts them off.

    Args:
        config: Settings.
        seed: Seed >= 0.

    Returns:
        (intervals, 4) ubar [pwm].

    Raises:
        ValueError: when ``config`` or ``seed`` is out of range.
    """
    config.validate()
    check_number("seed", seed, minimum=0)
    generator = np.random.default_rng(seed)
    intervals = _intervals(config.duration, config.control_interval)
    per_template = _intervals(config.template_interval, config.control_interval)
    templates = _intervals(intervals, per_template)
    start = config.control_interval * per_template * np.arange(templates)
    num_random = int(np.count_nonzero(start < config.random_duration - 1e-9))

    mode = _shuffled_rounds(generator, len(MODES), num_random)
    direction = generator.choice([-1, 1], (num_random, 1))
    magnitude = generator.uniform(config.min_magnitude, config.max_magnitude, (num_random, 4))
    pattern = _shuffled_rounds(generator, len(PATTERNS), templates - num_random)
    targets = np.vstack(
        [direction * magnitude * MODES[mode], config.pattern_magnitude * PATTERNS[pattern]]
    )
    targets = np.repeat(targets, per_template, axis=0)[:intervals]
    largest = max(config.max_magnitude, config.pattern_magnitude)
    targets[max(0, intervals - _intervals(largest, config.max_change)) :] = 0.0
    return targets


def excitation(config: ExcitationConfig, seed: int, period: float) -> np.ndarray:
    """Returns the excitation of algorithm 1, sampled.

    Args:
        config: Settings.
        seed: Seed >= 0; the same seed gives the same commands, at any period.
        period: [s] sample time; it need not divide the control interval.

    Returns:
        (N, 4) wheel commands [pwm]; row k holds from k times the period, until T.

    Raises:
        ValueError: when ``config``, ``seed`` or ``period`` is out of range.
    """
    check_number("period", period, above=0)
    commands = template_targets(config, seed)
    command = np.zeros(4)
    for k, target in enumerate(commands):
        command = commands[k] = slew(command, target, config.max_change)
    time = period * np.arange(_intervals(config.duration, period))
    return commands[sample_number(time, config.control_interval)]


def _intervals(duration: float, interval: float) -> int:
    """Returns how many intervals cover a duration, forgiving round-off."""
    return int(np.ceil(duration / interval - 1e-6))


def _shuffled_rounds(generator: np.random.Generator, size: int, count: int) -> np.ndarray:
    """Returns ``count`` indices below ``size``: all of them in random order, again and again."""
    rounds = [generator.permutation(size) for _ in range(_intervals(count, size))]
    return np.concatenate([np.zeros(0, dtype=int), *rounds])[:count]
