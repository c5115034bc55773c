# SPDX-License-Identifier: Apache-2.0
"""How bright each block is: by that one is known again of which an arm leaves half in sight.

A mean over the images that show nearly all of a block, so that a flash, which is soon over, counts
for little: an arm may hide the block for long just after. A camera's exposure changes all of them
alike, the hidden ones too.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.geometry import N_BLOCKS

NEARLY_WHOLE = 0.6  # from here on a block's brightness is taken,
MEAN_S = 2.0  # and averaged over so long
FELLOWS = 4  # blocks that tell how a camera's exposure has changed


class Brightness:
    """Contrast (25,) in grey levels of each block at an `exposure` of 1; 0: not known."""

    def __init__(self) -> None:
        self.contrast, self.exposure = np.zeros(N_BLOCKS), 1.0
        self.looks: np.ndarray = np.zeros(N_BLOCKS, np.int64)

    def renamed(self, others: np.ndarray) -> None:
        """Learn blocks `others` (25,) again: their ids mean other blocks now."""
        self.contrast[others], self.looks[others] = 0.0, 0

    def learn(
        self, step_s: float, seen: np.ndarray, visibility: np.ndarray, contrast: np.ndarray
    ) -> None:
        """Take the contrast (25,) and visible share (25,) of blocks that are seen (25,).

        step_s: since the image before.
        """
        self.exposure = _learn(
            step_s, seen, visibility, contrast, self.contrast, self.looks, self.exposure
        )


@njit(cache=True)
def _learn(step_s, seen, visibility, contrast, known, looks, exposure):
    ratio = np.empty(known.size)
    n = 0
    for i in range(known.size):
        if seen[i] and visibility[i] > NEARLY_WHOLE and known[i] > 0.0:
            ratio[n] = contrast[i] / known[i]
            n += 1
    if n >= FELLOWS:
        exposure = np.median(ratio[:n])
    least = min(max(step_s, 0.0), MEAN_S) / MEAN_S
    for i in range(known.size):
        if seen[i] and visibility[i] > NEARLY_WHOLE:
            looks[i] += 1
            known[i] += max(least, 1.0 / looks[i]) * (contrast[i] / exposure - known[i])
    return exposure
