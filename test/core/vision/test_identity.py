# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.stick_slip import Onlooker, Table

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.vision.identity.blink import Blink
from eol_ros.core.vision.identity.fitting import rotate_cell
from eol_ros.core.vision.identity.identity import Identity
from eol_ros.core.vision.identity.symmetry import TURNED, UNTURNED, Coincidence

pytestmark = pytest.mark.slow


def turned(xy, angle):
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


def feed(identity, stamp_s, xy, names):
    shown = xy[names]
    identity.update(stamp_s, shown, np.zeros(len(shown)), np.full(len(shown), 1e-4))


def test_tables_of_turned_ids_agree():
    for quarters in range(4):
        assert list(TURNED[quarters]) == [rotate_cell(b, quarters) for b in range(25)]
        assert list(TURNED[quarters][UNTURNED[quarters]]) == list(range(25))


@pytest.mark.parametrize('quarters', [0, 1, 2, 3])
@pytest.mark.parametrize('delay_s', [0.0, 0.2])
def test_taps_tell_the_turn_whenever_they_arrive(quarters, delay_s):
    random = np.random.default_rng(quarters)
    coincidence = Coincidence()
    coincidence.update(0.0)
    waiting = []
    decided = None
    for k in range(600):
        now = k / 60
        if k % 40 == 20:
            block = int(random.integers(0, 25))
            coincidence.onset(now + random.normal(0, 0.002), block, 0.002)
            waiting.append((now + random.normal(0, 0.003), int(TURNED[quarters, block])))
        while waiting and waiting[0][0] + delay_s <= now:
            coincidence.tap(*waiting.pop(0), 0.003)
        coincidence.look(now, np.ones(25, bool), np.zeros(25, bool))
        answer = coincidence.update(now)
        if decided is None and answer is not None:
            decided = answer, coincidence.took
    assert decided is not None
    assert decided[0] == quarters
    assert decided[1] <= 4


def test_taps_that_fit_no_turn_decide_nothing():
    random = np.random.default_rng(3)
    coincidence = Coincidence()
    coincidence.update(0.0)
    for k in range(300):
        coincidence.onset(k * 0.5, int(random.integers(0, 25)), 0.002)
        coincidence.tap(k * 0.5 + 0.2, int(random.integers(0, 25)), 0.003)
        coincidence.look(k * 0.5, np.ones(25, bool), np.zeros(25, bool))
        assert coincidence.update(k * 0.5) is None


def test_the_middle_block_is_no_witness():
    """It looks the same from all sides: an answer rests on two others at least."""
    coincidence = Coincidence()
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


def test_a_turn_in_the_dark_is_put_right_by_taps():
    identity, onlooker = Identity(), Onlooker(4, arms=0.0, false_per_image=0.0)
    table = Table(4, 60.0)
    heard = 0
    quarter = np.pi / 2
    for k in range(900):
        moment = table.step()
        if k == 100:
            onlooker.dark_until_s = moment.stamp_s + 1.5
        seen = onlooker.look(moment)
        angle = quarter if k >= 100 else 0.0  # somebody turns everything by a right angle
        for stamp_s, block in onlooker.listen(table.begun[heard:]):
            identity.tap(stamp_s, block, 0.008)
        heard = len(table.begun)
        identity.update(moment.stamp_s, turned(seen.xy, angle), seen.yaw, seen.sigma)
        if k == 195:
            assert identity.lattice.ambiguous
    assert not identity.lattice.ambiguous
    held = identity.lattice.index >= 0
    assert list(seen.true[identity.lattice.index[held]]) == list(np.flatnonzero(held))


@pytest.mark.parametrize('quarters', [0, 1, 3])
def test_a_blinking_block_tells_the_turn(quarters):
    identity = Identity(trust_start=False, blink=Blink(4, 1.0, 0.1))
    place = turned(rest_lattice(), quarters * np.pi / 2)
    for k in range(240):
        now = k / 60
        names = [b for b in range(25) if not (b == 4 and 0.5 <= now % 1.0 < 0.6)]
        if 90 <= k < 110:
            names = [b for b in names if b not in (10, 11)]  # an arm
        feed(identity, now, place, names)
        if k == 20:
            assert identity.lattice.ambiguous
    assert not identity.lattice.ambiguous
    assert np.allclose(identity.lattice.xy, place, atol=1e-6)


def test_an_arm_on_the_beat_of_nothing_is_no_blink():
    identity = Identity(trust_start=False, blink=Blink(4, 1.0, 0.1))
    random = np.random.default_rng(1)
    dark = {}
    for k in range(600):
        if k % 37 == 0:
            dark = {int(random.integers(0, 25)): k + int(random.integers(3, 9))}
        names = [b for b in range(25) if dark.get(b, 0) <= k]
        feed(identity, k / 60, rest_lattice(), names)
    assert identity.lattice.ambiguous
