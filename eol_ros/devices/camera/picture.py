# SPDX-License-Identifier: Apache-2.0
"""An image of a camera, and the interface of a live one."""

from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from eol_ros.settings import CameraSettings

CLOCK_TRUST_S = 1.0  # a driver's stamp further from now than this is of another clock


class Picture(NamedTuple):
    """One image, (height, width) uint8, and its mid-exposure time.

    `monotonic_ns` is on CLOCK_MONOTONIC; None for a file, whose images are due when the clock says.
    """

    monotonic_ns: int | None
    image: np.ndarray


class SourceLost(OSError):
    """The camera gives no more images: unplugged, or its driver gave up."""


class Live(Protocol):
    """What `Camera` asks of a camera: V4L2, GenICam, or a fake."""

    live: Literal[True]
    name: str
    fps: float
    notes: list[str]
    exposure_us: float

    @property
    def values(self) -> dict[str, Any]: ...

    def open(self) -> None: ...

    def read(self) -> Picture | None:
        """Return the next image; None where there is none yet, and none is overdue."""

    def close(self) -> None: ...


class Device:
    """Base of V4L2 and GenICam cameras: the state that /diagnostics reports."""

    live: Literal[True] = True

    def __init__(self, settings: CameraSettings):
        self.name = settings.device
        self.fps = settings.fps or 60.0
        self.notes: list[str] = []
        self.odd_stamps = self.repeated = 0
        self.exposure_us = float(settings.exposure_us)
        self._settings = settings

    @property
    def values(self) -> dict[str, Any]:
        """Return the counters by name."""
        return {
            'odd_stamps': self.odd_stamps,
            'repeated': self.repeated,
            'exposure_us': self.exposure_us,
        }
