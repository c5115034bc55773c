# SPDX-License-Identifier: Apache-2.0
"""When the walls change: judged by the list of flip times of whole visits."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.core.montage.shuffle import AHEAD, SAFE_PERIOD_S, Deck, Shuffle
from eol_ros.errors import ConfigError


def visit(shuffle, slips, until_s, step_s=0.01, start_s=0.0):
    """Play `slips` = [(time_s, block, started)] and return all flips."""
    flips, todo = [], sorted(slips)
    for now in np.arange(start_s, until_s, step_s):
        while todo and todo[0][0] <= now:
            _, block, started = todo.pop(0)
            shuffle.slip(block, started, now)
        flip = shuffle.update(now)
        if flip:
            flips.append(flip)
    return flips


def make(count=24, period_s=0.5, **kwargs):
    return Shuffle(count, period_s, np.random.default_rng(3), **kwargs)


def test_shuffles_on_the_beat_while_moving_and_freezes_when_still():
    flips = visit(make(), [(1.0, 7, True), (4.2, 7, False)], 10.0)
    times = np.array([f.time_s for f in flips])
    assert times[0] == pytest.approx(1.0, abs=0.011)
    assert np.diff(times) == pytest.approx(0.5, abs=1e-9)
    assert times[-1] <= 4.2


def test_says_when_to_ask_again():
    """Asked at those times alone, it flips as it does when it is asked all the time."""
    shuffle = make(longest_slip_s=3.0)
    assert shuffle.due_s == np.inf
    shuffle.slip(7, True, 1.0)
    flips, asked, now = [], 0, 1.0
    while now < np.inf:
        assert asked < 20
        asked += 1
        flip = shuffle.update(now)
        flips += [flip] if flip else []
        assert shuffle.due_s > now
        now = shuffle.due_s
    slips = [(1.0, 7, True)]  # its stop is never told
    plain = visit(make(longest_slip_s=3.0), slips, 10.0, step_s=1 / 128)
    assert flips == plain and asked == len(flips) + 1


def test_a_slip_without_a_stop_ends_by_itself():
    flips = visit(make(longest_slip_s=3.0), [(0, 4, True)], 10)
    assert 2.4 <= flips[-1].time_s <= 3.0


def test_a_late_call_keeps_the_beat_and_a_stall_starts_a_new_one():
    shuffle = make()
    shuffle.slip(0, True, 0.0)
    assert shuffle.update(0.0).time_s == 0.0
    assert shuffle.update(0.54).time_s == 0.5
    assert shuffle.update(0.98) is None
    assert shuffle.update(1.0).time_s == 1.0
    shuffle.slip(0, True, 1.0)
    assert shuffle.update(3.3).time_s == 3.3


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.floats(0, 8), st.integers(0, 24), st.booleans()), max_size=60),
    st.floats(SAFE_PERIOD_S, 2.0),
)
def test_never_closer_than_the_period_whatever_comes(slips, period_s):
    # Calls come every 10 ms, so a flip may be told up to 10 ms late, never early.
    times = [f.time_s for f in visit(make(period_s=period_s), slips, 10.0)]
    assert np.all(np.diff(times) >= period_s - 1e-9)


@pytest.mark.parametrize('period_s', [0.0, 0.1, 0.3399, -1.0, float('nan')])
def test_refuses_what_could_hurt(period_s):
    with pytest.raises(ConfigError, match=r'flash safety'):
        make(period_s=period_s)


def test_flips_carry_their_lead_and_the_pairs_to_come():
    shuffle = make(lead_s=0.06)
    shuffle.slip(0, True, 0.0)
    flips = visit(shuffle, [], 6.0)
    assert flips[0].time_s == pytest.approx(0.06)
    for now, following in itertools.pairwise(flips):
        assert now.coming[0] == following.pair
        assert len(now.coming) == AHEAD


@pytest.mark.parametrize('count', [1, 2, 3, 24])
def test_deck_shows_each_once_a_round_and_none_twice_in_a_row(count):
    deck = Deck(count, np.random.default_rng(0))
    drawn = [deck.draw() for _ in range(40 * count)]
    for start in range(0, len(drawn), count):
        assert sorted(drawn[start : start + count]) == list(range(count))
    if count > 1:
        assert all(a != b for a, b in itertools.pairwise(drawn))


def test_deck_is_seeded_and_refuses_nothing_to_show():
    def draws(seed):
        deck = Deck(24, np.random.default_rng(seed))
        return [deck.draw() for _ in range(99)]

    assert draws(5) == draws(5) != draws(6)
    with pytest.raises(ConfigError, match='no pair'):
        Deck(0, np.random.default_rng(0))


def test_a_changed_folder_never_names_a_pair_that_is_gone():
    shuffle = make(count=24)
    shuffle.slip(0, True, 0.0)
    visit(shuffle, [], 2.0)
    shuffle.replace(3)
    flips = visit(shuffle, [], 9.0, start_s=2.0)
    assert flips and all(f.pair < 3 and max(f.coming) < 3 for f in flips)
