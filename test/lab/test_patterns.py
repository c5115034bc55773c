# SPDX-License-Identifier: Apache-2.0
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import label

from eol_ros.lab.science import patterns

ROW, COLUMN = np.indices((5, 5))
DARK = np.zeros((5, 5), bool)
CHECKER = (ROW + COLUMN) % 2 == 0
HALF = COLUMN < 2
FRAME = (np.abs(ROW - 2) == 2) | (np.abs(COLUMN - 2) == 2)
DIAGONAL = ROW == COLUMN


def of(pattern):
    """Every measure of one pattern."""
    return {name: measure(pattern[None])[0] for name, measure in patterns.MEASURES.items()}


@pytest.mark.parametrize(
    ('pattern', 'edges', 'turns', 'regions'),
    [
        (DARK, 0, 0, 1),
        (~DARK, 0, 4, 1),
        (CHECKER, 40, 48 + 4, 25),
        (~CHECKER, 40, 48, 25),
        (HALF, 5, 4, 2),
        (FRAME, 12, 8, 2),
        (DIAGONAL, 16, 20, 7),
    ],
)
def test_known_patterns(pattern, edges, turns, regions):
    assert of(pattern) == {'edges': edges, 'turns': turns, 'regions': regions}


PATTERNS = arrays(bool, (5, 5), elements=st.booleans())


@settings(max_examples=30, deadline=None)
@given(PATTERNS)
def test_turns_and_mirrors_change_nothing(pattern):
    for other in (pattern.T, pattern[::-1], np.rot90(pattern)):
        assert of(other) == of(pattern)


@settings(max_examples=30, deadline=None)
@given(PATTERNS)
def test_light_for_dark_changes_turns_alone(pattern):
    one, two = of(pattern), of(~pattern)
    for name in ('edges', 'regions'):
        assert one[name] == two[name]


@settings(max_examples=20, deadline=None)
@given(arrays(bool, (4, 5, 5), elements=st.booleans()))
def test_regions_agree_with_each_pattern_alone(stack):
    alone = [label(p)[1] + label(~p)[1] for p in stack]

    assert patterns.regions(stack).tolist() == alone


def test_trades_keep_both_counts_and_reach_every_pattern():
    rng = np.random.default_rng(1)
    start = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [1, 0, 0, 0]], bool)
    seen, now = {}, start
    for _ in range(3000):
        now = patterns.traded(now, rng)
        seen[now.tobytes()] = seen.get(now.tobytes(), 0) + 1
    made = [np.frombuffer(key, bool).reshape(3, 4) for key in seen]
    every = np.indices((2,) * 12).reshape(12, -1).T.reshape(-1, 3, 4)
    same = (every.sum(1) == start.sum(0)).all(1) & (every.sum(2) == start.sum(1)).all(1)

    assert all((m.sum(0) == start.sum(0)).all() and (m.sum(1) == start.sum(1)).all() for m in made)
    assert len(made) == same.sum()
    assert min(seen.values()) > 0.7 * 3000 / len(seen)  # each as likely as the others


def spreading(rng, moments=80):
    """Flashes that go from a block to a neighbour in the next moment, then dark."""
    flashes = np.zeros((4 * moments, 5, 5), bool)
    for k in range(moments):
        row, column = rng.integers(0, 5), rng.integers(0, 4)
        flashes[4 * k, row, column] = flashes[4 * k, row, (column + 1) % 5] = True
        flashes[4 * k + 1, row, column + 1] = True
    return flashes


@pytest.mark.slow
def test_light_that_spreads_is_told_from_chance():
    rng = np.random.default_rng(2)
    found = patterns.ask(spreading(rng), 5.0, rng, 399)
    by_name = {c.name: c for c in found.static}

    assert not found.random
    assert by_name['turns'].clear and by_name['turns'].mean < by_name['turns'].by_chance
    assert found.follows.clear and found.follows.mean > 2 * found.follows.by_chance
    assert found.sentences[0].startswith('patterns of light are not random (160 moments; chance: ')
    assert by_name['turns'].extreme and by_name['turns'].p_value == 2 / 400
    assert all(
        c.extreme == ('p at most' in c.figures) == (c.p_value == 2 / 400) for c in found.static
    )
    less = found.sentences[0].split('less than by chance: ')[1].split(';')[0]
    assert 'turns (' in less and found.sentences[0].count('than by chance') <= 2
    assert 'neighbours more than by chance' in found.sentences[1]


@pytest.mark.slow
def test_chance_is_seldom_taken_for_more():
    """Blocks that differ in how often they flash, and moments in how many do, are chance still."""
    ps = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        often = rng.uniform(0.05, 0.5, (5, 5)) * rng.uniform(0.2, 1.5, (80, 1, 1))
        found = patterns.ask(rng.random((80, 5, 5)) < often, 5.0, rng, 39)
        ps.append([c.p_value for c in (*found.static, found.follows)])
    small = np.mean(np.array(ps) <= 0.1, axis=0)

    # 0.1 of each is expected; one of 20 has 0.35 and more by chance in 1 of 400 such tests
    assert small.max() < 0.35 and small.mean() < 0.17


def test_the_share_that_follows_is_counted_right():
    rng = np.random.default_rng(4)
    flashes = rng.random((200, 5, 5)) < 0.1
    near = other = 0
    for before, after in itertools.pairwise(flashes):
        for one in np.argwhere(before):
            apart = np.abs(np.argwhere(after) - one).sum(axis=1)
            near, other = near + (apart == 1).sum(), other + (apart > 0).sum()

    assert patterns._follows(flashes, 5.0, rng, 1)[0] == pytest.approx(near / other)


def test_too_few_moments_are_said_to_be():
    flashes = np.zeros((500, 5, 5), bool)
    flashes[:7, 0, 0] = True
    with pytest.raises(patterns.TooFew, match='7 moments are too few for a test: 30'):
        patterns.ask(flashes, 5.0, np.random.default_rng(1))


def test_holm_is_that_of_its_paper():
    np.testing.assert_allclose(patterns._holm(np.array([0.01, 0.04, 0.03])), [0.03, 0.06, 0.06])


def test_a_pattern_is_square():
    with pytest.raises(ValueError, match=r'\(k, n, n\)'):
        patterns.turns(np.zeros((2, 4, 5), bool))
