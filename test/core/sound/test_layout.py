# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kendalltau

from eol_ros.core.sound import layout


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 120), st.integers(0, 10**6))
def test_even_is_the_cheapest_assignment_that_a_swap_can_see(n, seed):
    random = np.random.default_rng(seed)
    places = random.random((n, 2)) ** 2
    found = layout.even(places)
    assert sorted(map(tuple, found)) == sorted(map(tuple, layout.lattice(n)))
    cost = ((places[:, None] - found[None]) ** 2).sum(axis=2)
    own = np.diag(cost)
    gain = own[:, None] + own[None] - cost - cost.T  # of swapping two grains
    assert gain.max() <= 1e-12


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 700))
def test_lattice_has_one_place_per_grain_and_no_hole(n):
    cells = layout.lattice(n)
    rows, counts = np.unique(cells[:, 1], return_counts=True)
    assert len(cells) == n and counts.max() - counts.min() <= 1
    assert abs(len(rows) - np.sqrt(n)) <= 0.5  # as many rows as columns, or nearly
    np.testing.assert_allclose(rows, (np.arange(len(rows)) + 0.5) / len(rows))
    for row in rows:  # each row is evenly filled from edge to edge
        x = np.sort(cells[cells[:, 1] == row, 0])
        np.testing.assert_allclose(x, (np.arange(len(x)) + 0.5) / len(x))


def correlated(n, rho, seed=0):
    cover = np.array([[1, rho], [rho, 1]])
    return np.random.default_rng(seed).multivariate_normal([0, 0], cover, n)


@pytest.mark.parametrize('n', [160, 400, 600])
@pytest.mark.parametrize('rho', [0.0, 0.5, -0.5])
def test_even_keeps_the_order_of_both_axes(n, rho):
    values = correlated(n, rho)
    places = layout.arrange(values[:, 0], values[:, 1], ('flatness', 'rms_db'))
    for axis in (0, 1):
        assert kendalltau(values[:, axis], places[:, axis])[0] >= 0.80
    side = round(np.sqrt(n))  # cells of an even grid: none empty, none crowded
    count = np.histogram2d(*places.T, bins=side, range=[[0, 1], [0, 1]])[0]
    if n == side * side:
        assert (count == 1).all()


def test_more_than_one_assignment_can_take(monkeypatch):
    monkeypatch.setattr(layout, 'EXACT_UP_TO', 150)
    values = correlated(500, 0.3)
    places = layout.arrange(values[:, 0], values[:, 1], ('flatness', 'rms_db'))
    assert sorted(map(tuple, places)) == sorted(map(tuple, layout.lattice(len(values))))
    for axis in (0, 1):
        assert kendalltau(values[:, axis], places[:, axis])[0] >= 0.7


@pytest.mark.parametrize(
    ('values', 'name', 'wanted'),
    [
        ([100, 200, 400, 1600], 'pitch_hz', [0, 0.25, 0.5, 1]),  # octaves
        ([100, 200, 400, 1600], 'flatness', [0, 1 / 15, 0.2, 1]),
        ([np.nan] * 3, 'pitch_hz', [0.5] * 3),
        ([2] * 3, 'pitch_hz', [0.5] * 3),
        ([1, np.nan, 3], 'rms_db', [0, 0.5, 1]),
    ],
)
def test_scaled(values, name, wanted):
    np.testing.assert_allclose(layout.scaled(np.array(values, float), name), wanted)


@pytest.mark.parametrize('how', ['raw', 'rank', 'even'])
@pytest.mark.parametrize('n', [0, 1, 2, 3])
def test_few_grains(how, n):
    places = layout.arrange(np.arange(n), np.arange(n), ('flatness', 'rms_db'), how)
    assert places.shape == (n, 2)
    assert ((places >= 0) & (places <= 1)).all()
