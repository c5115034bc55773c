# SPDX-License-Identifier: Apache-2.0
"""Descriptors made comparable: by rank, by deviation, and two numbers for all of them together."""

import numpy as np


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
        v = np.log2(np.maximum(values, 1.0)) if name.endswith('_hz') else np.asarray(values, float)
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
    axes = np.linalg.svd(centred, full_matrices=False)[2][:2]
    axes = np.pad(axes, ((0, 2 - len(axes)), (0, 0)))
    if axes.shape[1]:
        strongest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1)
        axes = axes * np.where(strongest < 0, -1, 1)
    return np.round(centred @ axes.T, 12) + 0.0
