# SPDX-License-Identifier: Apache-2.0
"""Which hop made a grain late, on its way from a knock or an exposure to the mixer.

Each message bears the time at which its publisher sent it, and the sound node logs when each
trigger was taken and how long before its time (`sound.trigger_log`). The hops are the spans
between:

    felt: knock -> board (block, radio, line) -> motion -> grains -> sound (comes) -> mixer
    seen: exposure -> image (made, and sent) -> tracker -> grains -> sound (comes) -> mixer

A trigger that was late is laid to the hop that took most beyond what it usually (in the median)
takes, and told apart where the machine stood still meanwhile (benchmarks/stalls.py), when
nobody could have been in time.
"""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.stalls import overlap

NS = 1_000_000_000
HOPS = {
    'felt': ('board', 'motion', 'grains', 'sound', 'mixer'),
    'seen': ('image', 'tracker', 'grains', 'sound', 'mixer'),
}
TOPICS = ('truth', 'blocks', 'block_taps', 'felt_slips', 'grain_triggers', 'felt_triggers')
WAITED_NS = 50_000_000  # a grain that may not sound yet bears a later stamp than its knock


class Taken(NamedTuple):
    """A trigger as the sound node logs it; `spare_s` is below 0 where it was late."""

    felt: bool
    stamp_ns: int
    block: int
    grain: int
    came_ns: int
    taken_ns: int
    spare_s: float


class Passage(NamedTuple):
    """Of a trigger: when it set out and when each hop was behind it, and how long it had left."""

    felt: bool
    at_ns: tuple[int, ...]
    spare_s: float


def read_log(path: Path) -> list[Taken]:
    """Return what a sound node has logged so far; a line that is being written is left out."""
    with path.open() as file:
        rows = [row for row in csv.reader(file) if len(row) == len(Taken._fields)][1:]
    return [
        Taken(row[0] == '1', *map(int, row[1:6]), float(row[6]))
        for row in rows if row[6][-1:].isdigit()
    ]  # fmt: skip


def passages(
    log: Iterable[Taken],
    triggers: Mapping[tuple[bool, int, int, int], int],
    images: Mapping[int, tuple[int, int]],
    knocks: Mapping[tuple[int, int], tuple[int, int]],
) -> list[Passage]:
    """Return the way of each trigger of `log` that is known from end to end.

    Parameters
    ----------
    log
        What was taken.
    triggers
        When that of (felt, stamp, block, grain) was sent, ns.
    images
        By stamp, when the image and when its blocks were sent, ns.
    knocks
        By block and stamp, when the tap and when the slip that is felt were sent, ns.
    """
    stamps: dict[int, list[int]] = {}
    for block, stamp_ns in sorted(knocks):
        stamps.setdefault(block, []).append(stamp_ns)
    found = []
    for one in log:
        sent_ns = triggers.get((one.felt, one.stamp_ns, one.block, one.grain))
        begun: tuple[int, ...] | None = None
        if one.felt and one.block in stamps:
            k = int(np.searchsorted(stamps[one.block], one.stamp_ns, 'right')) - 1
            knock_ns = stamps[one.block][k]
            if k >= 0 and one.stamp_ns - knock_ns < WAITED_NS:
                begun = knock_ns, *knocks[one.block, knock_ns]
        elif not one.felt and one.stamp_ns in images:
            begun = one.stamp_ns, *images[one.stamp_ns]
        if sent_ns is not None and begun is not None:
            at_ns = *begun, sent_ns, one.came_ns, one.taken_ns
            found.append(Passage(one.felt, at_ns, one.spare_s))
    return found


def of_run(watch: Any, log: list[Taken], begin_ns: int) -> list[Passage]:
    """Return the ways of what was logged after `begin_ns`, by what `watch` saw of TOPICS."""
    from eol_ros.ros.stamps import to_ns
    from eol_ros.streams.felt import PROVISIONAL

    def sent(topic: str) -> dict[int, int]:
        stamps = (stamp for stamp, _ in watch.seen[topic])
        return dict(zip(stamps, watch.sent[topic], strict=False))

    def told(topic: str) -> Iterable[tuple[Any, int, int]]:
        for message, at_ns in zip(watch.messages(topic), watch.sent[topic], strict=False):
            yield message, to_ns(message.header.stamp), at_ns

    truths, blocks = sent('truth'), sent('blocks')
    taps = {(m.block, stamp): at for m, stamp, at in told('block_taps')}
    felt = {
        (m.block, stamp): at for m, stamp, at in told('felt_slips') if m.kind == PROVISIONAL
    }  # fmt: skip
    return passages(
        (one for one in log if one.stamp_ns > begin_ns),
        {
            (topic == 'felt_triggers', stamp, m.block, m.grain): at
            for topic in ('grain_triggers', 'felt_triggers') for m, stamp, at in told(topic)
        },
        {stamp: (truths[stamp], at) for stamp, at in blocks.items() if stamp in truths},
        {key: (taps[key], at) for key, at in felt.items() if key in taps},
    )  # fmt: skip


def figures(
    found: list[Passage], stood: list[tuple[float, float]] | None, to_steady_ns: int = 0
) -> dict[str, Any]:
    """Return by sense what each hop takes, and what made grains late.

    stood: (from, to) of each standstill of the machine, s of the steady clock, which is
    `to_steady_ns` ahead of the system's; None where that was not to be known.
    """
    result: dict[str, Any] = {}
    for sense, hops in HOPS.items():
        mine = [one for one in found if one.felt == (sense == 'felt')]
        if not mine:
            continue
        spans_ms = np.diff(np.array([one.at_ns for one in mine]), axis=1) * 1e-6
        late = np.array([one.spare_s < 0 for one in mine])
        usual = np.median(spans_ms, axis=0)
        blamed = np.argmax(spans_ms[late] - usual, axis=1) if late.any() else np.zeros(0, int)
        moments = [
            [(at + to_steady_ns) / NS for at in (one.at_ns[0], one.at_ns[-1])]
            for one in mine if one.spare_s < 0
        ]  # fmt: skip
        result[sense] = {
            'triggers': len(mine), 'late': int(late.sum()),
            'late_while_it_stood': None if stood is None else overlap(moments, stood),
            'latest_ms': -1e3 * min(0.0, *(one.spare_s for one in mine)),
            'hops': {
                hop: {
                    'p50': round(float(usual[k]), 2),
                    'p99': round(float(np.percentile(spans_ms[:, k], 99)), 2),
                    'most': round(float(spans_ms[:, k].max()), 2),
                    'made_late': int(np.sum(blamed == k)),
                }
                for k, hop in enumerate(hops)
            },
        }  # fmt: skip
    return result
