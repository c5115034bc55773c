# SPDX-License-Identifier: Apache-2.0
"""How long and how fast hands pulled: what a count of cascades has to be held against."""

from dataclasses import dataclass

import numpy as np

from eol_ros.analysis.bag import Bag
from eol_ros.analysis.recorded_settings import recorded_table

STEP_S = 0.5
SEEN = {'truth': 'the rim', 'blocks': 'the mean of the blocks'}  # the first that is there
MOVES_MPS = 0.002  # the mean of 25 blocks seems to move at 0.1 mm/s by the camera's noise alone


@dataclass(frozen=True)
class Exposure:
    """Of the rim, where the bag has the twin's truth; else of the mean of the blocks."""

    of: str
    duration_s: float
    moving_s: float
    path_m: float
    median_mps: float

    @property
    def sentence(self) -> str:
        """The exposure for people."""
        return (
            f'exposure: {self.duration_s:.0f} s, in which {self.of} moved for {self.moving_s:.0f} '
            f's over {self.path_m:.2f} m, at {1e3 * self.median_mps:.0f} mm/s in the median'
        )


def of(bag: Bag) -> Exposure | None:
    """Return the exposure of a bag; None where it says nothing of motion."""
    for topic in topic_of(bag):
        return _moved(*_path(bag, topic), SEEN[topic])
    return None


def topic_of(bag: Bag) -> dict[str, float]:
    """Return the topic that tells it and how far apart, in s, its rows are looked at; or none."""
    topic = next((topic for topic in SEEN if bag.count(topic) > 1), None)
    return {topic: STEP_S} if topic else {}


def _moved(at_s: np.ndarray, place_m: np.ndarray, name: str) -> Exposure:
    steps_s = np.diff(at_s)
    steps_m = np.linalg.norm(np.diff(place_m, axis=0), axis=1)
    speed = np.divide(steps_m, steps_s, out=np.zeros(len(steps_m)), where=steps_s > 0)
    moving = speed > MOVES_MPS
    return Exposure(
        name, float(at_s[-1] - at_s[0]), float(steps_s[moving].sum()),
        float(steps_m[moving].sum()), float(np.median(speed[moving])) if moving.any() else 0.0,
    )  # fmt: skip


def _path(bag: Bag, topic: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,), s, and places (n, 2), m, at least STEP_S apart."""
    table = bag.thinned(topic, STEP_S)
    at_s = (table['stamp'].astype('i8') - bag.start_ns) * 1e-9
    if topic == 'truth':
        return at_s, np.stack([table['rim_x'], table['rim_y']], axis=1)
    ids = recorded_table(bag).ids
    middle = [table['blocks'][axis].take(ids, axis=1).mean(axis=1) for axis in ('x', 'y')]
    return at_s, np.stack(middle, axis=1)
