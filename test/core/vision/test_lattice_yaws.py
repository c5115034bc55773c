# SPDX-License-Identifier: Apache-2.0
"""Blocks that stand crooked, each its own way, tell quarter turns apart; others say nothing."""

import numpy as np
import pytest
from support.stick_slip import Onlooker, Table

from eol_ros.core.vision.identity.identity import Identity
from eol_ros.core.vision.identity.symmetry import UNTURNED
from eol_ros.core.vision.identity.yaw_signature import BLOCKS, ENOUGH, Yaws
from eol_ros.errors import ConfigError

ALL = np.ones(25, bool)


def learnt(random, offsets, scatter=0.01, looks=2 * ENOUGH, seen=ALL):
    yaws = Yaws()
    for k in range(looks):
        xy = random.normal(0, 0.01, (25, 2))
        yaws.learn(k * 1.0, xy, offsets + random.normal(0, scatter, 25) + 0.02 * np.sin(k), seen)
    return yaws


@pytest.mark.parametrize('quarters', [0, 1, 2, 3])
def test_crooked_blocks_tell_the_turn_even_with_some_hidden(quarters):
    random = np.random.default_rng(quarters)
    offsets = random.normal(0, 0.05, 25)
    yaws = learnt(random, offsets)
    for _ in range(50):
        true = offsets + random.normal(0, 0.01, 25)
        true[random.integers(0, 25)] += 0.5  # one was knocked
        # The block b stands where the names so far say UNTURNED[quarters, b].
        yaw_offsets = np.empty(25)
        yaw_offsets[UNTURNED[quarters]] = true
        held = random.random(25) > 0.2
        assert yaws.quarters(yaw_offsets + 0.03, held) == quarters


def test_learns_mean_and_scatter_without_what_all_have_in_common():
    random = np.random.default_rng(5)
    offsets = random.normal(0, 0.05, 25)
    yaws = learnt(random, offsets, looks=4000)
    # With a memory of 200 looks the mean is known to 0.01 / sqrt(200 * 2) or so.
    assert np.abs(yaws.mean - yaws.mean.mean() - offsets + offsets.mean()).max() < 0.004
    assert np.sqrt(yaws.variance) == pytest.approx(0.01, rel=0.3)


@pytest.mark.parametrize('scatter', [0.0, 0.002, 0.05])
def test_blocks_that_stand_alike_say_nothing(scatter):
    random = np.random.default_rng(6)
    yaws = learnt(random, np.zeros(25), scatter)
    assert all(yaws.quarters(random.normal(0, scatter, 25), ALL) is None for _ in range(300))


def test_covers_that_were_exchanged_in_the_dark_say_nothing():
    random = np.random.default_rng(7)
    yaws = learnt(random, random.normal(0, 0.05, 25))
    answers = [yaws.quarters(random.normal(0, 0.05, 25), ALL) for _ in range(1000)]
    assert answers.count(None) == 1000


def test_a_table_at_rest_is_looked_at_once_and_few_looks_decide_nothing():
    random = np.random.default_rng(8)
    offsets, xy = random.normal(0, 0.05, 25), random.normal(0, 0.01, (25, 2))
    yaws = Yaws()
    for k in range(1000):
        yaws.learn(k * 1.0, xy, offsets, ALL)
    assert yaws.looks.max() == 1 and yaws.quarters(offsets, ALL) is None
    yaws = learnt(random, offsets)
    assert yaws.quarters(offsets, ALL) == 0
    few = np.arange(25) < BLOCKS - 1
    assert yaws.quarters(offsets, few) is None
    assert learnt(random, offsets, looks=ENOUGH - 1).quarters(offsets, ALL) is None


def test_a_block_that_was_never_seen_neither_helps_nor_harms():
    random = np.random.default_rng(9)
    offsets = random.normal(0, 0.05, 25)
    yaws = learnt(random, offsets, seen=np.arange(25) != 7)
    for q in range(4):
        yaw_offsets = np.empty(25)
        yaw_offsets[UNTURNED[q]] = offsets + random.normal(0, 0.01, 25)
        assert yaws.quarters(yaw_offsets, ALL) == q


@pytest.mark.parametrize('quarters', range(4))
def test_what_was_learnt_tells_the_turn_in_another_life_too(quarters):
    random = np.random.default_rng(10)
    offsets = random.normal(0, 0.05, 25)
    before = learnt(random, offsets)
    after = Yaws.unpacked(before.packed())
    yaw_offsets = np.empty(25)
    yaw_offsets[UNTURNED[quarters]] = offsets
    assert after.quarters(yaw_offsets, ALL) == quarters
    assert (after.looks == before.looks).all()
    assert np.allclose([after.mean, after.variance], [before.mean, before.variance], rtol=1e-6)


@pytest.mark.parametrize('junk', [b'', b'x' * 299, np.full(75, np.nan, '<f4').tobytes()])
def test_what_is_no_yaw_offset_is_refused_in_one_line(junk):
    with pytest.raises(ConfigError, match='75 finite numbers'):
        Yaws.unpacked(junk)


@pytest.mark.slow
@pytest.mark.parametrize('askew_rad', [0.05, 0.0])
def test_after_darkness_a_crooked_table_is_known_at_once_and_without_taps(askew_rad):
    table, onlooker = Table(4, 60.0, askew_rad=askew_rad), Onlooker(4, losses_per_hour=0.0)
    identity = Identity()
    c, s = 0.0, 1.0  # somebody turns everything by a right angle in the dark
    for k in range(3600):
        moment = table.step()
        if k == 3400:
            onlooker.dark_until_s = moment.stamp_s + 1.5
        seen = onlooker.look(moment)
        xy = seen.xy @ np.array([[c, s], [-s, c]]) if k >= 3400 else seen.xy
        identity.update(moment.stamp_s, xy, seen.yaw, seen.sigma)
    lattice = identity.lattice
    assert lattice.state == 1 and lattice.ambiguous == (askew_rad == 0.0)
    if askew_rad:
        held = lattice.index >= 0
        assert list(seen.true[lattice.index[held]]) == list(np.flatnonzero(held))
        assert np.cos(lattice.angle - table.rim[2] - np.pi / 2) > 0.9
