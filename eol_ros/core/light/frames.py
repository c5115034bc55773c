# SPDX-License-Identifier: Apache-2.0
"""The frames in which light dies away: a function of the slips' stamps, and of nothing else.

A slip is shown as soon as it is known, some milliseconds after the stamp of its image, and this
delay varies. If frames were taken when a timer fires, their levels would depend on those delays. So
they lie on a grid of the stamps' own time that begins at the slip that lit the dark field, and each
holds what was lit up to then: the same slips give the same frames, live and in a replay.

Frames are therefore asked for later than they lie, by more than a slip takes to be known. A slip
that is known when frames before it are still to come returns those too.

A block that lights itself reports it later, and a tap and the image that shows its slip may arrive
in either order. Such light is kept until its frames are due (`lit`). Only then the stamps alone
decide whether a slip had lit its block already.
"""

import heapq
from typing import Any

from eol_ros.core.light.flash import FlashField
from eol_ros.core.light.looks import REST_S

NS = 1e-9
FELT_NS = 100_000_000  # a slip does not light a block that lit itself this short before its onset


class Frames:
    """A FlashField with its grid; all times are stamps in nanoseconds, levels a byte a place."""

    def __init__(self, field: FlashField, rate_hz: float):
        self.field = field
        self.late = 0  # slips that came after a frame that should have shown them
        self._period = 1e9 / rate_hz
        self._anchor_ns = self._last_ns = 0
        self._count = 0  # frames since the anchor
        # heap by stamp; the last item: share of the peak, if light came from another block
        self._kept: list[tuple[int, int, tuple[int, ...], Any, int | None, float | None]] = []
        self._number = 0
        self._knock_ns: dict[int, int] = {}  # last tap of each block
        self._lit_ns: dict[int, int] = {}  # when it was last lit

    @property
    def glows(self) -> bool:
        """Whether frames are to come."""
        return bool(self._kept) or not self.field.dark

    def lit(
        self,
        stamp_ns: int,
        cause: Any,
        *blocks: int,
        onset_ns: int | None = None,
        spread: float | None = None,
    ) -> None:
        """Keep that `blocks` were lit at `stamp_ns` until `due` comes to it.

        A tap lit them, without `onset_ns` and `spread`. With `onset_ns` a slip that began then
        lights them, unless they had lit themselves. With `spread` light from another block raises
        them to this share of the peak, if they are dimmer and had not been lit for REST_S: such
        light ends a fall of theirs only with a rise.
        """
        self._number += 1
        heapq.heappush(self._kept, (stamp_ns, self._number, blocks, cause, onset_ns, spread))

    def due(self, stamp_ns: int) -> list[tuple[int, bytes, Any]]:
        """Return time, levels and cause of what was kept and of the frames up to `stamp_ns`.

        The cause is None in a frame.
        """
        found: list[tuple[int, bytes, Any]] = []
        while self._kept and self._kept[0][0] <= stamp_ns:
            at_ns, _, blocks, cause, onset_ns, spread = heapq.heappop(self._kept)
            found += [(t, levels, None) for t, levels in self._until(at_ns)]
            if spread is not None:
                dimmer = self.field.levels(at_ns * NS) < spread * self.field.peak
                blocks = tuple(b for b in blocks if dimmer[b] and self.rested(b, at_ns))
                if not blocks:
                    continue
            elif onset_ns is None:
                self._knock_ns.update(dict.fromkeys(blocks, at_ns))
            elif any(self._knock_ns.get(b, -FELT_NS) > onset_ns - FELT_NS for b in blocks):
                continue
            share = 1.0 if spread is None else spread
            found.append((at_ns, self._lit(at_ns, blocks, share), cause))
        return found + [(t, levels, None) for t, levels in self._until(stamp_ns)]

    def rested(self, block: int, at_ns: int) -> bool:
        """Return whether `block` had not been lit for REST_S at `at_ns`, as far as `due` came."""
        return at_ns - self._lit_ns.get(block, -(10**18)) >= REST_S * 1e9

    def _lit(self, stamp_ns: int, blocks: tuple[int, ...], share: float) -> bytes:
        if self.field.dark:
            self._anchor_ns, self._count = stamp_ns, 0
        elif stamp_ns < self._last_ns:
            self.late += 1
        self._last_ns = max(stamp_ns, self._last_ns)
        self._lit_ns.update(dict.fromkeys(blocks, stamp_ns))
        for block in blocks:
            self.field.slip(stamp_ns * NS, block, share)
        return self.field.level_bytes(stamp_ns * NS)

    def _until(self, stamp_ns: int) -> list[tuple[int, bytes]]:
        frames = []
        while not self.field.dark:
            at_ns = self._anchor_ns + round((self._count + 1) * self._period)
            if at_ns > stamp_ns:
                break
            frames.append((at_ns, self.field.level_bytes(at_ns * NS)))
            self._count, self._last_ns = self._count + 1, max(at_ns, self._last_ns)
        return frames

    def shift(self, by_ns: int) -> None:
        """Go on in stamps that are `by_ns` greater, the limit of flashes included: the clock was
        set."""
        self.field.shift(by_ns * NS)
        self._anchor_ns += by_ns
        self._last_ns += by_ns
        self._knock_ns.clear()
        self._lit_ns = {block: at_ns + by_ns for block, at_ns in self._lit_ns.items()}
        self._kept = [
            (stamp_ns + by_ns, number, blocks, cause, onset_ns and onset_ns + by_ns, spread)
            for stamp_ns, number, blocks, cause, onset_ns, spread in self._kept
        ]
