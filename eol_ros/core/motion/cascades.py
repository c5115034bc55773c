# SPDX-License-Identifier: Apache-2.0
"""Slips joined in time and neighbourhood.

Two slips belong together when their blocks are the same or touch in the lattice, corners included,
and the later onset falls before the earlier slip's end plus a short gap. A cascade is a connected
set; its nucleus is the block of the earliest onset, its area counts blocks, its size counts slips.
"""

import math
from dataclasses import dataclass, field

from eol_ros.core.motion.slips import START, SlipEvent
from eol_ros.core.table import Table
from eol_ros.settings import MotionSettings


@dataclass(frozen=True)
class CascadeEvent:
    """One finished cascade, as in eol_msgs/Cascade; times in s, distance in m."""

    cascade: int
    stamp_s: float
    onset_s: float
    duration_s: float
    nucleus: int
    area: int
    size: int
    blocks: tuple[int, ...]
    distance_m: float


@dataclass
class _Member:
    block: int
    onset_s: float
    end_s: float | None = None
    distance_m: float = 0.0


@dataclass
class _Cascade:
    number: int
    members: dict[int, _Member] = field(default_factory=dict)

    def reaches(self, touching: set[int], onset_s: float, gap_s: float) -> bool:
        return any(
            m.block in touching and (m.end_s is None or onset_s <= m.end_s + gap_s)
            for m in self.members.values()
        )

    def finished(self, now_s: float, wait_s: float) -> bool:
        return all(m.end_s is not None and now_s > m.end_s + wait_s for m in self.members.values())


class Cascades:
    """Gathers slip events into cascades; numbers count up from 1."""

    def __init__(self, settings: MotionSettings, table: Table = Table()):
        self.settings = settings
        self._touching = {
            block: {block, *table.neighbours(block, diagonal=True)} for block in table.ids.tolist()
        }
        self.count = 0
        self.open: list[_Cascade] = []

    def update(
        self, stamp_s: float, events: list[SlipEvent]
    ) -> tuple[list[int], list[CascadeEvent]]:
        """Return the cascade number of each event, and the cascades that this image closes.

        A slip that bridges two open cascades makes them one, under the lower number; starts that
        were told the higher number before are named again, with the right one, by their stops.
        """
        numbers = self.begun(events)
        closed = []
        # An onset is known only some images after it; wait so long before a cascade is called over.
        wait_s = self.settings.cascade_gap_s + self.settings.stop_s
        for cascade in [c for c in self.open if c.finished(stamp_s, wait_s)]:
            self.open.remove(cascade)
            closed.append(_close(cascade, stamp_s))
        return numbers, closed

    def begun(self, events: list[SlipEvent]) -> list[int]:
        """Return the cascade number of each event; no cascade is closed."""
        return [self._place(event) for event in events]

    def finish(self, stamp_s: float) -> list[CascadeEvent]:
        """No more images come: return the cascades whose slips have all stopped."""
        over = [c for c in self.open if all(m.end_s is not None for m in c.members.values())]
        self.open = [c for c in self.open if c not in over]
        return [_close(cascade, stamp_s) for cascade in over]

    def _place(self, event: SlipEvent) -> int:
        if event.kind != START:
            for cascade in self.open:
                member = cascade.members.get(event.slip)
                if member is not None:
                    member.onset_s = event.onset_s
                    member.end_s = event.onset_s + event.duration_s
                    member.distance_m = event.distance_m
                    return cascade.number
            return 0
        gap_s, touching = self.settings.cascade_gap_s, self._touching[event.block]
        joined = [c for c in self.open if c.reaches(touching, event.onset_s, gap_s)]
        if not joined:
            self.count += 1
            joined = [_Cascade(self.count)]
            self.open.append(joined[0])
        first = joined[0]
        for other in joined[1:]:
            first.members.update(other.members)
            self.open.remove(other)
        first.members[event.slip] = _Member(event.block, event.onset_s)
        return first.number


def _close(cascade: _Cascade, stamp_s: float) -> CascadeEvent:
    members = sorted(cascade.members.values(), key=lambda m: m.onset_s)
    blocks = tuple(dict.fromkeys(m.block for m in members))
    onset_s = members[0].onset_s
    end_s = max(m.end_s for m in members if m.end_s is not None)
    return CascadeEvent(
        cascade.number,
        stamp_s,
        onset_s,
        end_s - onset_s,
        members[0].block,
        len(blocks),
        len(members),
        blocks,
        math.fsum(m.distance_m for m in members),
    )
