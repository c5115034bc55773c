# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.tables import OBLONG

from eol_ros.core.table import Table
from eol_ros.core.vision.symmetry import Coincidence

pytestmark = pytest.mark.slow

TABLE = Table()


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
