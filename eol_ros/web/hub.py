# SPDX-License-Identifier: Apache-2.0
"""Between the graph and the viewers: each gets what it asked for, newest wins, nobody waits.

Lives in the server's event loop; only `Hub.put` may be called from another thread. A *state*
channel (blocks, image, meter...) keeps its newest packet per viewer; an *event* channel (slips,
triggers...) queues, and where a viewer is too slow the oldest go, counted. So a slow viewer costs
a bounded amount of memory and delays no one.
"""

import asyncio
from collections import deque
from collections.abc import Iterable

Payload = bytes | str

STATES = frozenset({'blocks', 'truth', 'image', 'meter', 'leds'})
EVENTS = frozenset({'slips', 'triggers', 'sound'})
NOTICES = frozenset({'notices'})  # wall, health, cascades, control, tick: all viewers, always
CHANNELS = STATES | EVENTS
QUEUE = 256


class Viewer:
    """One connected browser: what it wants, and what waits to be sent to it."""

    def __init__(self, number: int):
        self.number = number
        self.wants: frozenset[str] = frozenset()
        self.dropped = 0
        self._newest: dict[str, Payload] = {}
        self._queue: deque[Payload] = deque()
        self._ready = asyncio.Event()

    def offer(self, channel: str, payload: Payload) -> None:
        """Put one payload up for sending."""
        if channel in STATES:
            if channel in self._newest:
                self.dropped += 1
            self._newest[channel] = payload
        else:
            if len(self._queue) >= QUEUE:
                self._queue.popleft()
                self.dropped += 1
            self._queue.append(payload)
        self._ready.set()

    async def take(self) -> list[Payload]:
        """Wait for something to send and return all of it, events first."""
        await self._ready.wait()
        self._ready.clear()
        payloads = [*self._queue, *self._newest.values()]
        self._queue.clear()
        self._newest.clear()
        return payloads


class Hub:
    """Spreads payloads over the viewers that want them; knows which channels are wanted at all."""

    def __init__(self) -> None:
        self.viewers: set[Viewer] = set()
        self.demand: frozenset[str] = frozenset()
        self._sticky: dict[str, str] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._count = 0

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take note of the loop to run in."""
        self._loop = loop

    def put(self, channel: str, payload: Payload, sticky: str = '') -> None:
        """Give a payload to all who want `channel`; any thread.

        A `sticky` name keeps the payload for viewers who come later, until the next of that name.
        """
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._spread, channel, payload, sticky)

    def _spread(self, channel: str, payload: Payload, sticky: str) -> None:
        if sticky:
            self._sticky[sticky] = str(payload)
        for viewer in self.viewers:
            if channel in NOTICES or channel in viewer.wants:
                viewer.offer(channel, payload)

    def join(self) -> Viewer:
        """Add a viewer; it is told at once what is known."""
        self._count += 1
        viewer = Viewer(self._count)
        self.viewers.add(viewer)
        for payload in self._sticky.values():
            viewer.offer('notices', payload)
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer."""
        self.viewers.discard(viewer)
        self._review()

    def want(self, viewer: Viewer, channels: Iterable[str]) -> None:
        """Set what a viewer wants; unknown names are no channels and count for nothing."""
        viewer.wants = CHANNELS & frozenset(channels)
        self._review()

    def _review(self) -> None:
        self.demand = frozenset().union(*(v.wants for v in self.viewers))
