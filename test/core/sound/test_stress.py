# SPDX-License-Identifier: Apache-2.0
"""The stress bed: forces against a plain sum over springs, and what it sounds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.paper import N_BLOCKS, rest_lattice
from support.quiet_settings import GRAINS

from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.select import Selector
from eol_ros.core.sound.stress import stress
from eol_ros.core.table import Table

SEEN = np.ones(N_BLOCKS, bool)
BED = replace(GRAINS, ambience_rate=4.0, ambience_break_m=0.02)


def corpus(side=8):
    grains = np.zeros(side * side, GRAIN)
    at = (np.arange(side) + 0.5) / side
    grains['x'], grains['y'] = (a.ravel() for a in np.meshgrid(at, at))
    grains['duration_s'] = 0.25
    return Corpus((Source('a.wav', 48000, 99.0, ''),), grains)


@pytest.mark.parametrize(
    'table', [Table(), Table(rows=3, columns=4, gap_y_m=0.05), Table(absent=(6, 7, 8))]
)
@pytest.mark.parametrize('seed', range(4))
def test_stress_is_the_sum_of_the_springs(seed, table):
    at = table.rest + np.random.default_rng(seed).normal(0, 0.01, (table.cells, 2))
    at[~table.present] = np.nan
    wanted = []
    for block in range(table.cells):
        fx = fy = 0.0
        for other in table.neighbours(block) if table.present[block] else ():
            dx, dy = at[other] - at[block]
            stretch = math.hypot(dx, dy) - table.pitch_m[abs(other - block) > 1]
            fx += stretch * dx / math.hypot(dx, dy)
            fy += stretch * dy / math.hypot(dx, dy)
        wanted.append(math.hypot(fx, fy) / 0.03)
    assert np.abs(stress(at, 0.03, table) - wanted).max() < 1e-12


def sounded(at, settings, seconds=60.0):
    selector = Selector(settings, corpus())
    found = [
        selector.update(k / 60, *at.T, SEEN, np.zeros(N_BLOCKS)) for k in range(int(60 * seconds))
    ]
    return np.concatenate(found)


def test_rest_is_silent_and_off_is_off():
    assert not len(sounded(rest_lattice(), BED, 10))
    at = rest_lattice() + np.random.default_rng(1).normal(0, 0.01, (N_BLOCKS, 2))
    assert not len(sounded(at, replace(BED, ambience_rate=0.0), 10))


@pytest.mark.slow
def test_creaks_come_as_often_as_the_stress_says():
    at = rest_lattice() + np.random.default_rng(2).normal(0, 0.004, (N_BLOCKS, 2))
    found = sounded(at, BED)
    wanted = 60 * 4.0 * (np.minimum(stress(at, 0.02), 1) ** 2).sum()
    assert abs(len(found) - wanted) < 4 * math.sqrt(wanted)
    assert (found['block'] == -1).all()
    assert (found['rate'] >= 0.125).all() and (found['rate'] <= 0.5).all()
    assert (found['gain'] <= BED.ambience_gain).all()
    again = sounded(at, BED)
    assert again.tobytes() == found.tobytes()  # by chance, and the same chance


@pytest.mark.slow
def test_what_slips_sound_does_not_hang_on_the_bed():
    random = np.random.default_rng(5)
    pace = 0.004 * (random.random((600, N_BLOCKS, 1)) < 0.1)  # mostly at rest
    steps = np.cumsum(pace * random.standard_normal((600, N_BLOCKS, 2)), axis=0) + rest_lattice()
    outs = []
    for settings in (replace(BED, ambience_rate=0.0), BED):
        selector = Selector(settings, corpus())
        found = [selector.update(k / 60, *at.T, SEEN, np.zeros(25)) for k, at in enumerate(steps)]
        outs.append(np.concatenate(found))
    with_bed = outs[1][outs[1]['block'] >= 0]
    assert len(outs[0]) > 100 and with_bed.tobytes() == outs[0].tobytes()
