# SPDX-License-Identifier: Apache-2.0
"""Linear algebra of small matrices with the same bits on every machine.

BLAS and LAPACK choose their order of summation by the processor. These functions add in a fixed
order. They are meant for some ten rows. `solve` is Gaussian elimination with partial pivoting
(Golub and Van Loan, Matrix Computations, 3.4).
"""

import numpy as np

from eol_ros.core import elementary

NEWTON_STEPS = 6  # three steps from Tricomi's first guess reach the last bit


def matmul(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of (n, k) and (k, m), or (k,): (n, m) or (n,)."""
    b = np.asarray(b)
    if b.ndim == 1:
        return (np.asarray(a) * b).sum(axis=-1)
    return (np.asarray(a)[:, :, None] * b[None]).sum(axis=1)


def solve(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return x with a x = b; a (n, n), b (n,) or (n, m). Raises LinAlgError if a is singular."""
    n = len(a)
    rows = np.column_stack([a, b]).astype(float)
    for k in range(n):
        pivot = k + int(np.argmax(abs(rows[k:, k])))
        if not rows[pivot, k]:
            raise np.linalg.LinAlgError('a singular matrix has no inverse')
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k] /= rows[k, k]
        for other in range(n):
            if other != k:
                rows[other] -= rows[other, k] * rows[k]
    return rows[:, n] if np.ndim(b) == 1 else rows[:, n:]


def inverse(a: np.ndarray) -> np.ndarray:
    """Return the inverse of a (n, n). Raises LinAlgError if it has none."""
    return solve(a, np.eye(len(a)))


def least_squares(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return x (k, m) that minimises |a x - b|, a (n, k), b (n, m), by the normal equations.

    Nearly dependent columns of `a` cost half the digits.
    """
    turned = np.asarray(a).T
    return solve(matmul(turned, a), matmul(turned, b))


def norm(a: np.ndarray) -> float:
    """Return the length of a vector (n,)."""
    return float(np.sqrt((a * a).sum()))


def gauss_legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights (n,) on -1..1 of the Gauss-Legendre rule, n >= 1.

    Newton's method on the Legendre polynomial (Press et al., Numerical Recipes, 4.6).
    """
    x = -elementary.cos(np.pi * (np.arange(n) + 0.75) / (n + 0.5))
    for _ in range(NEWTON_STEPS):
        value, slope = _legendre(n, x)
        x = x - value / slope
    slope = _legendre(n, x)[1]
    return x, 2.0 / ((1.0 - x * x) * slope * slope)


def _legendre(n: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Legendre polynomial of degree n and its derivative at `x` within -1..1."""
    before, value = np.zeros_like(x), np.ones_like(x)
    for k in range(n):
        before, value = value, ((2 * k + 1) * x * value - k * before) / (k + 1)
    return value, n * (x * value - before) / (x * x - 1.0)
