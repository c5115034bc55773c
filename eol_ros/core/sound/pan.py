# SPDX-License-Identifier: Apache-2.0
"""Where a grain sounds between the loudspeakers: equal power between neighbours."""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin


@njit(cache=True)
def pan(place, channels):
    """Return channel_a, channel_b and gain_a, gain_b (f4) for a `place` in -1..1.

    The loudspeakers stand in a row from left (-1) to right (1), evenly. Between two of them the
    gains are cosine and sine, so their squares sum to one; one loudspeaker alone gets all.
    """
    if channels == 1:
        return 0, 0, np.float32(1.0), np.float32(0.0)
    along = (min(max(place, -1.0), 1.0) + 1) / 2 * (channels - 1)
    left = min(int(along), channels - 2)
    angle = (along - left) * math.pi / 2
    gain = 0.0 if along - left == 1.0 else cos(angle)  # cos(pi / 2) is not quite zero
    return left, left + 1, np.float32(gain), np.float32(sin(angle))
