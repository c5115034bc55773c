# SPDX-License-Identifier: Apache-2.0
"""What people ask of a running tracker, each with the stamp from which it counts.

A tracker's answers are a function of its images. What is asked on the way is the rest of that
function: written down as (stamp, kind, value) it makes the same answers again.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from eol_ros.core.table import Table
from eol_ros.core.vision.appearance import learnt
from eol_ros.core.vision.background.model import BackgroundLearner, BackgroundModel
from eol_ros.errors import ConfigError

BACKGROUND, DARKNESS, CALIBRATE, COVERS = KINDS = 'background', 'darkness', 'calibrate', 'covers'


@dataclass(frozen=True)
class Outcome:
    """What came of a request of `kind`, in one line for people."""

    kind: str
    refused: bool
    text: str


def packed(background: BackgroundModel) -> bytes:
    """Return a background model as PNG."""
    return cv2.imencode('.png', background.light)[1].tobytes()


def unpacked(png: bytes) -> BackgroundModel:
    """Return the background model in what `packed` gave; raises ConfigError."""
    try:
        light = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        light = None
    if light is None:
        raise ConfigError('an image of the background cannot be read: it is not a PNG')
    return BackgroundModel(light)


class Requests:
    """Requests in order of their stamps, and the darkness in which lamps are learnt."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._waiting: list[tuple[float, str, Any]] = []
        self._until_s = -np.inf
        self._learner: BackgroundLearner | None = None

    def add(self, from_ns: int, kind: str, value: Any = None) -> None:
        """Let a request count from the first image of stamp >= from_ns.

        `background`: a PNG, or nothing for none. `darkness`: the infrared light is off until the
        stamp `value` in ns. `calibrate`: by the blocks. `covers`: how bright each cover is, as it
        was learned before (`Tracker.learned`).

        Raises:
            ConfigError: another kind, no image, or nothing that was learnt.
        """
        if kind not in KINDS:
            raise ConfigError(f'{kind} is nothing that a tracker can be asked for')
        if kind == BACKGROUND:
            value = unpacked(value) if value else None
        elif kind == COVERS:
            value = learnt.check(value, self._table.cells)
        self._waiting.append((from_ns * 1e-9, kind, value))
        self._waiting.sort(key=lambda request: request[0])

    def due(self, stamp_s: float) -> Iterator[tuple[str, Any]]:
        """Yield kind and value of what counts from this image on."""
        while self._waiting and self._waiting[0][0] <= stamp_s:
            _, kind, value = self._waiting.pop(0)
            if kind == DARKNESS:
                self._learner, self._until_s = BackgroundLearner(self._table), value * 1e-9
            else:
                yield kind, value

    def dark(self, stamp_s: float, image: np.ndarray) -> bool:
        """Whether the infrared light is off in `image`; then lamps are learnt from it."""
        if self._learner is None or stamp_s >= self._until_s:
            return False
        if image.ndim == 2 and image.dtype == np.uint8:
            self._learner.add(image)
        return True

    def learnt(self) -> BackgroundModel | None:
        """Return the map when a darkness is over, once; raises ConfigError when it was no good."""
        if self._learner is None:
            return None
        learner, self._learner = self._learner, None
        return learner.result()
