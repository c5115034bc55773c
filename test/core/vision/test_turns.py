# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.paper import rest_lattice, turned
from support.tables import OBLONG

from eol_ros.core.table import Table
from eol_ros.core.vision.blink import Blink
from eol_ros.core.vision.symmetry import Coincidence

pytestmark = pytest.mark.slow

TABLE = Table()
TURNED, UNTURNED = TABLE.turned_ids, TABLE.unturned_ids


def test_tables_of_turned_ids_agree():
    rest = rest_lattice()
    for quarters in range(4):
        there = turned(rest, quarters * np.pi / 2)  # a block goes to the place that another had
        assert np.allclose(rest[TURNED[quarters]], there) or np.allclose(
            rest[UNTURNED[quarters]], there
        )
        assert list(TURNED[quarters][UNTURNED[quarters]]) == list(range(25))


TURNS = [(TABLE, quarters) for quarters in range(4)] + [(OBLONG, 0), (OBLONG, 2)]


@pytest.mark.parametrize(('table', 'quarters'), TURNS)
@pytest.mark.parametrize('delay_s', [0.0, 0.2])
def test_taps_tell_the_turn_whenever_they_arrive(table, quarters, delay_s):
    random, n = np.random.default_rng(quarters), table.cells
    coincidence, true = Coincidence(table), table.turned(quarters)
    coincidence.update(0.0)
    waiting = []
    decided = None
    for k in range(600):
        now = k / 60
        if k % 40 == 20:
            block = int(random.integers(0, n))
            coincidence.onset(now + random.normal(0, 0.002), block, 0.002)
            waiting.append((now + random.normal(0, 0.003), int(true[block])))
        while waiting and waiting[0][0] + delay_s <= now:
            coincidence.tap(*waiting.pop(0), 0.003)
        coincidence.look(now, np.ones(n, bool), np.zeros(n, bool))
        answer = coincidence.update(now)
        if decided is None and answer is not None:
            decided = answer, coincidence.took
    assert decided is not None
    assert decided[0] == quarters
    assert decided[1] <= 4


def test_taps_that_fit_no_turn_decide_nothing():
    random = np.random.default_rng(3)
    coincidence = Coincidence(TABLE)
    coincidence.update(0.0)
    for k in range(300):
        coincidence.onset(k * 0.5, int(random.integers(0, 25)), 0.002)
        coincidence.tap(k * 0.5 + 0.2, int(random.integers(0, 25)), 0.003)
        coincidence.look(k * 0.5, np.ones(25, bool), np.zeros(25, bool))
        assert coincidence.update(k * 0.5) is None


def test_the_middle_block_is_no_witness():
    """It looks the same from all sides: an answer rests on two others at least."""
    coincidence = Coincidence(TABLE)
    coincidence.update(0.0)
    answers = []
    for k in range(180):
        now = k / 60
        coincidence.look(now, np.ones(25, bool), np.zeros(25, bool))
        if k in (30, 70, 110):
            block = {30: 12, 70: 3, 110: 8}[k]
            coincidence.onset(now, block, 0.001)
            coincidence.tap(now, block, 0.001)
        answers.append(coincidence.update(now))
    # by then block 3 alone has made the other turns a millionth as likely
    assert coincidence.count == 3
    decided = [k for k, answer in enumerate(answers) if answer is not None]
    assert answers[decided[0]] == 0 and decided[0] > 110
    assert np.diff(np.sort(coincidence.belief))[-1] > 11.5


def beats(blink, quarters, images, hidden=lambda k: ()):
    """Return what the blink of block 4 tells in so many images of a lattice turned by quarters."""
    place, answers = turned(rest_lattice(), quarters * np.pi / 2), []
    at = UNTURNED[quarters, 4]
    for k in range(images):
        seen = np.ones(25, bool)
        seen[at] = not 0.5 <= k / 60 % 1.0 < 0.6
        seen[list(hidden(k))] = False
        answers.append(blink.update(k / 60, place, seen))
    return [answer for answer in answers if answer is not None]


@pytest.mark.parametrize('quarters', [0, 1, 3])
def test_a_blinking_block_tells_the_turn(quarters):
    found = beats(
        Blink(4, 1.0, 0.1, TABLE), quarters, 240, lambda k: (10, 11) if 90 <= k < 110 else ()
    )
    assert found and set(found) == {quarters}


def test_an_arm_on_the_beat_of_nothing_is_no_blink():
    random, blink, dark = np.random.default_rng(1), Blink(4, 1.0, 0.1, TABLE), {}
    for k in range(600):
        if k % 37 == 0:
            dark = {int(random.integers(0, 25)): k + int(random.integers(3, 9))}
        seen = np.array([dark.get(block, 0) <= k for block in range(25)])
        assert blink.update(k / 60, rest_lattice(), seen) is None
