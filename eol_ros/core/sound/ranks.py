# SPDX-License-Identifier: Apache-2.0
"""Descriptors made comparable: by rank."""

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
