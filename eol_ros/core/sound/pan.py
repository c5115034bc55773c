# SPDX-License-Identifier: Apache-2.0
"""Where a grain sounds between the loudspeakers: equal power between neighbours."""

import numpy as np


def pan(place: np.ndarray, channels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return channel_a, channel_b (n,) i8 and gain_a, gain_b (n,) f4 for `place` (n,) in -1..1.

    The loudspeakers stand in a row from left (-1) to right (1), evenly. Between two of them the
    gains are cosine and sine, so their squares sum to one; one loudspeaker alone gets all.
    """
    place = np.clip(np.asarray(place, np.float64), -1.0, 1.0)
    if channels == 1:
        zeros = np.zeros(place.shape, np.int64)
        return zeros, zeros, np.ones(place.shape, np.float32), np.zeros(place.shape, np.float32)
    along = (place + 1) / 2 * (channels - 1)
    left = np.minimum(along.astype(np.int64), channels - 2)
    angle = (along - left) * np.pi / 2
    gain_a, gain_b = np.cos(angle), np.sin(angle)
    gain_a[along - left == 1.0] = 0.0  # cos(pi / 2) is not quite zero
    return left, left + 1, gain_a.astype(np.float32), gain_b.astype(np.float32)
