"""A convex quadratic program that is solved again and again, by DAQP."""

import daqp
import numpy as np

PRIMAL_TOLERANCE = 1e-9  # Of a constraint, in its unit.
SOLVED = 1  # DAQP's exit flag.


class QuadraticProgram:
    """min z' H z / 2 + g' z with bounds on [z; A z]; A is given once."""

    def __init__(self, A: np.ndarray) -> None:
        """Makes the workspace for A (rows, size)."""
        size, rows = A.shape[1], A.shape[1] + len(A)
        self._inactive = np.zeros(rows, dtype=np.int32)
        self._active: np.ndarray | None = self._inactive
        self._hessian: np.ndarray | None = None
        self._daqp = daqp.Model()
        self._daqp.setup(np.eye(size), np.zeros(size), A, np.full(rows, 1e30), np.full(rows, -1e30))
        self._daqp.settings = {"primal_tol": PRIMAL_TOLERANCE}

    def forget(self) -> None:
        """Makes the next solve begin without the active set of the last one."""
        self._active = self._inactive

    def set_hessian(self, hessian: np.ndarray) -> None:
        """Factorises a Hessian H (size, size), unless it is the one that already is.

        Raises:
            ValueError: when it is not positive definite.
        """
        if hessian is self._hessian:
            return
        self._hessian = None
        if self._daqp.update(H=hessian) != 0:
            raise ValueError("Hessian is not positive definite")
        self._hessian = hessian

    def solve(
        self, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Returns the solution, by how much it lowers the cost below that at 0, the multipliers.

        Args:
            gradient: (size,) g.
            lower: (size + rows,) bounds on [z; A z].
            upper: (size + rows,)

        Raises:
            ValueError: when there is no solution.
        """
        flag = self._daqp.update(f=gradient, bupper=upper, blower=lower, sense=self._active)
        self._active = None  # DAQP's own, from now on.
        if flag == 0:
            z, value, flag, info = self._daqp.solve()
        if flag != SOLVED:
            raise ValueError(f"quadratic program not solved: DAQP's exit flag is {flag}")
        return z, -value, info["lam"]
