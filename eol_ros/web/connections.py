# SPDX-License-Identifier: Apache-2.0
"""Shares of the connections: when all are taken, the address that holds most gives one up.

An address that is alone may hold all of them. One connection that waits for a request is like
another, whether it has sent half a header or is kept alive, so the oldest of these goes first.
"""

import asyncio
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from aiohttp import web

WAITING, SERVING, VIEWING = range(3)  # for a whole request, a request, a WebSocket


def heaviest(addresses: Iterable[str], newcomer: str) -> str:
    """Return the address that holds most once `newcomer` has one more; of equals the newcomer.

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
    """One accepted connection, of an address, from before its TLS handshake to its end."""

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
        """Close it at once, whatever waits to be sent."""
        if self.transport is not None:
            self.transport.abort()
        elif self.accepting is not None:
            self.accepting.cancel()

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Count as one that is served."""
        self.state, self.since_s = SERVING, self._loop.time()
        try:
            yield
        finally:
            self.state, self.since_s = WAITING, self._loop.time()


class Connections:
    """The connections that are held, at most `most`."""

    def __init__(self, most: int):
        self.most = most
        self._held: dict[Any, None] = {}  # as they came

    def __len__(self) -> int:
        return len(self._held)

    def add(self, one: Any) -> None:
        """Hold one more, for which there is room."""
        self._held[one] = None

    def discard(self, one: Any) -> None:
        """Hold it no longer."""
        self._held.pop(one, None)

    def drop_all(self) -> None:
        """Close all of them."""
        for one in list(self._held):
            one.drop()

    def make_room(self, newcomer: str) -> bool:
        """Return whether a connection of address `newcomer` can be held; drop another for it."""
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
        """Return the connection to drop, None if the newcomer has to go."""
        theirs = [one for one in self._held if one.address == address]
        waiting = [one for one in theirs if one.state == WAITING]
        if not theirs:  # so many addresses that each holds one
            waiting = [one for one in self._held if one.state == WAITING]
        if waiting:
            return min(waiting, key=_since)
        if address == newcomer:
            return None
        served = [one for one in theirs if one.state == SERVING]
        return min(served, key=_since) if served else theirs[-1]


def _since(one: Any) -> float:
    return float(one.since_s)
