# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag, many at a time: of each topic its times as columns, and its data."""

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.opcode import Opcode

from eol_ros.devices.bag.scan import HEAD, MESSAGE_HEAD, edges_in

if TYPE_CHECKING:
    from eol_ros.devices.bag.file import BagMessage

MESSAGE_DTYPE = np.dtype(
    [('channel', '<u2'), ('sequence', '<u4'), ('log_ns', '<u8'), ('publish_ns', '<u8')]
)


class Batch(NamedTuple):
    """Messages of one topic in order of reception: times (n,) int64 in ns, and their data."""

    log_ns: np.ndarray
    publish_ns: np.ndarray
    data: list[bytes]

    def part(self, first: int, last: int) -> 'Batch':
        """Return some of them, by number."""
        rows = slice(first, last)
        return Batch(self.log_ns[rows], self.publish_ns[rows], self.data[rows])

    def split(self, at_ns: int) -> tuple['Batch', 'Batch']:
        """Return those received before `at_ns`, and the others."""
        n = int(np.searchsorted(self.log_ns, at_ns))
        return self.part(0, n), self.part(n, len(self.data))


def joined(batches: list[Batch]) -> Batch:
    """Return batches as one, in order of reception."""
    if len(batches) == 1:
        return batches[0]
    log_ns, publish_ns = (np.concatenate([b[k] for b in batches]) for k in (0, 1))
    data = [message for batch in batches for message in batch.data]
    if np.any(log_ns[1:] < log_ns[:-1]):
        order = np.argsort(log_ns, kind='stable')
        log_ns, publish_ns = log_ns[order], publish_ns[order]
        data = [data[i] for i in order.tolist()]
    return Batch(log_ns, publish_ns, data)


def batch_of(some: Sequence['BagMessage']) -> Batch:
    """Return messages of one topic, in order of reception, as a batch."""
    times = ([m.log_ns for m in some], [m.publish_ns for m in some])
    log_ns, publish_ns = (np.array(column, np.int64) for column in times)
    return Batch(log_ns, publish_ns, [m.data for m in some])


def batches_in(data: bytes, channels: Collection[int]) -> dict[int, Batch]:
    """Return the messages of these `channels` in a chunk, by channel; raise DamagedRecord.

    Nothing is made for each message but its data: a day of them is read in a quarter of the time.
    """
    raw, edges = np.frombuffer(data, 'u1'), np.array(edges_in(data))
    told = np.flatnonzero(raw[edges[:-1]] == Opcode.MESSAGE)
    begins, ends = edges[told] + HEAD.size, edges[told + 1]
    heads = raw[begins[:, None] + np.arange(MESSAGE_HEAD.size)].view(MESSAGE_DTYPE)[:, 0]
    found = {}
    for channel in channels:
        own = np.flatnonzero(heads['channel'] == channel)
        if not len(own):
            continue
        own = own[np.argsort(heads['log_ns'][own], kind='stable')]
        spans = zip((begins[own] + MESSAGE_HEAD.size).tolist(), ends[own].tolist(), strict=True)
        found[channel] = Batch(
            heads['log_ns'][own].astype(np.int64), heads['publish_ns'][own].astype(np.int64),
            [data[begin:end] for begin, end in spans],
        )  # fmt: skip
    return found
