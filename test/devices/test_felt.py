# SPDX-License-Identifier: Apache-2.0
"""The twin's blocks feel their slips, and hardly anything else."""

import numpy as np
import pytest
from support.true_slips import Twin, compare

from eol_ros.core.motion.felt import CONFIRMED, PROVISIONAL, RETRACTED, Knock
from eol_ros.core.motion.motion import Motion
from eol_ros.core.physics.twin.accelerometer import Sensing
from eol_ros.core.physics.twin.live import SOFT
from eol_ros.devices.board import block
from eol_ros.devices.board.felt import FeltBlocks
from eol_ros.settings import MotionSettings, TwinSettings

pytestmark = pytest.mark.skipif(
    not block.compiled(), reason='in a checkout: python setup.py build_ext --inplace'
)
FPS = 60


def play(seconds, seed=3, drop=0.25, coupling=None, **sensing):
    """Slips, and what was reported: (time, block, time)."""
    twin = Twin(seed, drop, coupling=coupling)
    blocks = FeltBlocks(TwinSettings(seed=seed), sensing=Sensing(**sensing))
    knocks = []
    for begin_s, end_s in twin.images(seconds * FPS):
        knocks += blocks.advance(begin_s, end_s, twin.table.trace, twin.rim.velocity)
    return twin.all_slips(), knocks


@pytest.fixture(scope='module')
def minute():
    return play(60)


@pytest.mark.slow
def test_slips_are_felt_at_their_moment_and_little_else(minute):
    slips, knocks = minute
    row = compare(slips, [(k.time_s, k.block, k.time_s) for k in knocks], 60)

    assert row['over_2mm']['slips'] > 200
    assert row['over_2mm']['found'] >= 0.99
    assert row['onset_rms_ms'] < 0.3
    assert row['false_per_h'] <= 120  # two in the minute
    felt = [k.strength_mps2 for k in knocks]
    assert 1.5 < np.percentile(felt, 5) < np.percentile(felt, 95) < 3.5  # (mu_s - mu_k) g is 2.45


def test_hands_that_only_let_go_do_not_knock():
    """The rim settles exponentially, and its velocity is never quite zero again."""
    hands = Sensing(rim_hits_per_min=600, rim_hit_mg=500)
    for speed, struck in ((1e-6, False), (0.05, True)):
        blocks = FeltBlocks(TwinSettings(), sensing=hands)
        velocity = np.array([speed, 0.0, 0.0])
        knocks = [
            knock
            for k in range(2 * FPS)
            for knock in blocks.advance(k / FPS, (k + 1) / FPS, None, velocity)
        ]
        assert bool(knocks) == struck


@pytest.mark.slow
def test_blocks_that_slept_say_so_with_their_first_knock():
    twin, blocks = Twin(3, 0.25, coupling=SOFT), FeltBlocks(TwinSettings(seed=3))
    for k in range(70 * FPS):
        assert blocks.advance(k / FPS, (k + 1) / FPS, None, np.zeros(3)) == []
    assert blocks.sensors.asleep.all()
    knocks = []
    for begin_s, end_s in twin.images(10 * FPS):
        trace = twin.table.trace
        knocks += blocks.advance(70 + begin_s, 70 + end_s, trace, twin.rim.velocity)
    first = {}
    for knock in knocks:
        assert knock.woke == (knock.block not in first)
        first.setdefault(knock.block, knock)
    onsets = [(70 + s.onset_s, s.block) for s in twin.all_slips()]
    errors = [
        min((k.time_s - t for t, b in onsets if b == k.block), key=abs) for k in first.values()
    ]
    assert len(errors) > 10 and np.sqrt(np.mean(np.square(errors))) < 6e-3


@pytest.mark.slow
def test_motion_tells_the_slips_that_the_twin_feels_and_retracts_hardly_any():
    """Hands that knock the rim ten times as often and three times as hard as usual."""
    twin = Twin(3, 0.25)
    hands = Sensing(rim_hits_per_min=20, rim_hit_mg=30)
    blocks = FeltBlocks(TwinSettings(seed=3), sensing=hands)
    motion, random = Motion(MotionSettings()), np.random.default_rng(4)
    told, seconds, seen = [], 40, np.ones(25, bool)
    for begin_s, end_s in twin.images(seconds * FPS):
        for k in blocks.advance(begin_s, end_s, twin.table.trace, twin.rim.velocity):
            knock = Knock(round(k.time_s * 1e9), k.block, 5e-4, k.strength_mps2)
            told += motion.tap(knock)
        x, y = np.stack([twin.table.x, twin.table.y]) + random.normal(0, 9e-6, (2, 25))
        motion.update(end_s, x, y, seen)
        told += motion.felt_slips()

    first = [one for one in told if one.kind == PROVISIONAL]
    row = compare(
        twin.all_slips(), [(k.knock.stamp_s, k.block, k.knock.stamp_s) for k in first], seconds
    )
    assert row['over_2mm']['slips'] > 200
    assert row['over_2mm']['found'] >= 0.98  # 99 % are felt, and the strongest of a few retracted
    assert row['onset_rms_ms'] < 0.5
    retracted = sum(one.kind == RETRACTED for one in told)
    assert retracted <= 0.01 * len(first)
    confirmed = sum(one.kind == CONFIRMED for one in told)
    assert 0 <= len(first) - confirmed - retracted <= 10  # the last have no verdict yet
