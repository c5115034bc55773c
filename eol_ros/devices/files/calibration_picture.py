# SPDX-License-Identifier: Apache-2.0
"""A figure of how well a calibration fits: what is left, and what is uncertain."""

from pathlib import Path

import cv2
import numpy as np

from eol_ros.core.vision.calibration.calibrate import Solution, platform_corners
from eol_ros.devices.files import picture_file

ARROW = 200  # residuals are drawn this many times longer
_POINT = (80, 220, 80)
_REST = (60, 160, 255)
_GRID = (200, 140, 60)
_TEXT = (235, 235, 235)


def draw(solution: Solution, image: np.ndarray | None) -> np.ndarray:
    """Return the image (h, w, 3) uint8: the image, the table's grid, and residuals as arrows."""
    calibration = solution.calibration
    size = (calibration.image_height, calibration.image_width)
    grey = np.zeros(size, np.uint8) if image is None else (image * 0.6).astype(np.uint8)
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    t = np.linspace(0, 1, 30)[:, None]
    table, corners = calibration.table, platform_corners(calibration.table)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        _line(picture, calibration.to_pixels(a + t * (b - a)), _GRID)
    half = table.block_side_m / 2
    for place in table.rest[table.ids]:
        ring = place + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
        _line(picture, calibration.to_pixels(ring), _GRID)
    for point, rest in zip(solution.px, solution.rest_px, strict=True):
        start = tuple(np.rint(16 * point).astype(int).tolist())
        end = tuple(np.rint(16 * (point + ARROW * rest)).astype(int).tolist())
        cv2.circle(picture, start, 32, _POINT, -1, cv2.LINE_AA, 4)
        cv2.line(picture, start, end, _REST, 1, cv2.LINE_AA, 4)
    for place, sigma in zip(calibration.to_pixels(corners * 0.94), solution.corner_mm, strict=True):
        if np.isfinite(sigma):
            u, v = place.astype(int).tolist()
            picture_file.write_text(picture, f'+-{sigma:.2f} mm', (u - 40, v), _TEXT)
    refusal = solution.refusal()
    words = [
        f'residual {calibration.residual_px:.3f} px = {calibration.residual_mm:.3f} mm RMS',
        f'arrows: residual x {ARROW}',
        f'REFUSED: {refusal[:90]}' if refusal else 'good',
    ]
    for line, text in enumerate(words):
        picture_file.write_text(picture, text, (12, 24 + 22 * line), _TEXT)
    return picture


def save(path: str | Path, solution: Solution, image: np.ndarray | None) -> None:
    """Write the image to `path`.

    Raises:
        ConfigError: it cannot be written there.
    """
    picture_file.save(path, draw(solution, image))


def _line(picture, px, colour) -> None:
    if np.isfinite(px).all() and np.abs(px).max() < 1e5:
        points = np.rint(16 * px).astype(np.int32)
        cv2.polylines(picture, [points], False, colour, 1, cv2.LINE_AA, 4)
