# SPDX-License-Identifier: Apache-2.0
import numpy as np

from eol_ros.core.sound.bank import playable
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source, table_bounds
from eol_ros.core.sound.triggers import TRIGGER


def corpus(n=3):
    grains = np.zeros(n, GRAIN)
    grains['duration_s'] = 0.1
    grains['x'] = np.linspace(0, 1, n)
    grains['y'][-1] = np.nan
    return Corpus((Source('a.wav', 48000, 1.0, 'ab'),), grains)


def test_a_grain_without_a_place_is_not_placed():
    assert corpus().placed.tolist() == [True, True, False]


def test_same_as_sees_a_moved_grain():
    assert corpus().same_as(corpus())
    moved = corpus()
    moved.grains['x'] = 0
    assert not corpus().same_as(moved)
    assert not corpus().same_as(corpus(4))


def test_bounds_are_the_square_in_the_middle_of_the_table():
    assert table_bounds(1.2) == (-0.6, -0.6, 0.6, 0.6)


def test_playable_refuses_each_kind_of_nonsense():
    good = np.zeros(1, TRIGGER)
    good['gain'] = good['rate'] = 1
    assert playable(good, 1).all()
    for field, value in [
        ('grain', 1), ('grain', -1), ('gain', -1), ('gain', np.nan), ('gain', 1e9), ('rate', 0),
        ('rate', np.inf), ('pan', 1.5), ('pan', np.nan), ('attack_s', -1), ('release_s', np.nan),
        ('time_s', np.nan), ('time_s', np.inf),
    ]:  # fmt: skip
        bad = good.copy()
        bad[field] = value
        assert not playable(bad, 1).any(), (field, value)
