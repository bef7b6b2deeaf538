"""How far the robot moves from what its model says: the disturbance set of the tube.

The published procedure (4-21)-(4-26) takes delay, lag, gain and bias out of the model's velocity
and regresses what remains on the input rate. It fits the mean of abs(w), so it is no bound.
Beside it stand bounds on the one-step error (``one_step_bound``), each with its coverage.
"""

import dataclasses as dc

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter

from mirte_drake.checks import check_number
from mirte_drake.errors import UserError
from mirte_drake.identification.one_step_bound import (
    OneStepBound,
    conformal_bound,
    coverage,
    one_step_error,
    quantile_bound,
    time_blocks,
)
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.validation import validate_model
from mirte_drake.model.prediction_model import PredictionModel

AXES = ("vx", "vy", "yaw rate")
TRAINING_SHARE = 0.6  # Of the recording, at its beginning.
MAX_DELAY = 20  # [samples] A longer one is no actuator delay.
MAX_LAG_POLE = 0.9999  # Keeps the lag stable.
PUBLISHED_INPUT_RATE = 30.0  # [pwm_per_s] As put into (4-26); the controller's is per sample.


@dc.dataclass(frozen=True)
class VelocityCorrection:
    """Delay, first-order lag, gain and bias between model velocity and measurement, by axis."""

    delay_samples: np.ndarray  # (3,) integers.
    lag_pole: np.ndarray  # (3,) per sample: exp(-T_s / tau).
    gain: np.ndarray  # (3,)
    bias: np.ndarray  # (3,) [m/s, m/s, rad/s]

    def corrected(self, velocity: np.ndarray) -> np.ndarray:
        """Returns the corrected model velocity (N, 3), (4-21)-(4-23)."""
        columns = [
            _lagged(_delayed(velocity[:, i], self.delay_samples[i]), self.lag_pole[i])
            for i in range(len(self.gain))
        ]
        return self.gain * np.column_stack(columns) + self.bias


@dc.dataclass(frozen=True)
class PublishedBound:
    """Result of (4-24)-(4-26): abs(w) is about a + b * input rate; no bound, despite the name."""

    correction: VelocityCorrection
    residual: np.ndarray  # (validation samples, 3) w [m/s, m/s, rad/s].
    a: np.ndarray  # (3,) [m/s, m/s, rad/s]
    b: np.ndarray  # (3,) the same per [pwm_per_s].

    def w_max(self, input_rate: float = PUBLISHED_INPUT_RATE) -> np.ndarray:
        """Returns a + b * input_rate (3,) [m/s, m/s, rad/s], the rate in [pwm_per_s]; (4-26)."""
        return self.a + self.b * input_rate

    @property
    def share_outside(self) -> np.ndarray:
        """Share (3,) of the validation samples with abs(w) > w_max."""
        return np.mean(np.abs(self.residual) > self.w_max(), axis=0)


@dc.dataclass(frozen=True)
class DisturbanceEstimate:
    """What a recording says of a model's disturbance."""

    model: str
    source: str  # The recording.
    period: float  # [s] T_s.
    level: float  # Coverage that quantile and conformal bound aim at, by axis.
    published: PublishedBound
    one_step: tuple[OneStepBound, ...]  # published, quantile, conformal, maximum, ...


def estimate_disturbance(
    model: PredictionModel, run: RecordedRun, *, level: float = 0.95, integrator: str = "ode45"
) -> DisturbanceEstimate:
    """Estimates a model's disturbance from a recording.

    Args:
        model: The prediction model.
        run: The recording.
        level: Coverage, in (0, 1), that quantile and conformal bound aim at on each axis.
        integrator: Of the open-loop model velocity in the published procedure. The published
            numbers come from ``ode45``; ``zoh`` is exact.

    Raises:
        ValueError: when ``level`` or ``integrator`` is out of range.
        UserError: when the recording is too short, the model does not move in it or diverges.
    """
    check_number("level", level, above=0)
    if not level < 1:
        raise ValueError(f"level: must be < 1, got {level}")
    velocity = validate_model(model, run, integrator=integrator).body_velocity
    published = published_bound(velocity, run)
    calibration, held_out = time_blocks(one_step_error(model, run), run.period)
    boxes = {
        "published": published.w_max(),
        "quantile": quantile_bound(calibration, level),
        "conformal": conformal_bound(calibration, level),
        # Each axis at 1 - (1 - level) / 3, so that all three together hold at the level.
        "joint": conformal_bound(calibration, 1 - (1 - level) / calibration.shape[1]),
        "maximum": quantile_bound(calibration, 1.0),
    }
    one_step = tuple(coverage(name, box, held_out) for name, box in boxes.items())
    return DisturbanceEstimate(model.name, run.source, run.period, level, published, one_step)


def disturbance_summary(estimate: DisturbanceEstimate) -> dict[str, object]:
    """Returns the estimate as written to ``summary.json``, three entries each (vx, vy, yaw rate).

    The published figures, the share of samples outside w_max, and the one-step bounds with their
    held-out coverage.
    """
    published, correction = estimate.published, estimate.published.correction
    arrays = {
        "delay_samples": correction.delay_samples,
        "lag_pole": correction.lag_pole,
        "gain": correction.gain,
        "bias": correction.bias,
        "a": published.a,
        "b": published.b,
        "w_max": published.w_max(),
        "share_outside_w_max": published.share_outside,
    }
    return {name: array.tolist() for name, array in arrays.items()} | {
        "one_step": {
            bound.name: {"w": bound.w.tolist(), "coverage": bound.coverage.tolist()}
            for bound in estimate.one_step
        }
    }


def disturbance_text(estimate: DisturbanceEstimate) -> str:
    """Returns the estimate as text, which says plainly that the published value is no bound."""
    published, correction = estimate.published, estimate.published.correction
    per_sample = PUBLISHED_INPUT_RATE / estimate.period
    size = np.abs(published.residual)
    odd = (correction.lag_pole >= MAX_LAG_POLE) | (correction.gain <= 0)
    misfit = []
    if np.any(odd):
        axes = ", ".join(axis for axis, is_odd in zip(AXES, odd, strict=True) if is_odd)
        misfit = [f"  This correction does not fit the model ({axes}): go by the boxes below."]
    lines = [
        f"Disturbance of model {estimate.model}, from {estimate.source or 'a recording'}",
        _row("", AXES),
        "Model velocity to measurement, (4-21)-(4-23):",
        _row("delay [samples]", [f"{d:d}" for d in correction.delay_samples]),
        _row("lag pole per sample", [f"{p:.3f}" for p in correction.lag_pole]),
        _row("gain", [f"{g:.3f}" for g in correction.gain]),
        _row("bias [m/s, rad/s]", [f"{b:.4f}" for b in correction.bias]),
        *misfit,
        "Published procedure, abs(w) about a + b * input rate, (4-24)-(4-26):",
        _row("a [m/s, rad/s]", [f"{a:.4f}" for a in published.a]),
        _row("b [the same per PWM/s]", [f"{b:.1e}" for b in published.b]),
        _row("w_max [m/s, rad/s]", [f"{w:.4f}" for w in published.w_max()]),
        "  w_max is not a bound: it fits the mean of abs(w). Of the validation samples",
        _row("outside w_max", [f"{s:.0%}" for s in published.share_outside]),
        _row("95 % quantile of abs(w)", [f"{q:.3f}" for q in np.quantile(size, 0.95, axis=0)]),
        _row("maximum of abs(w)", [f"{q:.3f}" for q in np.max(size, axis=0)]),
        f"  It is for {PUBLISHED_INPUT_RATE:g} PWM/s. The controller's {PUBLISHED_INPUT_RATE:g} "
        f"PWM per sample are {per_sample:.0f} PWM/s:",
        _row("w_max at that rate", [f"{w:.4f}" for w in published.w_max(per_sample)]),
        "Boxes for the one-step error, the w of the tube [m/s, rad/s],",
        "and the share of held-out samples within, by axis and on all axes at once:",
    ]
    for bound in estimate.one_step:
        lines.append(_row(bound.name, [f"{w:.4f}" for w in bound.w]))
        shares = [f"{share:.1%}" for share in (*bound.coverage, bound.joint_coverage)]
        lines.append(_row("  within", shares))
    lines.append(
        f"Quantile and conformal bound aim at {estimate.level:.1%} of each axis, the joint one at"
    )
    lines.append("that of all axes at once. Errors correlated in time keep to it only nearly.")
    return "\n".join(lines)


def published_bound(model_velocity: np.ndarray, run: RecordedRun) -> PublishedBound:
    """Follows (4-21)-(4-26) from the model's velocity to a and b.

    Deviation: a and b are the non-negative least-squares solution; the program clips the
    unconstrained one, which is the same where that is not negative.

    Args:
        model_velocity: (N, 3) body velocity of the model at the rows of the recording.
        run: The recording.

    Raises:
        UserError: when the model velocity is constant in the training part of an axis.
    """
    split = round(TRAINING_SHARE * len(model_velocity))
    correction = fit_correction(model_velocity[:split], run.body_velocity[:split])
    residual = (run.body_velocity - correction.corrected(model_velocity))[split:]
    change = np.diff(run.wheel_command, axis=0, prepend=run.wheel_command[:1])
    input_rate = np.max(np.abs(change), axis=1)[split:] / run.period
    regressors = np.column_stack([np.ones_like(input_rate), input_rate])
    a, b = np.array([nnls(regressors, np.abs(w))[0] for w in residual.T]).T
    return PublishedBound(correction, residual, a, b)


def fit_correction(model_velocity: np.ndarray, measured: np.ndarray) -> VelocityCorrection:
    """Fits delay, lag, gain and bias one after the other, as the thesis's program does.

    The delay is where the cross-correlation is largest; the lag pole is the least-squares
    solution p of y_k - x_k = p (y_{k-1} - x_k); gain and bias are those of a straight line. So a
    part of a slow lag is taken for delay, and a gain other than 1 partly for lag.

    Deviation: delays from 0 to MAX_DELAY are tried; the program tries all, and fails where a
    negative one is best.

    Args:
        model_velocity: (N, 3)
        measured: (N, 3)

    Raises:
        UserError: when the model velocity is constant on an axis.
    """
    fits = []
    for axis, model, y in zip(AXES, model_velocity.T, measured.T, strict=True):
        if np.ptp(model) == 0:
            raise UserError(f"{axis}: the model's velocity is constant: record a drive that moves")
        delays = range(min(MAX_DELAY + 1, len(y) // 2))
        delay = int(np.argmax([_delayed(model, d) @ y for d in delays]))
        x = _delayed(model, delay)
        before, now = y[:-1] - x[1:], y[1:] - x[1:]
        energy = before @ before
        pole = np.clip(now @ before / energy, 0.0, MAX_LAG_POLE) if energy > 0 else 0.0
        line = np.column_stack([_lagged(x, pole), np.ones_like(y)])
        fits.append((delay, pole, *np.linalg.lstsq(line, y, rcond=None)[0]))
    delay, pole, gain, bias = np.array(fits).T
    return VelocityCorrection(delay.astype(int), pole, gain, bias)


def _delayed(x: np.ndarray, samples: int) -> np.ndarray:
    """Returns x later by whole samples; before its beginning the robot stood still."""
    return np.concatenate([np.zeros(samples), x[: len(x) - samples]])


def _lagged(x: np.ndarray, pole: float) -> np.ndarray:
    """Returns xi_k = p xi_{k-1} + (1 - p) x_k from xi_0 = x_0, which is (4-22).

    Row k's velocity acts over the sample before it, of which the measured one is the mean.
    """
    return lfilter([1 - pole], [1, -pole], x, zi=[pole * x[0]])[0]


def _row(label: str, values: list[str] | tuple[str, ...]) -> str:
    return f"  {label:<24}" + "".join(f"{value:>11}" for value in values)
