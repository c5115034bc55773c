# SPDX-License-Identifier: Apache-2.0
"""Grains for slips that blocks felt, and that images ask for again."""

import dataclasses
import math

import numpy as np
import pytest
from support.paper import rest_lattice
from support.quiet_settings import GRAINS as SETTINGS

from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.select import SLIP_S, Selector
from eol_ros.core.sound.senses import SAME_S, FirstSense

FPS = 60
# One every 6 cm, all at different distances from any block.
PLACES = np.stack(np.meshgrid(np.arange(20), np.arange(20)), 2).reshape(-1, 2) / 19
PLACES = PLACES * 0.95 + np.random.default_rng(5).random(PLACES.shape) * 0.02
ALL, SIGMA = np.ones(25, bool), np.full(25, 1e-5)


def space():
    grains = np.zeros(len(PLACES), GRAIN)
    grains['x'], grains['y'] = PLACES.T
    grains['duration_s'] = 0.25
    return Corpus((Source('a.wav', 48000, 99.0, ''),), grains)


def near(x, y, settings=SETTINGS):
    """Return the grains within reach of a place, the nearest first."""
    far = [
        (math.hypot((gx - 0.5) * settings.space_m - x, (gy - 0.5) * settings.space_m - y), n)
        for n, (gx, gy) in enumerate(PLACES)
    ]
    return [n for away, n in sorted(far) if away <= settings.radius]


def slips(selector, felt, seconds=6.0):
    """Block 12 slips 8 mm every second; return what images and knocks sound.

    felt: whether the block feels it, which is told one image later.
    """
    by_image, by_knock = [], []
    for k in range(round(seconds * FPS)):
        t = k / FPS
        x, y = rest_lattice().T.copy()
        x[12] += sum(min(1.25 * max(t - s, 0.0) ** 2, 0.008) for s in range(1, int(seconds)))
        at_s = (k - 1) // FPS + 0.002
        if felt and k > FPS and (k - 1) % FPS == 0:
            by_knock += selector.felt(at_s, 12, 0.008 * (at_s // 1 - 1), 0.0, 2.9).tolist()
        by_image += selector.update(t, x, y, ALL, SIGMA).tolist()
    return by_image, by_knock


@pytest.mark.parametrize('choose', ['all', 'nearest', 'k'])
def test_a_felt_slip_sounds_what_its_block_reaches_where_it_rests(choose):
    settings = dataclasses.replace(SETTINGS, choose=choose, k=2, radius=0.1)
    for block in (0, 7, 12, 24):
        x, y = rest_lattice()[block]
        found = Selector(settings, space()).felt(3.5, block, x, y, 2.9)

        expected = near(x, y, settings)[: {'all': None, 'nearest': 1, 'k': 2}[choose]]
        assert found['grain'].tolist() == expected
        assert set(found['block'].tolist()) <= {block} and set(found['time_s'].tolist()) <= {3.5}
        loud = (0.01 * 2.9 / settings.full_mps) ** settings.gain_curve  # of its speed 10 ms later
        assert found['gain'] == pytest.approx(np.full(len(expected), loud))
        pan = settings.pan_width * x / (settings.space_m / 2)
        assert found['pan'] == pytest.approx(np.full(len(expected), pan))


def test_images_sound_the_same_grains_whatever_is_felt():
    alone, _ = slips(Selector(SETTINGS, space()), felt=False)
    both, by_knock = slips(Selector(SETTINGS, space()), felt=True)

    assert len(by_knock) > 4
    assert both == alone


def test_a_grain_of_a_felt_slip_is_played_once():
    by_image, by_knock = slips(Selector(SETTINGS, space()), felt=True)
    told = [(t, block, grain, False) for t, grain, *_, block in by_image]
    told += [(t, block, grain, True) for t, grain, *_, block in by_knock]
    for order in (sorted(told), sorted(told, key=lambda one: one[0] + 0.1 * one[3])):  # or late
        first = FirstSense()
        played = [one for one in order if first.plays(*one)]
        for t, block, grain, felt in told:
            same = [
                p for p in played if p[1:3] == (block, grain) and abs(p[0] - t) <= SAME_S
            ]  # fmt: skip
            assert len(same) == 1, (t, grain, felt)
    begun = {t // 1 for t, *_ in by_knock}
    first = FirstSense()
    heard = [one for one in sorted(told) if first.plays(*one)]
    assert all(min(o for o in heard if o[0] // 1 == s)[3] for s in begun)  # by the knock


def test_caps_hold_for_the_knocks_of_a_block():
    x, y = rest_lattice()[12]
    count = len(near(x, y))
    assert count > 1
    selector = Selector(SETTINGS, space())
    assert len(selector.felt(1.0, 12, x, y, 2.9)) == count
    free_s = 1.0 + SETTINGS.refractory_s
    assert len(selector.felt(free_s - 1.1 * SLIP_S, 12, x, y, 2.9)) == 0
    assert len(selector.felt(free_s + 0.01, 12, x, y, 2.9)) == count
    selector = Selector(dataclasses.replace(SETTINGS, block_cap=1), space())
    assert [len(selector.felt(t, 12, x, y, 2.9)) for t in (1.0, 1.5, 2.1)] == [1, 0, 1]


def test_a_slip_felt_a_little_too_soon_sounds_as_soon_as_it_may():
    x, y = rest_lattice()[12]
    selector = Selector(SETTINGS, space())
    first = selector.felt(1.0, 12, x, y, 2.9)
    early_s = 1.0 + SETTINGS.refractory_s - 0.9 * SLIP_S
    waits = selector.felt(early_s, 12, x, y, 2.9)
    assert waits['grain'].tolist() == first['grain'].tolist()
    assert waits['time_s'] == pytest.approx(1.0 + SETTINGS.refractory_s, abs=1e-12)
    assert len(selector.felt(early_s + 0.01, 12, x, y, 2.9)) == 0  # the same slip, felt again
    # a clock that was set back holds nothing back
    assert selector.felt(0.1, 12, x, y, 2.9)['time_s'].tolist() == [0.1] * len(first)


@pytest.mark.parametrize('rule', [{'mode': 'bow'}, {'rearm_at_rest': False}])
def test_where_a_slip_does_not_sound_at_its_start_knocks_sound_nothing(rule):
    selector = Selector(dataclasses.replace(SETTINGS, **rule), space())
    assert len(selector.felt(1.0, 12, 0.0, 0.0, 2.9)) == 0
