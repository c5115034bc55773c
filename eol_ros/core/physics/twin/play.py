# SPDX-License-Identifier: Apache-2.0
"""The table, its rim and who moves it, from image to image: what the twin and its measures run."""

from eol_ros.core.physics.twin.hands import YIELD_S, Commands, Rim, Visitors
from eol_ros.core.physics.twin.live import Coupling, LiveTable
from eol_ros.core.table import Table

AWAY_S = 1.0  # visitors who were sent away come back this long after they may


class Play:
    """A live table under hands: simulated visitors, and people through `commands`.

    Visitors let go at the first touch of a person and stay away for YIELD_S after the last. Who has
    the table is in `playing`: 'people', 'visitors' or 'nobody'. `time_s` is 0 at the start.
    """

    def __init__(
        self,
        seed: int,
        samples: int = 0,
        coupling: Coupling | None = None,
        table: Table = Table(),
    ) -> None:
        coupling = coupling or Coupling()
        self.table = LiveTable(seed, samples, coupling, table)
        self.rim = Rim(self.table.pull, coupling.stiffness, table, coupling.block_kg)
        self.visitors, self.commands = Visitors(seed, table), Commands()
        self.time_s, self.playing = 0.0, ''
        self._rested = False  # in the last step: no hand, and nothing moved

    def advance(self, span_s: float, visitors: bool = True) -> float:
        """Move on by `span_s`; without `visitors` only people move the rim. Return the begin, s."""
        begin_s, self.time_s = self.time_s, self.time_s + span_s
        people_s = self.commands.touched_s + YIELD_S - self.time_s
        if not visitors:
            self.visitors.let_go(self.time_s, max(people_s, AWAY_S))
        elif people_s > 0:
            self.visitors.let_go(self.time_s, people_s)
        self.playing = 'people' if people_s > 0 else 'visitors' if visitors else 'nobody'
        hands = self.visitors.hands(self.time_s, self.rim.pose)
        hands += self.commands.hands(self.time_s)
        rests = not (hands or self.rim.velocity.any() or self.table.moving.any())
        if not (rests and self._rested):  # else nothing would come of it either
            self.rim.advance(span_s, hands)
        self._rested = rests
        self.table.advance(begin_s, self.time_s, self.rim.pose, self.rim.velocity)
        return begin_s
