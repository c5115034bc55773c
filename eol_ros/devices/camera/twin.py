# SPDX-License-Identifier: Apache-2.0
"""The twin's virtual camera above a table at rest, as a camera among others: no graph is needed."""

import time
from typing import Any, Literal

import numpy as np

from eol_ros.core.table import Table
from eol_ros.devices.camera.picture import Picture
from eol_ros.devices.files.twin_camera import twin_camera
from eol_ros.settings import TwinSettings

NS = 1_000_000_000


class TwinCamera:
    """Images of resting blocks, due on the period, delivered when their exposure ends."""

    live: Literal[True] = True

    def __init__(self, settings: TwinSettings, table: Table = Table()):
        self.name, self.fps = 'twin', settings.fps
        self.exposure_us = float(settings.exposure_us)
        self.notes: list[str] = []
        self.missed = 0
        self._settings, self._table = settings, table
        self._index = self._begun_ns = 0

    @property
    def values(self) -> dict[str, Any]:
        """Return what is told of the camera."""
        return {'missed': self.missed, 'exposure_us': self.exposure_us}

    def open(self) -> None:
        """Make the renderer; its loops are compiled now and not with the first image."""
        from eol_ros.core.vision.render.renderer import Renderer, RenderOptions

        s = self._settings
        options = RenderOptions(
            s.noise, s.clutter, exposure_s=s.exposure_us * 1e-6, rate_hz=s.fps
        )  # fmt: skip
        camera = twin_camera(s, self._table)
        self._renderer = Renderer(options, camera, s.seed)
        self._index = 0
        self._draw()
        self._begun_ns = time.monotonic_ns()

    def _draw(self) -> np.ndarray:
        x, y = self._table.rest.T
        return self._renderer.render(x, y, np.zeros(len(x)), self._index).copy()

    def read(self) -> Picture:
        """Return the next image when its exposure has ended."""
        period_ns = round(NS / self.fps)
        self._index += 1
        middle_ns = self._begun_ns + self._index * period_ns
        image = self._draw()
        behind = (time.monotonic_ns() - middle_ns) // period_ns
        if behind > 0:  # drawing took too long: images are left out
            self.missed += behind
            self._index += behind
            middle_ns += behind * period_ns
        end_ns = middle_ns + round(500 * self.exposure_us)
        time.sleep(max(0, end_ns - time.monotonic_ns()) / NS)
        return Picture(middle_ns, image)

    def close(self) -> None:
        """Nothing is held."""
