# SPDX-License-Identifier: Apache-2.0
"""The lens and the table from images of a ChArUco board (Garrido-Jurado et al. 2014, OpenCV)."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.calibrate import Solution, from_points, nominal
from eol_ros.errors import ConfigError

_LEAST_CORNERS = 8
_LENS_VIEWS = 5  # fewer views of a flat board cannot tell focal length from tilt


@dataclass(frozen=True)
class Board:
    """A printed ChArUco board; sizes in metres, `x_m`, `y_m`: the table place of its centre."""

    columns: int = 11
    rows: int = 8
    square_m: float = 0.06
    marker_m: float = 0.045
    dictionary: str = 'DICT_4X4_100'
    x_m: float = 0.0
    y_m: float = 0.0

    def made(self) -> cv2.aruco.CharucoBoard:
        """Return the OpenCV board.

        Raises:
            ConfigError: unknown dictionary, or sizes that make no board.
        """
        number = getattr(cv2.aruco, self.dictionary, None)
        if number is None:
            raise ConfigError(
                f'{self.dictionary!r} is not an ArUco dictionary; DICT_4X4_100 is one'
            )
        if not 0 < self.marker_m < self.square_m or min(self.columns, self.rows) < 3:
            raise ConfigError(
                'a board needs at least 3x3 squares, and markers smaller than its squares'
            )
        dictionary = cv2.aruco.getPredefinedDictionary(number)
        markers, wanted = len(dictionary.bytesList), self.columns * self.rows // 2
        if wanted > markers:
            raise ConfigError(
                f'a board of {self.columns}x{self.rows} needs {wanted} markers, and '
                f'{self.dictionary} has {markers}: take fewer squares, or another dictionary'
            )
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square_m, self.marker_m, dictionary
        )

    def picture(self, px_per_square: int = 200) -> np.ndarray:
        """Return the board as an image (h, w) uint8 to print, with a white margin."""
        size = (self.columns + 1) * px_per_square, (self.rows + 1) * px_per_square
        return self.made().generateImage(size, marginSize=px_per_square // 2)


def find(image: np.ndarray, board: Board, mirror: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (n, 2) px and their ids (n,) of the board in an 8-bit grey image.

    With `mirror` the board is read as in a mirror; a marker seen so is no marker otherwise.
    """
    if mirror:
        px, ids = find(cv2.flip(image, 1), board)
        return px * [-1.0, 1.0] + [image.shape[1] - 1.0, 0.0], ids
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board.made()).detectBoard(image)
    if ids is None:
        return np.zeros((0, 2)), np.zeros(0, int)
    return corners.reshape(-1, 2).astype(float), ids.ravel()


def from_board(
    images: list[np.ndarray],
    board: Board,
    cover_height_m: float = 0.0,
    focal_px: float | None = None,
    mirror: bool = False,
    table: Table | None = None,
) -> Solution:
    """Calibrate on images of a board.

    In the first one it lies flat on the platform, its rows along x, its centre at (x_m, y_m). With
    four or more others, held at all angles, the lens is solved too. mirror: the camera sees the
    board in a mirror.

    Raises:
        ConfigError: the board is not seen in the first image, or seen there with a mirror where
            there should be none, or the reverse, or images of different size.
    """
    shapes = {image.shape for image in images}
    if len(shapes) != 1:
        raise ConfigError(f'images of different sizes: {sorted(shapes)}')
    height, width = images[0].shape
    made = board.made()
    grid = np.asarray(made.getChessboardCorners(), float)[:, :2]
    views = []
    for number, image in enumerate(images):
        px, ids = find(image, board, mirror)
        if len(ids) >= _LEAST_CORNERS:
            views.append((px, ids))
        elif number == 0 and len(find(image, board, not mirror)[1]) >= _LEAST_CORNERS:
            raise ConfigError(
                'the first image shows the board '
                + (
                    'directly, not in a mirror: leave out --mirror'
                    if mirror
                    else 'in a mirror: add --mirror if the camera looks through one'
                )
            )
        elif number == 0:
            raise ConfigError(
                f'the first image shows {len(ids)} corners of the board, '
                f'{_LEAST_CORNERS} are needed: lay it flat, light it evenly, '
                'and give its true --board sizes'
            )
    start = nominal(width, height, focal_px, table)
    if len(views) >= _LENS_VIEWS:
        # what stands in the mirror is a rigid board, too: the mirror image of the printed one
        shown = grid * [-1.0, 1.0] if mirror else grid
        flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
        _, camera, lens, _, _ = cv2.calibrateCamera(
            [np.column_stack([shown[i], np.zeros(len(i))]).astype(np.float32) for _, i in views],
            [p.astype(np.float32) for p, _ in views],
            (width, height),
            start.camera_matrix.copy(),
            np.zeros(5),
            flags=flags,
        )
        start = replace(start, camera_matrix=camera, distortion_coefficients=lens.ravel()[:5])
    px, ids = views[0]
    # the board's own axes run right and towards the viewer; the table's run right and away
    middle = np.array([board.columns, board.rows]) * board.square_m / 2
    xy = (grid[ids] - middle) * [1, -1] + [board.x_m, board.y_m]
    return from_points(px, xy, start, cover_height_m)
