# SPDX-License-Identifier: Apache-2.0
"""What people ask of a running tracker, each with the stamp from which it counts.

A tracker's answers are a function of its images. What is asked on the way is the rest of that
function: written down as (stamp, key, text) it makes the same answers again.
"""

import base64
from collections.abc import Iterator

import cv2
import numpy as np

from eol_ros.core.vision.background.model import ClutterLearner, ClutterMap
from eol_ros.errors import ConfigError

NS = 1_000_000_000
SOON_NS = 1_000_000  # after the last image: less than any camera's period, more than a float's step
THRESHOLD, CLUTTER, DARK, CALIBRATE = KEYS = ('threshold', 'clutter', 'dark', 'calibrate')


def packed(clutter: ClutterMap) -> str:
    """Return a clutter map as text."""
    return base64.b64encode(cv2.imencode('.png', clutter.light)[1].tobytes()).decode()


def unpacked(text: str) -> ClutterMap:
    """Return the clutter map in what `packed` gave; raises ConfigError."""
    try:
        data = np.frombuffer(base64.b64decode(text), np.uint8)
        light = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    except (ValueError, cv2.error):
        light = None
    if light is None:
        raise ConfigError('a clutter map in the bag cannot be read')
    return ClutterMap(light)


class Requests:
    """Requests in order of their stamps, and the darkness in which lamps are learnt."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, str, str]] = []
        self._until_s = -np.inf
        self._learner: ClutterLearner | None = None

    def add(self, from_ns: int, key: str, text: str = '') -> None:
        """Let `key` count from the first image of stamp >= from_ns.

        `threshold`: text is grey levels. `clutter`: a map, or nothing for none. `dark`: the
        infrared light is off until the stamp in ns that text says. `calibrate`: by the blocks.
        """
        if key not in KEYS:
            raise ConfigError(f'{key} is nothing that a tracker can be asked for')
        self._waiting.append((from_ns * 1e-9, key, text))
        self._waiting.sort(key=lambda request: request[0])

    def due(self, stamp_s: float) -> Iterator[tuple[str, str]]:
        """Yield key and text of what counts from this image on."""
        while self._waiting and self._waiting[0][0] <= stamp_s:
            _, key, text = self._waiting.pop(0)
            if key == DARK:
                self._learner, self._until_s = ClutterLearner(), int(text) * 1e-9
            else:
                yield key, text

    def dark(self, stamp_s: float, image: np.ndarray) -> bool:
        """Whether the infrared light is off in `image`; then lamps are learnt from it."""
        if self._learner is None or stamp_s >= self._until_s:
            return False
        if image.ndim == 2 and image.dtype == np.uint8:
            self._learner.add(image)
        return True

    def learnt(self) -> ClutterMap | None:
        """Return the map when a darkness is over, once; raises ConfigError when it was no good."""
        if self._learner is None:
            return None
        learner, self._learner = self._learner, None
        return learner.result()
