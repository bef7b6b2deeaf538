"""Disturbs the robot: a body velocity, held over each sample, drawn from a seeded sequence."""

import dataclasses as dc
import zipfile
from pathlib import Path

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.checks import check_array, check_number
from mirte_drake.errors import UserError


def _study_bound() -> np.ndarray:
    return np.array([0.04, 0.03, 0.09])


@dc.dataclass
class NoDisturbance:
    """The robot moves as its model says."""

    def validate(self) -> None:
        """Nothing can be out of range."""


@dc.dataclass
class UniformDisturbance:
    """Independent samples, uniform in the box [-bound, bound], as in the study."""

    bound: np.ndarray = dc.field(default_factory=_study_bound)  # (3,) [m/s, m/s, rad/s] w_max.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("bound", self.bound, (3,), minimum=0)


@dc.dataclass
class CornerDisturbance:
    """Worst-case samples: every component at +bound or -bound, signs drawn each sample."""

    bound: np.ndarray = dc.field(default_factory=_study_bound)  # (3,) [m/s, m/s, rad/s] w_max.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("bound", self.bound, (3,), minimum=0)


@dc.dataclass
class ConstantDisturbance:
    """The same body velocity all the time."""

    value: np.ndarray = dc.field(default_factory=_study_bound)  # (3,) [m/s, m/s, rad/s]

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("value", self.value, (3,))


@dc.dataclass
class RecordedDisturbance:
    """Samples from a file, one row per sample period; past its end they begin anew.

    The file is CSV with three columns vx, vy, yaw rate [m/s, m/s, rad/s], or the ``log.npz`` of
    a run, whose array ``disturbance`` is played again.
    """

    file: Path = Path("disturbance.csv")

    def validate(self) -> None:
        """Raises UserError when the file cannot be used."""
        self.samples()

    def samples(self) -> np.ndarray:
        """Returns the samples (rows, 3).

        Raises:
            UserError: when the file cannot be read, or has other content.
        """
        try:
            if self.file.suffix == ".npz":
                with np.load(self.file) as log:
                    samples = np.asarray(log["disturbance"], dtype=float)
            else:
                samples = np.loadtxt(self.file, delimiter=",", ndmin=2)
        except OSError as error:
            reason = error.strerror or error
            raise UserError(f"file: {self.file} cannot be read: {reason}") from None
        except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise UserError(
                f"file: {self.file} is neither three columns of numbers nor a log.npz: {error}"
            ) from None
        if samples.ndim != 2 or samples.shape[1] != 3 or len(samples) == 0:
            raise UserError(f"file: {self.file} must have rows of 3, got shape {samples.shape}")
        if not np.all(np.isfinite(samples)):
            raise UserError(f"file: {self.file} must have finite numbers only")
        return samples


DisturbanceConfig = (
    UniformDisturbance
    | CornerDisturbance
    | ConstantDisturbance
    | RecordedDisturbance
    | NoDisturbance
)


def disturbance_sample(config: DisturbanceConfig, seed: int, sample: int) -> np.ndarray:
    """Returns the disturbance (3,) of one sample, a function of its number and the seed alone.

    Drawn from a counter-based generator, so a Context needs no generator state, any sample can
    be recomputed, and another Context on the same Diagram changes nothing.
    """
    match config:
        case UniformDisturbance(bound):
            return bound * _generator(seed, sample).uniform(-1.0, 1.0, 3)
        case CornerDisturbance(bound):
            return bound * _generator(seed, sample).choice([-1.0, 1.0], 3)
        case ConstantDisturbance(value):
            return np.asarray(value, dtype=float)
        case NoDisturbance():
            return np.zeros(3)
    raise TypeError(f"no disturbance for {type(config).__name__}")


def _generator(seed: int, sample: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, sample]))


class DisturbanceSource(LeafSystem):
    """Gives the disturbance of each sample.

    .. pydrake_system::

        name: DisturbanceSource
        output_ports:
        - disturbance

    ===========  ===========  ==================  ======================================
    port         type         unit                meaning
    ===========  ===========  ==================  ======================================
    disturbance  vector (3,)  [m/s, m/s, rad/s]   w_k, body frame; a state, held for T_s
    ===========  ===========  ==================  ======================================

    The seed is a numeric parameter of the Context: many Contexts of one Diagram can run with
    different seeds.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: DisturbanceConfig, *, period: float, seed: int = 0) -> None:
        """Declares port, state and parameter.

        Args:
            config: Kind and size of the disturbance.
            period: [s] sample time T_s.
            seed: Seed >= 0 of the sequence.
        """
        super().__init__()
        config.validate()
        check_number("seed", seed, minimum=0, maximum=2**53)
        self._config, self._period = config, period
        self._recorded = config.samples() if isinstance(config, RecordedDisturbance) else None
        self._seed = self.DeclareNumericParameter(BasicVector([float(seed)]))
        self.DeclareStateOutputPort("disturbance", self.DeclareDiscreteState(3))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        sample = round(context.get_time() / self._period)
        if self._recorded is not None:
            next_state.set_value(self._recorded[sample % len(self._recorded)])
            return
        seed = int(context.get_numeric_parameter(int(self._seed)).GetAtIndex(0))
        next_state.set_value(disturbance_sample(self._config, seed, sample))


def AddDisturbanceSource(
    builder: DiagramBuilder,
    config: DisturbanceConfig,
    *,
    period: float,
    seed: int = 0,
    name: str = "disturbance_source",
) -> DisturbanceSource:
    """Adds a DisturbanceSource to ``builder``; the caller connects its port."""
    return builder.AddNamedSystem(name, DisturbanceSource(config, period=period, seed=seed))
