# SPDX-License-Identifier: Apache-2.0
"""Metres from nothing but the blocks: squares of a known side, at rest on their lattice.

Until all blocks have rested for a moment, lengths come from the size of the squares alone; that is
good enough to tell neighbours, not to publish. Then the camera is solved from the corners of all
covers, and refused where the blocks do not lie on their lattice.
"""

import numpy as np

from eol_ros.core.vision.appearance.squares import SQUARE
from eol_ros.core.vision.calibration.calibrate import from_squares
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from eol_ros.said import clauses, said

IMAGES = 20  # still ones, all blocks seen
MOST_MM = 6.0  # RMS departure of resting blocks from the lattice that is still believed
RETRY_IMAGES = 120  # images to wait after a refusal: solving takes a while


class SelfCalibration:
    """Collects still images until a calibration can be made; `why` says what it waits for."""

    def __init__(self, start: Calibration):
        self.start = start
        self.images = 0
        self.total = np.zeros((0, 0), np.float32)
        self.note: str = ''  # what a person should know of a calibration that is good
        self.wait = 0
        self.refused = False
        self.why: str = said('must_rest')

    def add(self, image: np.ndarray, squares: np.ndarray | None) -> Calibration | None:
        """Take an image (h, w) uint8 with its squares, a SQUARE array in order of id.

        None when not all blocks are seen whole and at rest. Returns the calibration once.
        """
        self.wait = max(self.wait - 1, 0)
        if squares is None or self.wait:
            self.images = 0
            return None
        if not self.images:
            self.total = np.zeros(image.shape, np.float32)
        self.total += image
        self.images += 1
        if self.images < IMAGES:
            return None
        mean = np.rint(self.total / IMAGES).astype(np.uint8)
        self.images, self.wait, self.refused = 0, RETRY_IMAGES, True
        squares = np.ascontiguousarray(squares, SQUARE)
        try:
            solution = from_squares([(mean, squares)], self.start)
        except ConfigError as error:
            self.why = str(error)
            return None
        found = solution.calibration
        place = found.to_table(np.column_stack([squares['u'], squares['v']]))
        rest = found.table.rest[found.table.ids]
        off_mm = float(np.sqrt(((place - rest) ** 2).mean()) * 1e3)
        if off_mm > MOST_MM:
            self.why = said('off_lattice', mm=f'{off_mm:.1f}')
        elif solution.refusal():
            self.why = solution.refusal()
        else:
            known = said('known_to', mm=f'{solution.platform_mm:.1f}')
            self.refused, self.note = False, clauses([known, solution.note])
            return found
        return None
