"""The discrete algebraic Riccati equation by structure-preserving doubling, compiled."""

import numpy as np

from mirte_drake.compiled import compiled

MAX_DOUBLINGS = 60
CONVERGED = 1e-14  # Relative change of P.


@compiled
def _product(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Returns X Y; for such small matrices faster than a library's."""
    Z = np.zeros((X.shape[0], Y.shape[1]))
    for i in range(X.shape[0]):
        for k in range(X.shape[1]):
            for j in range(Y.shape[1]):
                Z[i, j] += X[i, k] * Y[k, j]
    return Z


@compiled
def solve_linear(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Returns X^-1 Y by elimination with pivoting; numba takes 10 s to compile numpy's."""
    X, Z, n = X.copy(), Y.copy(), len(X)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(X[i, k]) > abs(X[pivot, k]):
                pivot = i
        for j in range(n):
            X[k, j], X[pivot, j] = X[pivot, j], X[k, j]
        for j in range(Z.shape[1]):
            Z[k, j], Z[pivot, j] = Z[pivot, j], Z[k, j]
        for i in range(n):
            if i != k:
                factor = X[i, k] / X[k, k]
                for j in range(k, n):
                    X[i, j] -= factor * X[k, j]
                for j in range(Z.shape[1]):
                    Z[i, j] -= factor * Z[k, j]
    for k in range(n):
        for j in range(Z.shape[1]):
            Z[k, j] /= X[k, k]
    return Z


@compiled
def _largest(X: np.ndarray) -> float:
    """Returns the largest magnitude, or NaN where there is one."""
    result = 0.0
    for value in X.flat:
        if np.isnan(value):
            return np.nan
        result = max(result, abs(value))
    return result


@compiled
def is_positive_definite(matrix: np.ndarray) -> bool:
    """Tells whether the symmetric part of a matrix is, by its Cholesky factorisation."""
    L = np.zeros(matrix.shape)
    for i in range(len(matrix)):
        for j in range(i + 1):
            rest = 0.5 * (matrix[i, j] + matrix[j, i])
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = rest / L[j, j]
            elif rest > 0.0:
                L[i, i] = np.sqrt(rest)
            else:  # Not positive, or not a number.
                return False
    return True


@compiled
def solve_dare(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, bool]:
    """Returns K (m, n), P (n, n), the relative residual of (4-13), and whether all is sound.

    That is: the weights are symmetric and positive definite, and A - B K is stable.

    A doubling step (Chu, Fan, Lin, Wang 2004) squares the number of samples that P covers.
    Stability is proven, not assumed: P and P - (A - B K)' P (A - B K) must be positive definite
    (Lyapunov).
    """
    P, F, G, identity = Q.copy(), A.copy(), _product(B, solve_linear(R, B.T.copy())), np.eye(len(A))
    for _ in range(MAX_DOUBLINGS):
        W = identity + _product(G, P)
        F_W = solve_linear(W, F)
        change = _product(F.T.copy(), _product(P, F_W))
        G += _product(F, _product(solve_linear(W, G), F.T.copy()))
        F = _product(F, F_W)
        P += change
        if not _largest(change) > CONVERGED * _largest(P):
            break
    P_B = _product(P, B)
    K = solve_linear(R + _product(B.T.copy(), P_B), _product(P_B.T.copy(), A))
    closed_loop = A - _product(B, K)
    P_closed_loop = _product(P, closed_loop)
    residual = _product(A.T.copy(), P_closed_loop) + Q - P
    decrease = P - _product(closed_loop.T.copy(), P_closed_loop)
    sound = is_positive_definite(P) and is_positive_definite(decrease)
    sound = sound and _largest(Q - Q.T) == 0.0 and is_positive_definite(Q)
    sound = sound and _largest(R - R.T) == 0.0 and is_positive_definite(R)
    return K, P, _largest(residual) / _largest(P), sound
