# SPDX-License-Identifier: Apache-2.0
"""What the map to sound holds back, and the power of what sounds, against sums done by hand."""

from dataclasses import replace

import numpy as np
import pytest

from eol_ros.lab.science import sounding
from eol_ros.settings import GrainsSettings

FREE = GrainsSettings(refractory_s=0.0, block_cap=1000, total_cap=10_000)


def test_refractory_time_and_caps_hold_slips_back():
    times = np.arange(40) * 0.01
    one, four = np.zeros(40, int), np.arange(40) % 4

    held = sounding.heard(times, one, replace(FREE, refractory_s=0.095))
    np.testing.assert_array_equal(np.flatnonzero(held), [0, 10, 20, 30])
    assert sounding.heard(times, four, replace(FREE, block_cap=3)).sum() == 12
    assert sounding.heard(times, four, replace(FREE, total_cap=7)).sum() == 7
    later = np.concatenate([times, times + 1.0])  # a second on, all may sound again
    assert sounding.heard(later, np.tile(four, 2), replace(FREE, total_cap=7)).sum() == 14


def test_the_refractory_time_is_that_of_the_node():
    """One grain in reach of each block: `Selector.felt` lets the same slips sound."""
    from support.paper import rest_lattice

    from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
    from eol_ros.core.sound.select import Selector

    rule = GrainsSettings(refractory_s=0.3, block_cap=3, radius=0.02, total_cap=10_000)
    places = rest_lattice() / rule.space_m + 0.5
    grains = np.zeros(25, GRAIN)
    grains['x'], grains['y'], grains['duration_s'] = *places.T, 0.25
    selector = Selector(rule, Corpus((Source('ice.wav', 48000, 99.0, ''),), grains))
    rng = np.random.default_rng(1)
    times, block = np.sort(rng.uniform(0, 6, 1200)), rng.integers(0, 25, 1200)
    held = np.diff(np.sort(times[block == 0]))
    assert (held < 0.2).any()

    sounds = sounding.heard(times, block, rule)
    real = np.array([
        len(selector.felt(t, b, *rest_lattice()[b], 3.0)) > 0
        for t, b in zip(times.tolist(), block.tolist(), strict=True)
    ])  # fmt: skip
    # the node lets a grain wait for at most 40 ms, instead of losing it
    assert abs(int(real.sum()) - int(sounds.sum())) < 0.15 * sounds.sum()
    assert (sounds == real).mean() > 0.75


def test_power_is_that_of_the_envelopes_summed():
    rule = GrainsSettings(grain_s=0.25, attack_s=0.005, release_s=0.2)
    made = sounding.power(np.array([1.0, 1.0, 3.3]), 5.0, 20.0, rule)
    at = (np.arange(25_000) + 0.5) * 1e-5
    level = np.clip(np.minimum(at / 0.005, (0.25 - at) / 0.2), 0, 1)

    assert len(made) == 100 and (made[:20] == 0).all() and (made[26:66] == 0).all()
    assert made.sum() / 20 == pytest.approx(3 * (level**2).sum() * 1e-5, rel=0.01)
    np.testing.assert_allclose(made[20:25], 2 * made[66:71], rtol=1e-9)
