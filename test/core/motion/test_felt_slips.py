# SPDX-License-Identifier: Apache-2.0
"""Block 7 slips every half second from 1 s on; what else knocks is said by each test."""

import dataclasses

import numpy as np
import pytest
from support.paper import N_BLOCKS, rest_lattice

from eol_ros.core.motion.felt import (
    CONFIRMED,
    LAG_S,
    PROVISIONAL,
    RETRACTED,
    VERDICT_S,
    Felt,
    Knock,
    _octave,
)
from eol_ros.core.motion.motion import Motion, _Begun
from eol_ros.core.motion.slips import START
from eol_ros.settings import MotionSettings

FPS = 60
STRONG, WEAK = 2.9, 0.2  # m/s^2: (mu_s - mu_k) g, and a hand on the rim
EVERY_S = 0.5


def knocks_at(times_s, strength=STRONG, block=7):
    return [Knock(round(t * 1e9), block, 2e-4, strength) for t in times_s]


def onsets(count):
    return [1.0004 + EVERY_S * k for k in range(count)]


def run(knocks, count, delay_s=0.007, level=0.99, slips=True, lost=(), hidden=(), closed=None):
    """Return what is told of knocks, with the number of images by then, and the slips.

    delay_s: from a knock to its arrival, one or one for each. lost: images that never come.
    hidden: images in which block 7 is not seen. closed: takes the cascades.
    """
    random = np.random.default_rng(0)
    motion = Motion(MotionSettings(tap_probability=level))
    delays = np.broadcast_to(delay_s, len(knocks)).tolist()
    waiting = sorted((k.stamp_s + d, k) for k, d in zip(knocks, delays, strict=True))
    told, found = [], []
    for image in range(round((1.5 + EVERY_S * count) * FPS)):
        t = image / FPS
        place = rest_lattice() + random.normal(0, 1e-5, (N_BLOCKS, 2))
        if slips:
            place[7, 0] += sum(1.25 * min(max(t - at, 0), 0.06) ** 2 for at in onsets(count))
        # An image is known 8 ms after its stamp.
        while waiting and waiting[0][0] <= t + 0.008:
            told += [(image, one) for one in motion.tap(waiting.pop(0)[1])]
        if image in lost:
            continue
        seen = np.ones(N_BLOCKS, bool)
        seen[7] = image not in hidden
        new, over = motion.update(t, place[:, 0], place[:, 1], seen)
        told += [(image + 1, one) for one in motion.felt_slips()]
        found += new
        if closed is not None:
            closed += over
    return told, found


def test_a_knock_is_told_at_once_and_the_images_confirm_it():
    told, slips = run(knocks_at(onsets(3)), 3)
    starts = [s.event for s in slips if s.event.kind == START]

    assert [one.kind for _, one in told] == [PROVISIONAL, CONFIRMED] * 3
    for (image, first), (later, verdict), start in zip(told[::2], told[1::2], starts, strict=True):
        assert first.knock.stamp_ns == verdict.knock.stamp_ns
        assert (first.slip, verdict.slip, first.block) == (0, start.slip, 7)
        assert image / FPS < first.knock.stamp_s + 0.02
        assert image / FPS < start.stamp_s  # of the image that shows it
        assert later - 1 == np.ceil((first.knock.stamp_s + VERDICT_S) * FPS)
        assert (first.x, first.y) == pytest.approx((first.x, rest_lattice()[7, 1]), abs=1e-4)


def believed(verdicts, strength):
    """Return of as many knocks, half a second apart, the probability, and whether it was told."""
    felt, found = Felt(0.99), []
    still, seen = np.zeros(N_BLOCKS), np.ones(N_BLOCKS, bool)
    for image in range(30 * (len(verdicts) + 1)):
        t = image / FPS
        felt.look(t, still, still, seen)
        number, phase = divmod(image - 30, 30)
        if number >= 0 and phase == 0:
            knock = Knock(round(t * 1e9), 7, 2e-4, strength)
            told = felt.tap(knock)
            found.append((felt._probability((0, _octave(knock)), t), bool(told)))
        if number >= 0 and phase == 6:
            (verdict,) = felt.judge(t, knock, int(verdicts[number])) or [None]
            assert (verdict is None) == (not told)
            if verdict:
                assert verdict.kind == (CONFIRMED if verdicts[number] else RETRACTED)
    return found


@pytest.mark.parametrize('strength', [STRONG, WEAK])
def test_how_much_knocks_are_believed_follows_from_what_the_images_said(strength):
    verdicts = np.random.default_rng(2).random(300) < 0.995
    verdicts[0], verdicts[40:43], verdicts[150:] = False, strength == WEAK, True
    found = believed(verdicts, strength)

    # Beta posterior mean; each verdict counts 1/1000 less with each that follows.
    confirmed, of = (199.8, 200.0) if strength == STRONG else (0.5, 1.0)
    for verdict, (probability, told) in zip(verdicts, found, strict=True):
        assert probability == pytest.approx(confirmed / of, rel=1e-9)
        assert told == (confirmed / of >= 0.99)
        confirmed, of = 0.999 * confirmed + verdict, 0.999 * of + 1
    assert found[0][1] == (strength == STRONG)  # the first is told, where it is no hand's
    assert found[-1][1]  # many were slips since
    assert not all(was_told for _, was_told in found)


def test_a_block_that_moved_before_its_knock_is_believed_apart_from_one_that_rested():
    felt, seen, place = Felt(0.99), np.ones(N_BLOCKS, bool), np.zeros(N_BLOCKS)
    still, told = np.zeros(N_BLOCKS), {3: [], 7: []}
    for image in range(40 * 60):
        t = image / FPS
        place[7] += 0.01 / FPS  # all the time
        felt.look(t, place, still, seen)
        if image < 60:
            continue
        if image % 30 == 0:
            knocks = {b: Knock(round(t * 1e9), b, 2e-4, STRONG) for b in told}
            for block, knock in knocks.items():
                told[block] += [one.kind for one in felt.tap(knock)]
        elif image % 30 == 6:
            for block, knock in knocks.items():
                felt.judge(t, knock, int(block == 3))  # that of block 7 never is one
    assert told[3] == [PROVISIONAL] * 78
    assert told[7] == [PROVISIONAL] * 2


def test_what_hands_do_to_the_rim_is_not_told_and_does_not_spoil_what_slips_do():
    hands = [knock for block in range(0, 7) for knock in knocks_at([1.2, 1.7, 2.2], WEAK, block)]
    told, _ = run(hands + knocks_at(onsets(6)), 6)

    assert {one.block for _, one in told} == {7}
    assert sum(one.kind == PROVISIONAL for _, one in told) == 6
    assert not any(one.kind == RETRACTED for _, one in told)


@pytest.mark.parametrize(
    'delay_s',
    [pytest.param(0.001, marks=pytest.mark.slow), pytest.param(0.03, marks=pytest.mark.slow), 0.08],
)
def test_when_a_knock_arrives_does_not_matter(delay_s):
    knocks = knocks_at([1.2, 1.9], STRONG) + knocks_at(onsets(6)) + knocks_at([1.21], STRONG, 3)
    random = np.random.default_rng(1)
    usual, slips = run(knocks, 6)
    other, others = run(knocks, 6, delay_s * random.uniform(0.5, 1.0, len(knocks)))

    def order(told):
        return sorted((one for _, one in told), key=lambda one: (one.knock, one.kind))

    assert order(other) == order(usual) and others == slips


def test_nothing_that_the_camera_does_alone_depends_on_knocks():
    with_knocks, alone = run(knocks_at(onsets(6)), 6)[1], run([], 6)[1]

    assert len(alone) == 12
    for one, other in zip(with_knocks, alone, strict=True):
        if one.event.kind == START:
            assert one == other
        else:  # its onset is known better
            assert one.tapped
            left = {'onset_s': 0.0, 'onset_sigma_s': 0.0, 'duration_s': 0.0}
            event = dataclasses.replace(one.event, **left)
            assert event == dataclasses.replace(other.event, **left)


def test_a_tap_says_when():
    cascades, at_s = [], onsets(1)[0]
    start, stop = run(knocks_at([at_s]), 1, closed=cascades)[1]
    alone = run([], 1)[1][1]
    assert stop.tapped and not start.tapped and not alone.tapped
    assert stop.event.onset_s == pytest.approx(at_s, abs=3e-4)
    assert stop.event.onset_sigma_s < 2.1e-4
    (cascade,) = cascades
    assert cascade.onset_s == stop.event.onset_s and (cascade.nucleus, cascade.size) == (7, 1)
    ends = [one.event.onset_s + one.event.duration_s for one in (stop, alone)]
    assert ends[0] == pytest.approx(ends[1])


@pytest.mark.parametrize(('later_s', 'block'), [(0.0, 8), (0.3, 7), (-0.3, 7)])
def test_a_tap_of_another_block_or_time_says_nothing(later_s, block):
    told, (_, stop) = run(knocks_at([onsets(1)[0] + later_s], block=block), 1)
    assert not stop.tapped
    assert [(one.kind, one.slip) for _, one in told] == [(PROVISIONAL, 0), (RETRACTED, 0)]


@pytest.mark.parametrize(('late_s', 'is_it'), [(0.045, True), (-0.045, True), (0.06, False)])
def test_an_onset_that_the_images_see_late_is_still_that_of_its_knock(late_s, is_it):
    """As of a slip that follows another within 0.1 s, whose rest is told after it has begun."""
    motion = Motion(MotionSettings())
    motion._begun = [_Begun(slip=9, block=3, onset_s=2.0 + late_s, onset_sigma_s=1e-3)]
    knock = Knock(2_000_000_000, 3, 2e-4, 1.0)
    assert motion._fuse(knock) == (9 if is_it else 0)
    assert motion._fuse(knock) == 0  # it has been given away


def test_knocks_wait_for_images_and_are_told_when_they_come():
    at_s = onsets(1)[0]
    lost = range(int((at_s - LAG_S) * FPS), int((at_s + 0.03) * FPS))
    told, _ = run(knocks_at([at_s]), 1, lost=lost)

    image, first = told[0]
    assert first.kind == PROVISIONAL
    assert image == lost.stop + 1
    assert first.knock.stamp_ns == round(at_s * 1e9)


def test_without_images_there_is_nothing_to_confirm_and_nothing_is_told():
    at_s = onsets(1)[0]
    first = int((at_s - LAG_S) * FPS)
    assert run(knocks_at([at_s]), 1, lost=range(first, first + 30))[0] == []
    assert run(knocks_at([at_s]), 1, hidden=range(first - 1, first + 1))[0] == []


def test_where_images_are_lost_nothing_is_learnt_of_a_knock():
    at_s = onsets(2)[0]
    lost = range(int(at_s * FPS) + 1, int((at_s + VERDICT_S) * FPS) - 1)
    for missing in (lost, lost[:1]):
        told, _ = run(knocks_at(onsets(2)), 2, lost=missing, slips=False)
        (_, first), _, (_, second), _ = told
        assert [one.kind for _, one in told] == [PROVISIONAL, RETRACTED] * 2
        assert second.probability == first.probability
    told, _ = run(knocks_at(onsets(2)), 2, slips=False)
    assert told[2][1].probability < first.probability  # there it was


@pytest.mark.parametrize('strength', [float('nan'), float('inf'), -1.0, 0.0])
def test_a_strength_that_is_none_is_taken_for_what_it_may_be(strength):
    told, slips = run(knocks_at(onsets(1), strength), 1)
    assert len(slips) == 2 and len(told) in (0, 2)
