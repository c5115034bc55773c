# SPDX-License-Identifier: Apache-2.0
"""Batches of messages of a bag: heads as columns, and data."""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode

from eol_ros.devices.bag.scan import HEAD, MESSAGE_HEAD, edges_in

MESSAGE_DTYPE = np.dtype(
    [('channel', '<u2'), ('sequence', '<u4'), ('log_ns', '<u8'), ('publish_ns', '<u8')]
)


class Batch(NamedTuple):
    """Messages in order of reception: heads (n,) MESSAGE_DTYPE, and their data."""

    heads: np.ndarray
    data: list[bytes]

    @property
    def log_ns(self) -> np.ndarray:
        """Times of reception, (n,) int64 in ns."""
        return self.heads['log_ns'].astype(np.int64)

    @property
    def publish_ns(self) -> np.ndarray:
        """Times of sending, (n,) int64 in ns."""
        return self.heads['publish_ns'].astype(np.int64)

    def part(self, first: int, last: int) -> 'Batch':
        """Return some of them, by number."""
        return Batch(self.heads[first:last], self.data[first:last])

    def split(self, at_ns: int) -> tuple['Batch', 'Batch']:
        """Return those received before `at_ns`, and the others."""
        last = np.uint64(min(max(at_ns, 1), 1 << 64) - 1)  # times are of 64 bits without a sign
        n = int(np.searchsorted(self.heads['log_ns'], last, 'right')) if at_ns > 0 else 0
        return self.part(0, n), self.part(n, len(self.data))

    def by_channel(self) -> Iterator[tuple[int, 'Batch']]:
        """Yield each channel with its messages."""
        for channel in dict.fromkeys(self.heads['channel'].tolist()):
            rows = np.flatnonzero(self.heads['channel'] == channel)
            yield channel, Batch(self.heads[rows], [self.data[i] for i in rows.tolist()])


NOTHING = Batch(np.zeros(0, MESSAGE_DTYPE), [])


def joined(batches: Sequence[Batch]) -> Batch:
    """Return batches as one, in order of reception."""
    batches = [batch for batch in batches if batch.data] or [NOTHING]
    if len(batches) == 1:
        return batches[0]
    heads = np.concatenate([batch.heads for batch in batches])
    data = list(itertools.chain.from_iterable(batch.data for batch in batches))
    if np.any(heads['log_ns'][1:] < heads['log_ns'][:-1]):
        order = np.argsort(heads['log_ns'], kind='stable')
        heads, data = heads[order], [data[i] for i in order.tolist()]
    return Batch(heads, data)


def heads_in(
    data: bytes, found: list[int] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the heads of the messages in a chunk, and the begins and ends of their data.

    found: the edges of its records, if known. Raises DamagedRecord.
    """
    raw, edges = np.frombuffer(data, 'u1'), np.array(found or edges_in(data))
    messages = np.flatnonzero(raw[edges[:-1]] == Opcode.MESSAGE)
    begins, ends = edges[messages] + HEAD.size, edges[messages + 1]
    heads = raw[begins[:, None] + np.arange(MESSAGE_HEAD.size)].view(MESSAGE_DTYPE)[:, 0]
    return heads, begins + MESSAGE_HEAD.size, ends


def span_of(heads: np.ndarray) -> tuple[int, int]:
    """Return the first and the last time of reception; (0, 0) without messages."""
    times = heads['log_ns']
    return (int(times.min()), int(times.max())) if len(times) else (0, 0)


def batch_in(data: bytes, numbers: np.ndarray) -> Batch:
    """Return the messages of selected channels in a chunk; raise DamagedRecord.

    numbers: (65536,) new number of each channel, -1 for channels that are left out.
    """
    heads, begins, ends = heads_in(data)
    channels = numbers[heads['channel']]
    rows = np.flatnonzero(channels >= 0)
    rows = rows[np.argsort(heads['log_ns'][rows], kind='stable')]
    heads = heads[rows]
    heads['channel'] = channels[rows]
    spans = zip(begins[rows].tolist(), ends[rows].tolist(), strict=True)
    return Batch(heads, [data[begin:end] for begin, end in spans])
