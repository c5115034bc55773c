# SPDX-License-Identifier: Apache-2.0
"""The frames in which light dies away: a function of the slips' stamps, and of nothing else.

A slip is shown as soon as it is known, some milliseconds after the stamp of its image, now more and
now less. If frames were taken when a timer fires, their levels would depend on those delays. So
they lie on a grid of the stamps' own time that begins at the slip that lit the dark field, and each
holds what was lit up to then: the same slips give the same frames, live and in a replay.

Frames are therefore asked for later than they lie, by more than a slip takes to be known. A slip
that is known when frames before it are still to come returns those too.
"""

from eol_ros.core.light.flash import FlashField

NS = 1e-9


class Frames:
    """A FlashField with its grid; all times are stamps in nanoseconds, levels 25 bytes."""

    def __init__(self, field: FlashField, rate_hz: float):
        self.field = field
        self.late = 0  # slips that came after a frame that should have shown them
        self._period = 1e9 / rate_hz
        self._anchor_ns = self._last_ns = 0
        self._count = 0  # frames since the anchor

    @property
    def glows(self) -> bool:
        """Whether frames are to come."""
        return not self.field.dark

    def slip(self, stamp_ns: int, *blocks: int) -> list[bytes]:
        """Light `blocks`; return the frames that lie before, and last the levels with the light."""
        frames = self.until(stamp_ns)
        if not self.glows:
            self._anchor_ns, self._count = stamp_ns, 0
        elif stamp_ns < self._last_ns:
            self.late += 1
        self._last_ns = max(stamp_ns, self._last_ns)
        for block in blocks:
            self.field.slip(stamp_ns * NS, block)
        return [*frames, self.field.level_bytes(stamp_ns * NS)]

    def until(self, stamp_ns: int) -> list[bytes]:
        """Return the frames that lie at or before `stamp_ns` and were not returned before."""
        frames = []
        while self.glows:
            at_ns = self._anchor_ns + round((self._count + 1) * self._period)
            if at_ns > stamp_ns:
                break
            frames.append(self.field.level_bytes(at_ns * NS))
            self._count, self._last_ns = self._count + 1, max(at_ns, self._last_ns)
        return frames

    def shift(self, by_ns: int) -> None:
        """Go on in stamps that are `by_ns` greater, the limit of flashes included: the clock was
        set."""
        self.field.shift(by_ns * NS)
        self._anchor_ns += by_ns
        self._last_ns += by_ns
