# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eol_ros.core.science.patterns import against_shuffled, components, measures

ROW, COLUMN = np.indices((5, 5))
DARK = np.zeros((5, 5), bool)
CHECKER = (ROW + COLUMN) % 2 == 0
HALF = COLUMN < 2
FRAME = (np.abs(ROW - 2) == 2) | (np.abs(COLUMN - 2) == 2)
DIAGONAL = ROW == COLUMN


@pytest.mark.parametrize(
    ('pattern', 'edges', 'turns', 'components', 'symmetries'),
    [
        (DARK, 0, 0, 1, 7),
        (~DARK, 0, 4, 1, 7),
        (CHECKER, 40, 48 + 4, 25, 7),
        (~CHECKER, 40, 48, 25, 7),
        (HALF, 5, 4, 2, 1),
        (FRAME, 12, 8, 2, 7),
        (DIAGONAL, 16, 20, 7, 3),
    ],
)
def test_known_patterns(pattern, edges, turns, components, symmetries):
    found = measures(pattern)

    assert (found.edges, found.turns) == (edges, turns)
    assert (found.components, found.symmetries) == (components, symmetries)


def test_entropy_of_known_patterns():
    assert measures(DARK).entropy_2x2 == 0
    assert measures(CHECKER).entropy_2x2 == pytest.approx(1)  # two windows, eight of each
    assert measures(DARK).local_complexity == 0
    # Next to a block of the checker stands its opposite, always; along diagonals its like.
    assert measures(CHECKER).local_complexity == pytest.approx(0, abs=1e-12)


PATTERNS = arrays(bool, (5, 5), elements=st.booleans())


@settings(max_examples=30, deadline=None)
@given(PATTERNS)
def test_turns_and_mirrors_change_nothing(pattern):
    for other in (pattern.T, pattern[::-1], np.rot90(pattern)):
        one, two = measures(pattern), measures(other)
        assert one.lit == two.lit and one.edges == two.edges and one.turns == two.turns
        assert one.components == two.components and one.symmetries == two.symmetries
        assert one.entropy_2x2 == pytest.approx(two.entropy_2x2)


@settings(max_examples=30, deadline=None)
@given(PATTERNS)
def test_light_for_dark_changes_no_edge_and_no_region(pattern):
    one, two = measures(pattern), measures(~pattern)

    assert one.edges == two.edges
    assert one.components == two.components
    assert one.symmetries == two.symmetries
    assert one.entropy_2x2 == pytest.approx(two.entropy_2x2)
    assert one.local_complexity == pytest.approx(two.local_complexity)


@settings(max_examples=30, deadline=None)
@given(PATTERNS)
def test_components_agree_with_scipy(pattern):
    from scipy.ndimage import label

    assert components(pattern) == label(pattern)[1] + label(~pattern)[1]


def test_one_block_lit():
    one = DARK.copy()
    one[2, 2] = True
    found = measures(one)

    assert (found.lit, found.edges, found.turns, found.components) == (1, 4, 4, 2)
    assert found.order == 1
    assert found.birkhoff == pytest.approx(1 / 4)
    assert np.isnan(measures(DARK).birkhoff)


def test_a_grown_cascade_is_less_random_than_its_shuffle():
    patterns = np.stack([np.hypot(ROW - 2, COLUMN - k) < 1.6 for k in range(5)])
    found = against_shuffled(patterns, np.random.default_rng(1), repeats=40)

    assert found['edges'].mean < found['edges'].shuffled_mean
    assert found['edges'].p_less < 0.05
    assert found['turns'].p_less < 0.05


def test_random_patterns_are_like_their_shuffle():
    patterns = np.random.default_rng(2).random((12, 5, 5)) < 0.4
    found = against_shuffled(patterns, np.random.default_rng(3), repeats=40)

    assert 0.05 < found['edges'].p_less <= 1
    assert found['edges'].mean == pytest.approx(found['edges'].shuffled_mean, abs=1.5)


def test_a_pattern_is_square():
    with pytest.raises(ValueError, match='square'):
        measures(np.zeros((4, 5), bool))
