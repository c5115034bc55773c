# SPDX-License-Identifier: Apache-2.0
"""Descriptors made comparable: by rank, by deviation, and two numbers for all of them together."""

import itertools

import numpy as np

from eol_ros.core import elementary

SWEEPS = 30  # limit of Jacobi sweeps; ten descriptors take some seven
TINY = 1e-15  # covariance without rotation, relative to the largest variance


def ranked(values: np.ndarray) -> np.ndarray:
    """Return (n,) in 0..1: the share of the others that are smaller, ties taking the mean."""
    ordered = np.sort(values)
    low = np.searchsorted(ordered, values, 'left')
    high = np.searchsorted(ordered, values, 'right') - 1
    return (low + high) / (2 * max(len(values) - 1, 1)) if len(values) > 1 else np.full(1, 0.5)


def rank_shares(values: np.ndarray) -> np.ndarray:
    """Return `ranked` of what is known of `values` (n,); what is NaN lies in the middle."""
    known = np.isfinite(values)
    found = np.full(len(values), 0.5)
    found[known] = ranked(values[known])
    return found


def standardised(columns: list[np.ndarray], names: list[str]) -> np.ndarray:
    """Return descriptors side by side, each of mean 0 and deviation 1, (n, m).

    Frequencies are taken by their logarithm; what is missing is the mean; what is the same for all
    grains is left out.

    Examples
    --------
    >>> hz, same = np.array([100.0, 200.0, 400.0]), np.ones(3)
    >>> standardised([hz, same], ['pitch_hz', 'flatness']).round(3).tolist()
    [[-1.225], [0.0], [1.225]]
    """
    found = []
    for values, name in zip(columns, names, strict=True):
        v = (
            elementary.log2(np.maximum(values, 1.0))
            if name.endswith('_hz')
            else np.asarray(values, float)
        )
        known = np.isfinite(v)
        if not known.any() or np.ptp(v[known]) <= 1e-12 * np.abs(v[known]).max():
            continue
        v = np.where(known, v, v[known].mean())
        found.append((v - v.mean()) / v.std())
    return np.stack(found, axis=1) if found else np.zeros((len(columns[0]), 0))


def pca(matrix: np.ndarray) -> np.ndarray:
    """Return the first two principal components of the rows of `matrix` (n, m), (n, 2).

    The descriptor that weighs most in a component grows with it, so that a map does not turn over.

    Examples
    --------
    >>> line = np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0]])
    >>> pca(line).round(3).tolist()
    [[-1.414, 0.0], [0.0, 0.0], [1.414, 0.0]]
    """
    centred = matrix - matrix.mean(axis=0)
    axes = _principal(centred)[:2]
    axes = np.pad(axes, ((0, 2 - len(axes)), (0, 0)))
    if axes.shape[1]:
        strongest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1)
        axes = axes * np.where(strongest < 0, -1, 1)
    return np.stack([np.round((centred * axis).sum(axis=1), 12) for axis in axes], axis=1) + 0.0


def _principal(centred: np.ndarray) -> np.ndarray:
    """Return the eigenvectors (m, m) of the covariance of (n, m), by decreasing variance.

    Jacobi rotations (Golub and Van Loan, Matrix Computations, 8.5): LAPACK's last bits depend on
    the processor.
    """
    m = centred.shape[1]
    matrix = np.array([[(a * b).sum() for b in centred.T] for a in centred.T]).reshape(m, m)
    axes, least = np.eye(m), TINY * matrix.diagonal().max(initial=0.0)
    for _ in range(SWEEPS):
        for p, q in itertools.combinations(range(m), 2):
            if abs(matrix[p, q]) <= least:
                continue
            slope = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
            t = np.copysign(1.0 / (abs(slope) + np.sqrt(slope * slope + 1.0)), slope)
            cosine = 1.0 / np.sqrt(t * t + 1.0)
            sine = t * cosine
            for rows in (matrix, matrix.T, axes):
                rows[p], rows[q] = (
                    cosine * rows[p] - sine * rows[q],
                    sine * rows[p] + cosine * rows[q],
                )
    return axes[np.argsort(-matrix.diagonal(), kind='stable')]
