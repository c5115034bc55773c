# SPDX-License-Identifier: Apache-2.0
"""What of a bag cannot be read, in bytes, in time and in words."""

import time
from collections.abc import Sequence
from typing import NamedTuple

from mcap.records import Chunk

from eol_ros.devices.bag.scan import Found

FOREVER = (1 << 63) - 1


class Place(NamedTuple):
    """Where messages lie in a file: a chunk, or one message by itself. Times in ns, true ones."""

    start_ns: int
    end_ns: int
    offset: int
    end: int
    channels: frozenset[int]  # empty: not known
    compression: str  # of a chunk; the record itself may be damaged
    chunk: bool = True


class Damage(NamedTuple):
    """A stretch of bytes of `file` that cannot be read, and which time of it is missing, in ns.

    Where no message is missing the times are 0.
    """

    file: str
    start: int
    end: int
    why: str
    start_ns: int = 0
    end_ns: int = 0

    def text(self, bag_start_ns: int) -> str:
        """Return it in words, with times from the start of the bag, too."""
        where = f'{self.file}: bytes {self.start} to {self.end} are damaged ({self.why})'
        if not self.end_ns:
            return f'{where}; no message is missing'
        begin = f'{(self.start_ns - bag_start_ns) * 1e-9:.3f} s' if self.start_ns else 'the start'
        end = f'{(self.end_ns - bag_start_ns) * 1e-9:.3f} s' if self.end_ns < FOREVER else 'the end'
        day = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(self.start_ns // 10**9))
        day = f' ({day})' if self.start_ns else ''
        return f'{where}: messages from {begin} to {end} may be missing{day}'


class Unreadable(NamedTuple):
    """What damage has cost: messages, of files whose index counts them, and how long it lasts."""

    messages: int
    seconds: float


def span(hole: Found, before: Sequence[Place], after: Sequence[Place]) -> tuple[int, int]:
    """Return from when to when messages may be lost in a hole between places of a file, in ns."""
    if hole.framed:
        return 0, 0
    # between the neighbours of many messages, for images lie among them
    start_ns = next((p.end_ns for p in reversed(before) if p.start_ns < p.end_ns), 0)
    end_ns = next((p.end_ns for p in after if p.start_ns < p.end_ns), FOREVER)
    if isinstance(hole.record, Chunk):
        said = hole.record.message_start_time, hole.record.message_end_time
        if not said[1]:
            return 0, 0  # definitions
        if start_ns <= said[0] <= said[1] <= end_ns:
            return said
    return start_ns, max(start_ns, end_ns)


def lasting_s(spans: Sequence[tuple[int, int]]) -> float:
    """Return how long spans of time, in ns, last together."""
    seconds, until_ns = 0.0, 0
    for start_ns, end_ns in sorted(spans):
        seconds += max(end_ns - max(start_ns, until_ns), 0) * 1e-9
        until_ns = max(until_ns, end_ns)
    return seconds
