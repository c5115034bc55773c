# SPDX-License-Identifier: Apache-2.0
"""The limit by field of view, against an analyser written from the standard's text."""

import itertools
import math

import numpy as np
import pytest
from support import flash_bound as sight
from support.fields_of_view import RATE_HZ, fields, most_in_a_second
from support.flashes import render

from eol_ros.core.geometry import N_BLOCKS, PITCH_M, rest_lattice
from eol_ros.core.light.local import (
    BLOCK_FALLS,
    FIRST,
    HOLD_RATE,
    PERIOD_S,
    SQUARE_FALLS,
    LocalField,
)

EYES = [(0.0, 0.0, 0.8), (0.0, -0.9, 0.6), (0.0, -1.0, 1.1), (1.0, -1.0, 0.9)]
FARTHEST = [(0.0, 0.0, 2.2), (0.0, -2.0, 1.5)]  # whose fields hold 0.006 sr
SECONDS = 3.0


@pytest.fixture(scope='module')
def areas_sr():
    return np.concatenate([fields(rest_lattice(), eye) for eye in EYES + FARTHEST])


def random_slips(random):
    """Slips of some blocks, singly and in volleys, up to 60 a second."""
    some = random.permutation(N_BLOCKS)[: random.integers(1, N_BLOCKS + 1)]
    t = np.cumsum(random.exponential(1 / random.uniform(3, 60), 200))
    slips = [(float(s), int(b)) for s, b in zip(t, random.choice(some, 200), strict=True)]
    return slips + [(float(s), int(b)) for s in t[::20] for b in some]


def adversary(period_s, offset, shape=(0, 1, 5, 6)):
    """Three of the four blocks of a square at a time, each left out in its turn."""
    turns = itertools.cycle(itertools.combinations(shape, 3))
    times = np.arange(0.0, SECONDS, period_s)
    return [(float(t), offset + b) for t, blocks in zip(times, turns, strict=False) for b in blocks]


@pytest.mark.parametrize('pitch_m', [PITCH_M, (1 - sight.NEARER) * PITCH_M])
def test_geometry_bounds_each_field_by_three_flashes(pitch_m):
    bounds = [
        sight.most_flashes(*sight.covered(view, pitch_m), BLOCK_FALLS, SQUARE_FALLS)
        for view in sight.views(n=5)
    ]

    assert 3 <= max(bounds) < 4 - 1e-6


def test_geometry_knows_fields_that_hold_more():
    near = sight.View(0.6, 30.0, 0.0, (0.0, 0.072))

    blocks, sr = sight.covered(near, 0.144)
    assert len(blocks) == 2 and sr.min() > sight.FIELD_SR
    assert sight.most_flashes(blocks, sr, 3, 11) == pytest.approx(6)


def test_one_block_covers_what_its_side_and_distance_say():
    for elevation_deg in (90.0, 45.0):
        view = sight.View(1.2, elevation_deg, 0.0, (0.0, 0.0))
        _, sr = sight.covered(view)
        true_sr = 0.084**2 * math.sin(math.radians(elevation_deg)) / 1.2**2
        assert sr.max() == pytest.approx(true_sr, rel=0.08)


def test_the_analyser_counts_a_strobe_of_one_near_block_and_none_of_a_far_one():
    lattice, strobe = rest_lattice(), np.zeros((RATE_HZ, N_BLOCKS))
    strobe[:, 12] = 0.5 + 0.5 * np.sin(2 * np.pi * 6 * np.arange(RATE_HZ) / RATE_HZ)

    assert most_in_a_second(strobe, fields(lattice, (0.0, 0.0, 0.8))) >= 5
    assert most_in_a_second(strobe, fields(lattice, (0.0, 0.0, 1.5))) == 0
    assert most_in_a_second(0.09 * strobe, fields(lattice, (0.0, 0.0, 0.8))) == 0


def test_no_field_from_3_m_on_holds_what_counts():
    lattice = rest_lattice()

    assert all(len(fields(lattice, eye)) for eye in FARTHEST)
    assert not len(fields(lattice, (0.0, 0.0, 3.0)))
    assert not len(fields(lattice, (0.0, -2.4, 1.8)))


def test_a_slip_after_rest_lights_its_block_at_once_whatever_its_neighbours_do():
    field = LocalField(0.1)
    for k in range(30):
        field.slip(k * 0.02, 7)
    field.slip(0.6, 8)

    assert field.levels(0.6)[8] == FIRST
    assert field.levels(0.7)[8] == pytest.approx(FIRST * math.exp(-1))


def test_a_slip_that_meets_light_adds_to_it():
    field = LocalField(0.1, peak=0.8)
    field.slip(0.0, 3)
    field.slip(0.0, 3)

    assert field.levels(0.0)[3] == pytest.approx(0.8)


def test_the_fourth_flash_of_a_block_is_held_for_a_second_after_the_first():
    field = LocalField(0.1)
    for k in range(4):
        field.slip(k * 0.25, 3)
    held = field.levels(0.25 + PERIOD_S)[3]

    assert held == pytest.approx(field.peak * FIRST * math.exp(-HOLD_RATE * 0.5), rel=0.05)
    assert field.levels(0.25 + PERIOD_S + 0.1)[3] == pytest.approx(held * math.exp(-1))
    assert field.lengthened == 1


@pytest.mark.parametrize(('until_s', 'from_s'), [(5.0, 5.0), (0.3, 0.2 + PERIOD_S)])
def test_a_hold_keeps_light_at_least_for_the_period(until_s, from_s):
    field = LocalField(0.1)
    field.slip(0.0, 3)
    field.hold(0.2, until_s)
    held = field.levels(from_s)[3]

    assert held > 0.7 * FIRST * math.exp(-2)
    assert field.levels(from_s + 0.1)[3] == pytest.approx(held * math.exp(-1))


def test_levels_depend_on_neither_looks_nor_the_zero_of_time():
    slips = [(0.0, 1), (0.11, 2), (0.15, 2), (0.5, 24), (0.6, 2), (0.7, 2)]
    seldom, later = LocalField(0.3), LocalField(0.3)
    often = render(LocalField(0.3), slips, 2.0, RATE_HZ)[-1]
    for t, block in slips:
        seldom.slip(t, block)
        later.slip(t, block)
    later.shift(1000.0)

    np.testing.assert_allclose(seldom.levels(239 / RATE_HZ), often, atol=1e-9)
    np.testing.assert_allclose(later.levels(1000 + 239 / RATE_HZ), often, atol=1e-6)


@pytest.mark.parametrize('decay_s', [0.02, 0.1])
def test_no_adversary_makes_a_field_flash_four_times(areas_sr, decay_s):
    free = 0
    for period_s, offset in itertools.product((0.12, 0.24, 0.25, 0.3, 0.334), (0, 6)):
        slips = adversary(period_s, offset)
        assert most_in_a_second(render(LocalField(decay_s), slips, SECONDS, RATE_HZ), areas_sr) <= 3
        open_ = render(LocalField(decay_s, limited=False), slips, SECONDS, RATE_HZ)
        free = max(free, most_in_a_second(open_, areas_sr))
    assert free > 3


@pytest.mark.parametrize('count', [25, pytest.param(1000, marks=pytest.mark.soak)])
def test_no_random_slips_make_a_field_flash_four_times(areas_sr, count):
    random, free = np.random.default_rng(count), 0
    for _ in range(count):
        decay_s, slips = float(random.choice([0.02, 0.1, 0.35])), random_slips(random)
        assert most_in_a_second(render(LocalField(decay_s), slips, SECONDS, RATE_HZ), areas_sr) <= 3
        if not free:
            open_ = render(LocalField(decay_s, limited=False), slips, SECONDS, RATE_HZ)
            free = most_in_a_second(open_, areas_sr)
    assert free > 3
