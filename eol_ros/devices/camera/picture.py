# SPDX-License-Identifier: Apache-2.0
"""An image of a camera, and the interface of a live one."""

from typing import Any, Literal, NamedTuple, Protocol

import numpy as np


class Picture(NamedTuple):
    """One image, (height, width) uint8, and its mid-exposure time.

    `monotonic_ns` is on CLOCK_MONOTONIC; None for a file, whose images are due when the clock says.
    """

    monotonic_ns: int | None
    image: np.ndarray


class SourceLost(OSError):
    """The camera gives no more images: unplugged, or its driver gave up."""


class Live(Protocol):
    """What `Camera` asks of a camera: V4L2, the twin, or a fake."""

    live: Literal[True]
    name: str
    fps: float
    notes: list[str]
    exposure_us: float

    @property
    def values(self) -> dict[str, Any]: ...

    def open(self) -> None: ...

    def read(self) -> Picture: ...

    def close(self) -> None: ...
