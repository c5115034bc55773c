# SPDX-License-Identifier: Apache-2.0
"""Shares connections by address: when all are taken, the address that holds most loses one.

A single address may hold all of them. All connections that wait for a request count alike, with
half a header or kept alive, so the oldest of these is dropped first.
"""

import asyncio
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from aiohttp import web

WAITING, SERVING, VIEWING = range(3)  # for a complete request, with a request, as a WebSocket


def heaviest(addresses: Iterable[str], newcomer: str) -> str:
    """Return the address that holds most when `newcomer` has one more; of equals the newcomer.

    >>> heaviest(['a', 'a', 'a', 'b'], 'b')
    'a'
    >>> heaviest(['a', 'a', 'b'], 'b')
    'b'
    """
    counts = Counter(addresses)
    counts[newcomer] += 1
    most = max(counts.values())
    if counts[newcomer] == most:
        return newcomer
    return next(address for address, count in counts.items() if count == most)


class Connection(web.RequestHandler):
    """An accepted connection of an address, from before its TLS handshake to its end."""

    __slots__ = ('_held', 'accepting', 'address', 'since_s', 'state')

    def __init__(self, held: 'Connections', address: str, *args: Any, **options: Any):
        super().__init__(*args, **options)
        self._held, self.address = held, address
        self.state, self.since_s = WAITING, self._loop.time()
        self.accepting: asyncio.Task[None] | None = None

    def connection_lost(self, exc: BaseException | None) -> None:
        self._held.discard(self)
        super().connection_lost(exc)

    def drop(self) -> None:
        """Close it immediately, without sending queued data."""
        if self.transport is not None:
            self.transport.abort()
        elif self.accepting is not None:
            self.accepting.cancel()

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Mark the connection as being served while the body runs."""
        self.state, self.since_s = SERVING, self._loop.time()
        try:
            yield
        finally:
            self.state, self.since_s = WAITING, self._loop.time()


class Connections:
    """The open connections, at most `most`."""

    def __init__(self, most: int):
        self.most = most
        self._held: dict[Any, None] = {}  # in order of arrival

    def __len__(self) -> int:
        return len(self._held)

    def add(self, one: Any) -> None:
        """Add a connection, for which there is room."""
        self._held[one] = None

    def discard(self, one: Any) -> None:
        """Remove a connection."""
        self._held.pop(one, None)

    def drop_all(self) -> None:
        """Close all connections."""
        for one in list(self._held):
            one.drop()

    def make_room(self, newcomer: str) -> bool:
        """Return whether `newcomer` (an address) gets a connection; drop another one if needed."""
        if len(self) < self.most:
            return True
        address = heaviest((one.address for one in self._held), newcomer)
        victim = self._victim(address, newcomer)
        if victim is None:
            return False
        self.discard(victim)
        victim.drop()
        return True

    def _victim(self, address: str, newcomer: str) -> Any:
        """Return the connection to drop, None to refuse the newcomer."""
        theirs = [one for one in self._held if one.address == address]
        waiting = [one for one in theirs if one.state == WAITING]
        if not theirs:  # every address holds one
            waiting = [one for one in self._held if one.state == WAITING]
        if waiting:
            return min(waiting, key=_since)
        if address == newcomer:
            return None
        served = [one for one in theirs if one.state == SERVING]
        return min(served, key=_since) if served else theirs[-1]


def _since(one: Any) -> float:
    return float(one.since_s)
