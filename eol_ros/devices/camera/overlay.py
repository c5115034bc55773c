# SPDX-License-Identifier: Apache-2.0
"""What the tracker sees, drawn over the images: a video, or the last image alone."""

from pathlib import Path

import cv2
import numpy as np

from eol_ros.core.table import Table
from eol_ros.core.vision.states import STATES, TRACKING
from eol_ros.core.vision.tracker import Tracked
from eol_ros.devices.files import picture_file
from eol_ros.devices.files.names import is_text
from eol_ros.errors import ConfigError

SEEN, CARRIED, MOVING, TEXT = (120, 230, 120), (90, 150, 240), (255, 255, 255), (230, 230, 230)
FINE = 4  # bits of sub-pixel that OpenCV draws with


class Overlay:
    """Draws and writes; the ending of `path` says video (.mp4, .avi) or image (.png, .jpg)."""

    def __init__(self, path: str, fps: float, shape: tuple[int, ...], table: Table):
        self.path, self._table = path, table
        ending = Path(path).suffix.lower()
        self.film = None
        self.last: np.ndarray | None = None
        if ending in ('.mp4', '.avi', '.mkv'):
            if not is_text(path):
                raise ConfigError(f'{path}: the name of a video must be UTF-8')
            code = cv2.VideoWriter.fourcc(*('MJPG' if ending == '.avi' else 'mp4v'))
            self.film = cv2.VideoWriter(path, code, fps or 60.0, (shape[1], shape[0]))
            if not self.film.isOpened():
                raise ConfigError(f'{path}: cannot write a video there')
        elif ending not in ('.png', '.jpg', '.jpeg'):
            raise ConfigError(f'{path}: an overlay is .mp4 or .avi, or an image: .png, .jpg')

    def add(
        self,
        image: np.ndarray,
        tracked: Tracked,
        moving: np.ndarray,
        side_px: float,
        theta: np.ndarray,
    ) -> None:
        """Take one image (h, w) uint8 and what was made of it; moving (cells,) bool.

        theta: (cells,) angle of each block in the image, counter-clockwise.
        """
        self.last = draw(image, tracked, moving, side_px, theta, self._table)
        if self.film is not None:
            self.film.write(self.last)

    def close(self) -> None:
        """Finish the file."""
        if self.film is not None:
            self.film.release()
        elif self.last is not None:
            picture_file.save(self.path, self.last)


def draw(
    image: np.ndarray,
    tracked: Tracked,
    moving: np.ndarray,
    side_px: float,
    theta: np.ndarray,
    table: Table,
) -> np.ndarray:
    """Return `image` in colour with squares, ids and state on it."""
    # Darker than the original, so that what is drawn stands out from the lit covers.
    picture = cv2.cvtColor((image * np.float32(0.6)).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    half = side_px / 2 if side_px > 0 else 545.0 * table.block_side_m / 2
    for block in table.ids.tolist():
        u, v = tracked.px[block]
        if not np.isfinite(u):
            continue
        seen = bool(tracked.seen[block])
        colour = MOVING if seen and moving[block] else SEEN if seen else CARRIED
        turn = theta[block] + np.pi / 4 + np.arange(4) * np.pi / 2
        reach = half * np.sqrt(2) * (1.0 if seen else 0.8)
        corners = np.column_stack([u + reach * np.cos(turn), v - reach * np.sin(turn)])
        points = np.round(corners * 2**FINE).astype(np.int32)
        cv2.polylines(picture, [points], True, colour, 2 if seen else 1, cv2.LINE_AA, FINE)
        picture_file.write_text(picture, str(block), (int(u) - 9, int(v) + 6), colour)
    words = STATES[tracked.state]
    if tracked.symmetry_ambiguous and tracked.state == TRACKING:
        words += ', turn open'
    count = int(tracked.seen.sum())
    words = f'{tracked.stamp_s:9.3f} s  {words}  {count}/{table.count}'
    picture_file.write_text(picture, words, (12, 26), TEXT)
    if tracked.why:
        picture_file.write_text(picture, tracked.why, (12, 52), TEXT)
    return picture
