# SPDX-License-Identifier: Apache-2.0
"""Between the graph and the viewers: each gets what it asked for, newest wins, nobody waits.

Lives in the server's event loop; only `Hub.put` may be called from another thread. A payload is
framed once and written to every viewer at once, without a task in between. Where a viewer's wire
is full, a *state* channel (blocks, image, meter...) keeps its newest packet for it, an *event*
channel (slips, triggers...) the last 256; what goes is counted. So a slow viewer costs a bounded
amount of memory and delays no one.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from eol_ros.web import wire

STATES = frozenset({'blocks', 'truth', 'image', 'meter', 'leds'})
EVENTS = frozenset({'slips', 'triggers', 'sound'})
NOTICES = frozenset({'notices'})  # wall, health, cascades, control, tick: all viewers, always
CHANNELS = STATES | EVENTS
QUEUE = 256
FULL = 65536  # bytes that wait on a wire: more, and its viewer is slow
RETRY_S = 0.02
Payload = bytes | str | dict[str, Any]  # a dict goes out as JSON


class Viewer:
    """One connected browser: what it wants, and what waits to be sent to it.

    States wait until `pace_s` after the last ones; an event goes at once and takes them along.
    """

    def __init__(self, number: int, line: asyncio.WriteTransport, loop: asyncio.AbstractEventLoop):
        self.number = number
        self.wants: frozenset[str] = frozenset()
        self.pace_s = 0.0
        self.dropped = 0
        self._line, self._loop = line, loop
        self._newest: dict[str, bytes] = {}
        self._queue: deque[bytes] = deque()
        self._due_s = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def tell(self, text: str) -> None:
        """Send a text to this viewer alone."""
        self.offer('notices', wire.frame(text))

    def offer(self, channel: str, frame: bytes) -> None:
        """Send one frame, now or as soon as can be."""
        if channel in STATES:
            self.dropped += channel in self._newest
            self._newest[channel] = frame
            if self._timer is not None:
                return
        else:
            if len(self._queue) >= QUEUE:
                self._queue.popleft()
                self.dropped += 1
            self._queue.append(frame)
        self.flush()

    def flush(self) -> None:
        """Send what waits, if it may go and the wire takes it."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._line.is_closing():
            return
        if self._line.get_write_buffer_size() > FULL:
            return self._again(RETRY_S)
        now = self._loop.time()
        if not self._queue and now < self._due_s:
            return self._again(self._due_s - now)
        if self._newest:
            self._due_s = now + self.pace_s
        frames = [*self._queue, *self._newest.values()]
        self._queue.clear()
        self._newest.clear()
        if frames:
            self._line.write(frames[0] if len(frames) == 1 else b''.join(frames))

    def _again(self, after_s: float) -> None:
        self._timer = self._loop.call_later(after_s, self.flush)

    def close(self) -> None:
        """Send nothing more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._queue.clear()
        self._newest.clear()


class Hub:
    """Spreads payloads over the viewers that want them; knows which channels are wanted at all."""

    def __init__(self) -> None:
        self.viewers: set[Viewer] = set()
        self.demand: frozenset[str] = frozenset()
        self._sticky: dict[str, Payload] = {}
        self.on_demand: Callable[[], None] = lambda: None  # called in the loop's thread
        self._loop: asyncio.AbstractEventLoop | None = None
        self._count = 0

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take note of the loop to run in."""
        self._loop = loop

    def put(self, channel: str, payload: Payload, sticky: str = '') -> None:
        """Give a payload to all who want `channel`; any thread.

        A `sticky` name keeps the payload for viewers who come later, until the next of that name.
        While nobody looks nothing is written and the loop not woken. No notice is lost on that
        way: here it is kept first and then the viewers are counted, in `join` the other way round.
        """
        if sticky:
            self._sticky[sticky] = payload
        loop = self._loop
        if self.viewers and loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._spread, channel, payload)

    def _spread(self, channel: str, payload: Payload) -> None:
        frame = wire.frame(payload)
        for viewer in self.viewers:
            if channel in viewer.wants or channel in NOTICES:
                viewer.offer(channel, frame)

    def join(
        self, line: asyncio.WriteTransport, hello: Callable[[Viewer], str] = lambda viewer: ''
    ) -> Viewer:
        """Add a viewer; it is greeted, and told at once what is known."""
        assert self._loop is not None
        self._count += 1
        viewer = Viewer(self._count, line, self._loop)
        if text := hello(viewer):
            viewer.tell(text)
        self.viewers.add(viewer)
        for payload in self._sticky.copy().values():
            viewer.offer('notices', wire.frame(payload))
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer."""
        viewer.close()
        self.viewers.discard(viewer)
        self._review()

    def want(self, viewer: Viewer, channels: Iterable[str]) -> None:
        """Set what a viewer wants; unknown names are no channels and count for nothing."""
        viewer.wants = CHANNELS & frozenset(channels)
        self._review()

    def _review(self) -> None:
        demand = frozenset().union(*(v.wants for v in self.viewers))
        if demand != self.demand:
            self.demand = demand
            self.on_demand()
