"""The tube of ``lagged_law``: what bounds the error of a lagging robot around its nominal plan.

The error of an axis is e = (position, velocity), in the robot's frame. Between samples

    e+ = turn (A e + B (r + q) + m w),   r = -K e,   |w| <= w_max,   |q| <= q_max,

where w is the innovation of the observer, how far the measured position is from the predicted one,
m w what the observer makes of it for the sample for which is planned, and q by how much the
velocity that the wheels are told misses the one asked for, as play and whole percents do. All are
of the robot's frame, so that none has to be turned but by the turn of that frame within one sample,
which mixes forward with sideways: e_x+ = c e_x + s e_y, e_y+ = c e_y - s e_x. Left out are products
of errors, and of the error of the yaw with a difference of two axes' lags.

Two shapes:

``modes``: a bound on the moduli of the error's coordinates in the eigenvectors T of A - B K. There
the recursion (4-19) is exact, |z|+ <= |lambda| |z| + |T^-1 m| w_max + |T^-1 B| q_max, and stays as
small as the eigenvalues allow, whereas |A - B K| of position and velocity may not even be stable.
Of the linear recursion above that is no approximation.

``ellipsoid``: P+ = (A - B K) P (A - B K)' + m m' w_max^2 + B B' q_max^2, the zero-order form of
Zanelli, Frey, Messerer, Diehl (2021), which adds up what independent disturbances do; a direction
c is backed off by gamma sqrt(c' P c). That holds with the probability that gamma stands for, not
always.
"""

import dataclasses as dc

import numpy as np
from scipy.linalg import block_diag

from mirte_drake.angles import rotation
from mirte_drake.control.lagged_axis import axis_model, observer_model
from mirte_drake.control.tube import rotated_bound
from mirte_drake.vectors import POSE_SIZE

X, Y = 0, 1  # Axes that a turn mixes.


@dc.dataclass(frozen=True)
class LaggedLoop:
    """What the tube of three axes consists of; arrays are not to be written to."""

    closed_loop: np.ndarray  # (3, 2, 2) A - B K.
    entry: np.ndarray  # (3, 2) m.
    command: np.ndarray  # (3, 2) B.

    @property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Moduli of the eigenvalues (3, 2), and their eigenvectors (3, 2, 2) as columns."""
        values, vectors = np.linalg.eig(self.closed_loop)
        return np.abs(values), vectors


def lagged_loop(
    lag: np.ndarray, period: float, feedback: np.ndarray, observer: np.ndarray, delay: int
) -> LaggedLoop:
    """Returns the closed loop of the error of a plan.

    Args:
        lag: (3,) [s]
        period: [s] T_s.
        feedback: (3, 2) K, see ``feedback_gains``.
        observer: (3, 3) L, see ``observer_gains``.
        delay: [samples] over which the state is predicted.
    """
    closed_loop, entry, command = [], [], []
    for tau, K, L in zip(lag, feedback, observer, strict=True):
        A, B = axis_model(tau, period)
        closed_loop.append(A - B @ K[None, :])
        ahead = np.linalg.matrix_power(observer_model(tau, period), delay)
        entry.append((ahead @ L)[:2])
        command.append(B[:, 0])
    return LaggedLoop(np.array(closed_loop), np.array(entry), np.array(command))


class ModeTube:
    """Bounds moduli in eigenvectors: widths zeta (3, 2); see the module."""

    def __init__(self, loop: LaggedLoop, missed: np.ndarray) -> None:
        """Prepares the recursion.

        Args:
            loop: The closed loop; its eigenvalues must differ axis by axis.
            missed: (3,) q_max [m/s, m/s, rad/s].
        """
        self._moduli, self._vectors = loop.modes
        self._inverse = np.linalg.inv(self._vectors)
        by_command = np.abs(np.einsum("aij,aj->ai", self._inverse, loop.command))
        self._by_innovation = np.abs(np.einsum("aij,aj->ai", self._inverse, loop.entry))
        self._by_command = by_command * missed[:, None]

    def start(self) -> np.ndarray:
        """Returns the widths (3, 2) of no error."""
        return np.zeros((POSE_SIZE, 2))

    def advance(self, widths: np.ndarray, turn: float, bound: np.ndarray) -> np.ndarray:
        """Returns the widths (3, 2) a sample later.

        Args:
            widths: (3, 2)
            turn: [rad] by which the robot turns within the sample.
            bound: (3,) w_max [m, m, rad] of the innovation that comes then.
        """
        widths = self._moduli * widths + self._by_innovation * bound[:, None] + self._by_command
        # What an axis does not take from itself: (cos - 1) of it, and sin of the other one.
        components = self.components(widths)
        more = (1.0 - np.cos(turn)) * components
        more[[X, Y]] += abs(np.sin(turn)) * components[[Y, X]]
        more[Y + 1 :] = 0.0
        return widths + np.einsum("aij,aj->ai", np.abs(self._inverse), more)

    def components(self, widths: np.ndarray) -> np.ndarray:
        """Returns the largest errors (3, 2) of position and velocity."""
        return np.einsum("aij,aj->ai", np.abs(self._vectors), widths)

    def support(self, widths: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Returns the largest |rows e| (3,) of each axis; rows (3, 2)."""
        return np.sum(np.abs(np.einsum("ai,aij->aj", rows, self._vectors)) * widths, axis=1)

    def box(self, widths: np.ndarray) -> np.ndarray:
        """Returns half-widths (3, 2) of a box of position and velocity within the tube."""
        box = self.components(widths)
        needed = np.einsum("aij,aj->ai", np.abs(self._inverse), box)
        share = np.min(np.where(needed > 0, widths / np.where(needed > 0, needed, 1), 1), axis=1)
        return share[:, None] * box


class EllipsoidTube:
    """Propagates a matrix P (6, 6), backed off by gamma; see the module."""

    def __init__(self, loop: LaggedLoop, missed: np.ndarray, gamma: float) -> None:
        """Prepares the recursion.

        Args:
            loop: The closed loop.
            missed: (3,) q_max [m/s, m/s, rad/s].
            gamma: [-] How many times the square root of c' P c is backed off.
        """
        self._closed_loop, self._gamma = block_diag(*loop.closed_loop), gamma
        command = block_diag(*(loop.command * missed[:, None])[:, :, None])
        self._by_innovation = block_diag(*loop.entry[:, :, None])
        self._by_command = command @ command.T

    def start(self) -> np.ndarray:
        """Returns the matrix (6, 6) of no error."""
        return np.zeros_like(self._by_command)

    def advance(self, P: np.ndarray, turn: float, bound: np.ndarray) -> np.ndarray:
        """Returns P (6, 6) a sample later; see ``ModeTube.advance``."""
        turned = np.kron(rotation(-turn), np.eye(2))
        pushed = self._by_innovation * bound
        following = self._closed_loop @ P @ self._closed_loop.T + pushed @ pushed.T
        return turned @ (following + self._by_command) @ turned.T

    def _by_axis(self, P: np.ndarray) -> np.ndarray:
        return np.stack([P[i : i + 2, i : i + 2] for i in range(0, len(P), 2)])

    def components(self, P: np.ndarray) -> np.ndarray:
        """Returns the back-offs (3, 2) of position and velocity."""
        return self._gamma * np.sqrt(np.diag(P)).reshape(POSE_SIZE, 2)

    def support(self, P: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Returns the back-offs (3,) of rows e of each axis; rows (3, 2)."""
        return self._gamma * np.sqrt(np.einsum("ai,aij,aj->a", rows, self._by_axis(P), rows))

    def box(self, P: np.ndarray) -> np.ndarray:
        """Returns half-widths (3, 2) of a box of position and velocity within each axis's ellipse.

        Its corners e have e' P^-1 e <= gamma^2: with the correlation r of position and velocity,
        a box of the ellipse's proportions shrinks by sqrt((1 - |r|) / 2).
        """
        by_axis = self._by_axis(P)
        deviations = np.sqrt(np.diagonal(by_axis, axis1=1, axis2=2))
        product = np.prod(deviations, axis=1)
        r = np.where(product > 0, np.abs(by_axis[:, 0, 1]) / np.where(product > 0, product, 1), 1)
        return self._gamma * np.sqrt(np.maximum(1 - r, 0) / 2)[:, None] * deviations


def box_of_state(box: np.ndarray, yaw: float) -> np.ndarray:
    """Returns half-widths (6,) in the coordinates of a LaggedModel's state of a box of the error.

    Positions lie in the world frame: there, the box that fits into the turned one is taken.

    Args:
        box: (3, 2) position and velocity by axis of the robot's frame.
        yaw: [rad] of the robot.
    """
    position = box[:, 0]
    around = rotated_bound(position, yaw)
    needed = rotated_bound(around, yaw)
    share = np.min(np.where(needed > 0, position / np.where(needed > 0, needed, 1), 1)[: Y + 1])
    around[: Y + 1] *= share
    return np.concatenate([around, box[:, 1]])


def input_room(
    tube: ModeTube | EllipsoidTube,
    widths: np.ndarray,
    gains: np.ndarray,
    nominal_velocity: np.ndarray,
    inverse: np.ndarray,
) -> np.ndarray:
    """Returns how much (4,) [pwm] the ancillary law may add to a nominal input within the tube.

    Args:
        tube: The tube.
        widths: Its state.
        gains: (3, 2) K.
        nominal_velocity: (3,) [m/s, m/s, rad/s] that the nominal input settles at; the law turns
            it by the error of the yaw.
        inverse: (4, 3) [pwm] wheels for a velocity.
    """
    added = tube.support(widths, gains)
    yaw_error = tube.components(widths)[Y + 1, 0]
    added[[X, Y]] += yaw_error * np.abs(nominal_velocity)[[Y, X]]
    return np.abs(inverse) @ added
