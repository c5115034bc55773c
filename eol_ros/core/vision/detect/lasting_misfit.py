# SPDX-License-Identifier: Apache-2.0
"""What of a misfit lasts: it moves no block from image to image, and is no part of its scatter.

An outline that fits worse than noise explains may be led by an arm, and its block with it: sigma is
enlarged by as much. But the rim's wall may stand before a block for as long as the table rests, and
a half-dark cover is never read well. They lead the block to the same place in every image.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.geometry import N_BLOCKS

MEAN_S = 20.0  # over which the misfit of a block is averaged, as motion's noise is
DOUBTED_S = 1.0  # of seeing it that it takes until half of a misfit counts as lasting


class LastingMisfit:
    """`lasting` (25,): share of each block's sigma in the last image that has lasted; 1 for none.

    Sigma over it is the scatter to be expected.
    """

    def __init__(self) -> None:
        self.lasting: np.ndarray = np.ones(N_BLOCKS)
        self.usual: np.ndarray = np.ones(N_BLOCKS)
        self.shown_s = np.zeros(N_BLOCKS)

    def renamed(self, others: np.ndarray) -> None:
        """Learn blocks `others` (25,) again: their ids mean other blocks now."""
        self.usual[others], self.shown_s[others] = 1.0, 0.0

    def learn(self, step_s: float, index: np.ndarray, blobs: np.ndarray) -> None:
        """Take `blobs` (n,), a BLOB array, and which of them each block is, (25,) or -1.

        step_s: since the image before.
        """
        _learn(step_s, index, blobs, self.usual, self.shown_s, self.lasting)


@njit(cache=True)
def _learn(step_s, index, blobs, usual, shown_s, lasting):
    step = min(max(step_s, 0.0), DOUBTED_S)
    for i in range(index.size):
        lasting[i] = 1.0
        if index[i] < 0:
            continue
        misfit = max(blobs[index[i]].misfit, 1.0)
        lasting[i] = min(misfit, usual[i])
        shown_s[i] = min(shown_s[i] + step, MEAN_S)
        usual[i] += step / (DOUBTED_S + shown_s[i]) * (misfit - usual[i])
