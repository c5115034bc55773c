# SPDX-License-Identifier: Apache-2.0
"""A power cut costs at most the last second, and never the bag."""

import os
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from support.bag_samples import POINT, T0, TEXT, point
from support.forgetful_disk import Clock, ForgetfulDisk

from eol_ros.devices.bag.mcap_file import BagMessage
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recording import Machine, Recording, Roles
from eol_ros.devices.bag.recover import repair_all
from eol_ros.errors import BagDamaged
from eol_ros.settings import RecorderSettings

CUTS = 40
SECONDS = 9.0
MOST_LOST_S = 1.2
SLOW_S = 0.15  # a sync takes up to so long
SETTINGS = RecorderSettings(
    images='all', min_free_gb=0.0, sync_s=1.0, split_minutes=0.05, split_gb=0.001
)


def picture(i: int, rng) -> bytes:
    noise = rng.integers(0, 256, 1000, dtype=np.uint8).tobytes()
    return struct.pack('<4BI', 0, 1, 0, 0, i) + noise + bytes(70_000)


def record(root: Path, settings: RecorderSettings, seed: int):
    """Record 60 blocks and 10 images a second; return disk, clock, what was sent, start."""
    rng = np.random.default_rng(seed)
    clock = Clock()
    disk = ForgetfulDisk(clock, rng, SLOW_S)
    recording = Recording(
        root, 'cut', [POINT, TEXT], {'scene': 'x'}, settings, Roles('/eol/text'),
        Machine(clock, disk, threaded=False),
    )  # fmt: skip
    begun, sent, i = clock(), [], 0
    tick_s = begun
    while tick_s < begun + SECONDS:
        while tick_s <= clock():  # a sync takes time, and messages come meanwhile
            now = T0 + round(tick_s * 1e9)
            items = [BagMessage('/eol/point', point(i), now, now, i + 1)]
            if i % 6 == 0:
                items.append(BagMessage('/eol/text', picture(i, rng), now + 1, now, i + 1))
            for item in items:
                sent.append(item)
                recording.take(item)
            i += 1
            tick_s += 1 / 60
        recording.pump()
        clock.now_s = max(clock(), tick_s)
    recording.close()
    return disk, clock, sent, begun


def read(folder: Path) -> list[tuple]:
    with warnings.catch_warnings():  # pages of the last second may be missing
        warnings.simplefilter('ignore', BagDamaged)
        messages = list(BagReader(folder).messages())
    return sorted((m.topic, m.log_ns, m.sequence, m.data) for m in messages)


@pytest.mark.slow
def test_forty_power_cuts_cost_at_most_a_second_each(tmp_path, monkeypatch):
    for name in ('fsync', 'fdatasync'):  # of the repair, which is not what is cut here
        monkeypatch.setattr(os, name, lambda handle: None)
    root = tmp_path / 'bags'
    disk, clock, sent, begun = record(root, SETTINGS, seed=5)
    [run] = root.glob('cut_*')
    assert len(list(run.glob('*.mcap'))) >= 3
    everything = {(m.topic, m.log_ns, m.sequence, m.data) for m in sent}
    rng = np.random.default_rng(6)
    worst_s = 0.0
    for k, cut_s in enumerate(rng.uniform(begun, clock(), CUTS)):
        place = tmp_path / f'cut_{k}'
        disk.after_cut(cut_s, root, place, rng)
        left = read(place / run.name)
        assert len(left) == len(set(left)) and everything.issuperset(left), cut_s
        missing = everything.difference(left)
        oldest_ns = min((m[1] for m in missing), default=T0 + round(cut_s * 1e9))
        worst_s = max(worst_s, cut_s - (oldest_ns - T0) * 1e-9)
        assert worst_s <= MOST_LOST_S, cut_s
        list(repair_all(place))
        whole = [p for p in place.glob('*/*') if p.suffix == '.mcap']
        assert not list(place.glob('*/*.part')) and not list(place.glob('*/*.repair'))
        if left:
            assert read(place / run.name) == left
        for path in whole if k % 10 == 0 else ():  # an independent reader takes it, too
            with open(path, 'rb') as file:
                found = list(make_reader(file, validate_crcs=True).iter_messages())
            assert len(found) == sum(BagReader(path).counts.values())
    assert worst_s > 0.5  # the cuts did cut something


def test_without_sync_much_more_would_be_lost(tmp_path):
    """The disk does forget: this is what the test above proves the sync against."""
    root = tmp_path / 'bags'
    settings = RecorderSettings(images='all', min_free_gb=0.0, sync_s=0.0)
    disk, _, sent, _ = record(root, settings, seed=5)
    [run] = root.glob('cut_*')
    rng = np.random.default_rng(7)
    disk.after_cut(SECONDS / 2, root, tmp_path / 'cut', rng)
    left = read(tmp_path / 'cut' / run.name)
    half = [m for m in sent if m.log_ns < T0 + SECONDS / 2 * 1e9]
    kept = {m[1] for m in left}
    oldest_ns = min(m.log_ns for m in half if m.log_ns not in kept)
    assert oldest_ns < T0 + (SECONDS / 2 - 3) * 1e9
