# SPDX-License-Identifier: Apache-2.0
"""Queue of messages to be written, which drops images when it is full. Pure bookkeeping."""

from collections import Counter, deque
from typing import NamedTuple

from eol_ros.devices.bag.mcap_file import BagMessage
from eol_ros.devices.bag.selection import Dropped, Slipping

HEAD = 12  # bytes of a message, to the end of its stamp


class Waiting(NamedTuple):
    """An entry: its place in the order of arrival, when it came (s of the steady clock), what."""

    order: int
    came_s: float
    item: BagMessage | Slipping | Dropped


class Backlog:
    """Queue of messages in order of arrival.

    An image (a message of topic `images`) is dropped if it does not fit into `limit` bytes. Any
    other message drops the images that have waited longest, and is queued beyond `limit` when no
    image is left. Only a disk that does not answer fills `most` bytes; then these messages are
    dropped, too. A dropped message leaves a `Dropped` in its place, and `dropped` counts it.
    """

    def __init__(self, limit: int, images: str, most: int):
        self.bytes = 0  # of what waits, and of what was taken out and is not `done`
        self.dropped: Counter[str] = Counter()
        self._limit, self._most, self._images = limit, most, images
        self._order = 0
        self._pictures: deque[Waiting] = deque()
        self._rest: deque[Waiting] = deque()

    def __len__(self) -> int:
        return len(self._pictures) + len(self._rest)

    def put(self, came_s: float, item: BagMessage | Slipping) -> None:
        """Queue `item`, or a `Dropped` if there is no room."""
        self._order += 1
        entry = Waiting(self._order, came_s, item)
        if not isinstance(item, BagMessage):
            self._rest.append(entry)
            return
        picture, size = item.topic == self._images, len(item.data)
        if not picture and self.bytes + size > self._limit:
            self._make_room(self.bytes + size - self._limit)
        if self.bytes + size > (self._limit if picture else self._most):
            entry = self._without_data(entry)
        else:
            self.bytes += size
        (self._pictures if picture else self._rest).append(entry)

    def pop(self) -> Waiting | None:
        """Take out what has waited longest; None when nothing waits."""
        first = [queue for queue in (self._pictures, self._rest) if queue]
        return min(first, key=lambda queue: queue[0].order).popleft() if first else None

    def done(self, entry: Waiting) -> None:
        """Say that what was taken out is written, and its memory free."""
        if isinstance(entry.item, BagMessage):
            self.bytes -= len(entry.item.data)

    def _make_room(self, size: int) -> None:
        """Drop images, those first that have waited longest, until `size` bytes are free."""
        for index, entry in enumerate(self._pictures):
            if size <= 0:
                break
            if isinstance(entry.item, BagMessage):
                size -= len(entry.item.data)
                self.bytes -= len(entry.item.data)
                self._pictures[index] = self._without_data(entry)

    def _without_data(self, entry: Waiting) -> Waiting:
        item = entry.item
        assert isinstance(item, BagMessage)
        self.dropped[item.topic] += 1
        return entry._replace(item=Dropped(item.topic, item.data[:HEAD], item.sequence))
