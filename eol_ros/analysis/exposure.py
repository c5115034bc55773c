# SPDX-License-Identifier: Apache-2.0
"""How long and how fast hands pulled: what a count of cascades has to be held against."""

from dataclasses import dataclass

import numpy as np

from eol_ros.analysis.bag import Bag, Table
from eol_ros.analysis.recorded_settings import recorded_table

STEP_NS = 500_000_000  # between two places
# what tells it, by topic: the first that is there; and the fields that others read, too
SEEN = {
    'truth': ('the rim', ('stamp', 'rim_x', 'rim_y', 'rim_yaw')),
    'blocks': ('the mean of the blocks', ('stamp', 'blocks.x', 'blocks.y')),
}
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


class Way:
    """The way of the rim or of the blocks: the first place of each step by the stamps.

    Places are half a step apart at least.
    """

    def __init__(self, bag: Bag):
        self._topic = next((topic for topic in SEEN if bag.count(topic) > 1), '')
        self.fields = {self._topic: SEEN[self._topic][1]} if self._topic else {}
        self._start_ns, self._ids = bag.start_ns, recorded_table(bag).ids
        self._last_ns, self._last_step = -(1 << 62), -(1 << 62)
        self._rows: list[tuple[np.ndarray, ...]] = []

    def add(self, table: Table) -> None:
        """Take the rows that follow."""
        at_ns = table['stamp'].astype('i8')
        step = (at_ns - self._start_ns) // STEP_NS
        picked = []
        for i in np.flatnonzero(np.diff(step, prepend=self._last_step)).tolist():
            if at_ns[i] >= self._last_ns + STEP_NS // 2:
                self._last_ns = int(at_ns[i])
                picked.append(i)
        self._last_step = int(step[-1])
        rows = table[picked]
        places = (
            (rows['rim_x'], rows['rim_y']) if self._topic == 'truth'
            else (rows['blocks'][axis].take(self._ids, axis=1).mean(axis=1) for axis in ('x', 'y'))
        )  # fmt: skip
        self._rows.append(((rows['stamp'].astype('i8') - self._start_ns) * 1e-9, *places))

    def exposure(self) -> Exposure | None:
        """Return it; None where the bag says nothing of motion."""
        if not self._rows:
            return None
        at_s, *places = (np.concatenate(column) for column in zip(*self._rows, strict=True))
        steps_s = np.diff(at_s)
        steps_m = np.linalg.norm(np.diff(np.stack(places, axis=1), axis=0), axis=1)
        speed = np.divide(steps_m, steps_s, out=np.zeros(len(steps_m)), where=steps_s > 0)
        moving = speed > MOVES_MPS
        return Exposure(
            SEEN[self._topic][0], float(at_s[-1] - at_s[0]), float(steps_s[moving].sum()),
            float(steps_m[moving].sum()), float(np.median(speed[moving])) if moving.any() else 0.0,
        )  # fmt: skip


def of(bag: Bag) -> Exposure | None:
    """Return the exposure of a bag; None where it says nothing of motion."""
    return bag.gathered(Way).exposure()
