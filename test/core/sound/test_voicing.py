# SPDX-License-Identifier: Apache-2.0
"""How large a cascade is, and what its grains become."""

from dataclasses import replace

import numpy as np
import pytest
from support.paper import N_BLOCKS
from support.quiet_settings import SOUND
from support.sound_reference import noise_bank as bank
from support.sound_reference import spreading

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.cascade_area import CascadeAreas
from eol_ros.core.sound.mixer_layout import VOICE
from eol_ros.core.sound.voicing import (
    Voicing,
    bus_areas,
    bus_of,
    corners_hz,
    new_mixer,
)
from eol_ros.core.table import Table

OFF = SOUND
TABLES = [Table(), Table(rows=3, columns=4), Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))]
LARGE = Table(rows=15, columns=15, block_side_m=0.03, gap_m=0.02)


class Oracle:
    """Areas by connected components of a graph of all grains so far: slow, and plain."""

    def __init__(self, gap_ms, table):
        self.gap_ms, self.grains, self.group = gap_ms, [], []
        self.neighbours = table.neighbours

    def add(self, ms, block):
        near = {block, *self.neighbours(block, diagonal=True)}
        last = {}
        for k, (_, other) in enumerate(self.grains):
            last[other] = k  # what counts is when a block sounded last
        linked = {
            self.group[k] for b, k in last.items()
            if b in near and ms - self.grains[k][0] <= self.gap_ms
        }  # fmt: skip
        mine = min(linked, default=len(self.grains))
        self.group = [mine if g in linked else g for g in self.group] + [mine]
        self.grains.append((ms, block))
        members = [self.grains[k] for k, g in enumerate(self.group) if g == mine]
        return len({b for _, b in members}), ms - min(m for m, _ in members)


@pytest.mark.parametrize('table', TABLES)
@pytest.mark.parametrize('seed', range(6))
def test_areas_agree_with_connected_components(seed, table):
    rng = np.random.default_rng(seed)
    ms = np.cumsum(rng.choice([0, 3, 17, 40, 120, 400], 300, p=[0.3, 0.2, 0.2, 0.15, 0.1, 0.05]))
    blocks = rng.choice(table.ids, 300)
    cascades, oracle = CascadeAreas(0.1, table), Oracle(100, table)
    for t, block in zip(ms.tolist(), blocks.tolist(), strict=True):
        area, since_ms, _ = cascades.add(1e-3 * t, block)
        assert (area, since_ms) == oracle.add(t, block)


def test_areas_do_not_hang_on_where_the_time_axis_begins():
    rng = np.random.default_rng(3)
    stamps = np.cumsum(rng.choice([0.0, 1 / 60, 1 / 30, 0.15, 0.5], 400))
    blocks = rng.integers(0, N_BLOCKS, 400).tolist()
    found = []
    for begin_s in (0.0, 0.025, 1234.5678, 86400.1, 3e6):
        cascades = CascadeAreas(0.15)
        times = (begin_s + stamps).tolist()
        found.append([cascades.add(*pair) for pair in zip(times, blocks, strict=True)])
    assert all(f == found[0] for f in found[1:])


def test_off_is_the_plain_voices():
    t = spreading(25)
    rows, refused = Voicing(OFF).rows(t, bank())
    sound = bank()
    plain = voice_rows(t, sound, 2)
    made, _ = Voicing(OFF).rows(t, sound)
    assert made.tobytes() == plain.tobytes()
    assert len(rows) == 25 and not refused.any()
    assert new_mixer(OFF).memory.mix.shape[0] == 2  # and has no room for what is off


def test_speed_falls_as_the_root_of_the_area():
    rows, _ = Voicing(replace(OFF, rate_scaling=1.0)).rows(spreading(25), bank())
    assert np.allclose(rows['rate'], np.arange(1, 26) ** -0.5, rtol=1e-6)
    rows, _ = Voicing(replace(OFF, rate_scaling=0.5)).rows(spreading(25), bank())
    assert np.allclose(rows['rate'], np.arange(1, 26) ** -0.25, rtol=1e-6)


@pytest.mark.parametrize('table', [*TABLES[:2], LARGE])
def test_corners_fall_as_the_root_of_the_area(table):
    area = np.arange(1, table.count + 1)
    bus = bus_of(area)
    assert (bus.min(), bus.max()) == (0, len(bus_areas(table)) - 1)
    wanted = 8000 / np.sqrt(area)
    off = np.log2(corners_hz(8000.0, table)[bus] / wanted)
    assert np.abs(off).max() <= 1 / 8 + 1e-9  # of an octave
    settings = replace(OFF, corner_hz=8000.0)
    slips = spreading(table.count, 0.001, columns=table.columns)
    rows, _ = Voicing(settings, table).rows(slips, bank())
    assert len(new_mixer(settings, table=table).memory.mix) == 2 * len(bus_areas(table))
    assert (rows['channel_a'] // 2 == bus).all() and (rows['channel_b'] // 2 == bus).all()


@pytest.mark.parametrize('table', TABLES[:2])
def test_dynamics_go_from_a_single_slip_to_all_blocks(table):
    settings = replace(OFF, dynamics_db=20.0)
    slips = spreading(table.count, columns=table.columns)
    rows, _ = Voicing(settings, table).rows(slips, bank())
    level_db = 20 * np.log10(np.hypot(rows['gain_a'], rows['gain_b']))
    assert level_db[0] == pytest.approx(-20, abs=1e-4) and level_db[-1] == pytest.approx(0)
    assert (np.diff(level_db) > 0).all()


def test_the_beginning_leaves_room():
    settings = replace(OFF, onset_duck_db=12.0, onset_duck_s=0.05)
    rows, _ = Voicing(settings).rows(spreading(8, step_s=0.01), bank())
    level_db = 20 * np.log10(np.hypot(rows['gain_a'], rows['gain_b']))
    wanted = -12 * np.maximum(0, 1 - np.arange(8) / 5)
    assert np.abs(level_db - wanted).max() < 0.01


def test_one_by_one_and_all_at_once_are_the_same():
    settings = replace(OFF, rate_scaling=1.0, corner_hz=6000.0, dynamics_db=15.0, sub_db=-6.0)
    sound, t = bank(), spreading(25)
    t['block'][::6] = -1  # of nobody: part of no cascade
    whole, _ = Voicing(settings).rows(t, sound)
    live = Voicing(settings)
    rows = np.concatenate([live.rows(t[k : k + 1], sound)[0] for k in range(25)])
    assert rows.dtype == VOICE and rows.tobytes() == whole.tobytes()
    grains = whole[whole['source'] == sound.address[0]]
    assert len(whole) == 25 + 20 and (grains['rate'][::6] == 1).all()


def test_what_cannot_be_played_is_told_and_part_of_no_cascade():
    t = spreading(4)
    t['time_s'][1], t['gain'][2] = np.nan, -1
    rows, refused = Voicing(replace(OFF, rate_scaling=1.0)).rows(t, bank())
    assert refused.tolist() == [False, True, True, False]
    assert np.allclose(rows['rate'], [1, 1])  # block 3 does not touch block 0


@pytest.mark.parametrize('rate_scaling', [0.0, 1.0])
def test_a_grain_too_short_to_sound_is_refused_with_the_rest(rate_scaling):
    noise = np.ones(48000, np.float32)
    grains = Bank([noise], [0, 0], [0.0, 0.5], [0.25, 3 / 48000], 48000)
    t = spreading(4)
    t['grain'], t['gain'][0] = (0, 1, 0, 1), -1
    rows, refused = Voicing(replace(OFF, rate_scaling=rate_scaling)).rows(t, grains)
    assert refused.tolist() == [True, True, False, True] and len(rows) == 1
