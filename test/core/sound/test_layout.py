# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.stats import kendalltau, rankdata

from eol_ros.core.sound import layout


@pytest.mark.slow
@settings(deadline=None, max_examples=50)
@given(st.integers(1, 700))
def test_lattice_has_one_place_per_grain_and_no_hole(n):
    cells = layout.lattice(n)
    assert cells.shape == (n, 2)
    assert (cells > 0).all() and (cells < 1).all()
    assert len(np.unique(cells, axis=0)) == n
    rows, counts = np.unique(cells[:, 1], return_counts=True)
    assert counts.max() - counts.min() <= 1
    assert abs(len(rows) - np.sqrt(n)) <= 0.5  # as many rows as columns, or nearly
    for row in rows:  # each row is evenly filled from edge to edge
        x = np.sort(cells[cells[:, 1] == row, 0])
        np.testing.assert_allclose(x, (np.arange(len(x)) + 0.5) / len(x))


@pytest.mark.parametrize('n', [160, 163, 400, 600])
def test_largest_hole(n):
    """No point of the square is farther from a grain than the spacing of the lattice."""
    cells = layout.lattice(n)
    probe = np.stack(np.meshgrid(*[np.linspace(0, 1, 70)] * 2), axis=-1).reshape(-1, 2)
    hole = KDTree(cells).query(probe)[0].max()
    assert hole <= 1.0 / np.sqrt(n)


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


def test_rank_is_the_mean_rank():
    values = np.array([3.0, 1.0, 1.0, 9.0, 3.0, 3.0])
    np.testing.assert_allclose(layout.ranked(values), (rankdata(values) - 1) / 5)
    assert layout.ranked(np.array([4.0])).tolist() == [0.5]


def test_scaled_takes_octaves_where_it_is_hertz():
    hz = np.array([100.0, 200.0, 400.0, 1600.0])
    np.testing.assert_allclose(layout.scaled(hz, 'pitch_hz'), [0, 0.25, 0.5, 1])
    np.testing.assert_allclose(layout.scaled(hz, 'flatness'), (hz - 100) / 1500)


@pytest.mark.parametrize('bad', [[np.nan] * 3, [2.0] * 3])
def test_what_cannot_be_told_apart_lies_in_the_middle(bad):
    assert layout.scaled(np.array(bad), 'pitch_hz').tolist() == [0.5] * 3


def test_missing_values_lie_in_the_middle():
    assert layout.scaled(np.array([1.0, np.nan, 3.0]), 'rms_db').tolist() == [0, 0.5, 1]


@settings(deadline=None, max_examples=40)
@given(st.floats(0, 1))
def test_blend_goes_straight_from_raw_to_even(blend):
    values = correlated(30, 0.2)
    names = ('flatness', 'rms_db')
    ends = [layout.arrange(*values.T, names, 'even', b) for b in (0.0, 1.0)]
    np.testing.assert_allclose(ends[0], layout.arrange(*values.T, names, 'raw'))
    between = layout.arrange(*values.T, names, 'even', blend)
    np.testing.assert_allclose(between, (1 - blend) * ends[0] + blend * ends[1], atol=1e-12)


@pytest.mark.parametrize('how', ['raw', 'rank', 'even'])
@pytest.mark.parametrize('n', [0, 1, 2, 3])
def test_few_grains(how, n):
    places = layout.arrange(np.arange(n), np.arange(n), ('flatness', 'rms_db'), how)
    assert places.shape == (n, 2)
    assert ((places >= 0) & (places <= 1)).all()
