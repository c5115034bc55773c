# SPDX-License-Identifier: Apache-2.0
"""The moving twin as a video file: what a camera above a real table would deliver."""

from pathlib import Path

import cv2
import numpy as np

from eol_ros.core.physics.twin.play import Play
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.errors import DeviceMissing
from eol_ros.verbs.progress import track


def write_film(
    path: Path,
    seconds: float,
    fps: float = 60.0,
    codec: str = 'MJPG',
    seed: int = 5,
    size: tuple[int, int] = (1280, 800),
) -> Path:
    """Write `seconds` of the twin, visitors at work, with OpenCV's encoder; return `path`."""
    calibration = Calibration.ideal(*size)
    renderer = Renderer(RenderOptions(rate_hz=fps), calibration, seed)
    play = Play(seed)
    table = play.table
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), fps, size, isColor=False)
    if not writer.isOpened():
        raise DeviceMissing(f'{path}: OpenCV here has no encoder for {codec}')
    image = np.empty(size[::-1], np.uint8)
    for index in track(range(round(seconds * fps)), 'film'):
        play.advance(1 / fps)
        renderer.render(table.x, table.y, table.yaw, index, image, velocity=table.velocity)
        writer.write(image)
    writer.release()
    return path
