# SPDX-License-Identifier: Apache-2.0
"""Where each block rests while its fellows do.

The edge of an arm leads a block of which only a part agrees, by so little from image to image that
it is always close to where it was just now. From where it rested it goes away.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import hypot
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.calibration.mapping import to_pixel

WELL = 0.75  # share of an outline, from which on no arm leads a block
MOVES_M, FELLOWS = 1e-3, 2  # where so many that are seen well leave their homes by more, all may
AT_HOME_S = 0.1  # for so long a block has been seen at its home when that is known
MEAN_S = 0.5  # over which a home is averaged, and for so long it is known of a hidden block


class Homes:
    """`xy` (25, 2) m, and for how long each block has been seen there, `shown_s` (25,)."""

    def __init__(self) -> None:
        self.xy, self.shown_s = np.zeros((N_BLOCKS, 2)), np.zeros(N_BLOCKS)

    def renamed(self, others: np.ndarray) -> None:
        """Learn blocks `others` (25,) again: their ids mean other blocks now."""
        self.shown_s[others] = 0.0

    def learn(
        self, step_s: float, xy: np.ndarray, seen: np.ndarray, visibility: np.ndarray
    ) -> None:
        """Take where blocks are, xy (25, 2) m, and which share of those `seen` (25,) is in sight.

        step_s: since the image before.
        """
        _learn(step_s, xy, seen, visibility, self.xy, self.shown_s)

    def expected(self, calibration: np.ndarray, found: np.ndarray) -> None:
        """Fill found (25, 2): u, v of the homes, NaN where none is known."""
        _expected(calibration, self.xy, self.shown_s, found)


@njit(cache=True)
def _learn(step_s, xy, seen, visibility, home, shown_s):
    step = min(max(step_s, 0.0), MEAN_S)
    leave = 0
    for i in range(N_BLOCKS):
        away = hypot(xy[i, 0] - home[i, 0], xy[i, 1] - home[i, 1]) > MOVES_M
        if seen[i] and visibility[i] >= WELL and away:
            leave += shown_s[i] > 0.0
            shown_s[i] = 0.0
    for i in range(N_BLOCKS):
        if not seen[i]:
            shown_s[i] = max(shown_s[i] - step, 0.0)
        if leave >= FELLOWS:
            shown_s[i] = 0.0
        if seen[i]:
            part = step / MEAN_S if shown_s[i] > 0.0 else 1.0
            for k in range(2):
                home[i, k] += part * (xy[i, k] - home[i, k])
            shown_s[i] = min(shown_s[i] + step, MEAN_S)


@njit(cache=True)
def _expected(calibration, home, shown_s, found):
    for i in range(N_BLOCKS):
        found[i, 0] = found[i, 1] = math.nan
        if shown_s[i] >= AT_HOME_S:
            found[i, 0], found[i, 1] = to_pixel(calibration, home[i, 0], home[i, 1])
