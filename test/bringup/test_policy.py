# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.bringup.policy import (
    FINE,
    HUNG,
    LOOK_S,
    PAUSE_S,
    QUIET_S,
    SILENT_S,
    START_AGAIN,
    START_AGAIN_S,
    START_S,
    START_STARVED_S,
    STARVED,
    STARVED_S,
    STOPPED_S,
    UNFED_FIRST_S,
    UNFED_MOST_S,
    UNFED_S,
    Look,
    Policy,
    StarvedInput,
    waited_s,
)  # fmt: skip
from eol_ros.bringup.processor import Thread

# Main threads as they were read from /proc, 0.5 s apart: s, state, ms on a processor, ms waited for
# one, turns; where it is even, its mean. `starved` ran at the lowest weight beside four busy
# processes on its processor, `squeezed` at theirs; `driver` waits for a child that never comes to
# its exec (vfork).
MEASURED = {
    'starved': [
        (0.0, 'R', 26.576, 300.946, 11), (0.503, 'R', 29.047, 1672.936, 12),
        (1.001, 'R', 29.047, 1672.936, 12), (1.501, 'R', 33.034, 2582.478, 13),
        (2.003, 'R', 33.034, 2582.478, 13), (2.501, 'R', 33.034, 2582.478, 13),
        (3.002, 'R', 37.055, 4022.477, 14), (3.502, 'R', 37.055, 4022.477, 14),
        (4.004, 'R', 37.055, 4022.477, 14), (4.503, 'R', 42.032, 5545.480, 15),
        (5.004, 'R', 42.032, 5545.480, 15), (5.504, 'R', 42.032, 5545.480, 15),
        (6.003, 'R', 43.898, 7285.486, 16),
    ],
    'squeezed': [(0.5 * k, 'R', 271 + 90.4 * k, 1225 + 410 * k, 76 + 32 * k) for k in range(13)],
    'blocked': [(0.5 * k, 'S', 26.332, 61.957, 8) for k in range(13)],
    'stopped': [(0.0, 'R', 409.999, 1097.185, 112)] + [
        (0.5 * k, 'T', 410.007, 1097.451, 113) for k in range(1, 13)
    ],
    'spinning': [(0.5 * k, 'R', 974 + 475 * k, 31 + 25 * k, 10 + k) for k in range(13)],
    'driver': [(0.5 * k, 'D', 22.274, 1.706, 3) for k in range(13)],
}  # fmt: skip


def silent(case, policy, seconds, counted=True, disk_s=None):
    """Let `seconds` pass for a process that does what was measured, over and over; yield verdicts.

    `counted` is False for a kernel that does not count waits; `disk_s` is what it says of disks for
    each second that passes.
    """
    rows = MEASURED[case]
    now = policy.silence.last_s
    for step in range(1, round(seconds / 0.1) + 1):
        now_s = now + 0.1 * step
        policy.silence.pass_until(now_s)
        if policy.silence.due():
            rounds, k = divmod(round(0.1 * step / LOOK_S), len(rows) - 1)
            state = rows[k][1]
            ran, waited, turns = (
                a + rounds * (b - c)
                for a, b, c in zip(rows[k][2:], rows[-1][2:], rows[0][2:], strict=True)
            )
            thread = Thread(state, round(ran * 1e6), round(waited * 1e6), turns)
            if not counted:
                thread = Thread(state, round(ran / 10) * 10_000_000)
            disk = None if disk_s is None else disk_s * now_s
            policy.silence.take(Look(now_s, {1: thread}, disk))
        yield round(0.1 * step, 1), policy.verdict()


def running():
    policy = Policy()
    policy.start(100.0)
    policy.beat(101.0)
    return policy


def test_back_off_grows_to_thirty_seconds():
    policy = Policy()
    waits = []
    for death in range(8):
        policy.start(10.0 * death)
        waits.append(policy.died(10.0 * death + 1))

    assert waits == [1, 2, 4, 8, 16, 30, 30, 30]


def test_after_a_healthy_minute_it_starts_again_at_once_and_the_back_off_too():
    policy = Policy()
    policy.start(0.0)
    policy.died(1.0)
    policy.start(2.0)

    assert policy.died(100.0) == 0.0

    policy.start(100.0)

    assert policy.died(101.0) == 1.0


def times(end_s):
    return [0.1 * k for k in range(round(10 * end_s))]


def test_who_gets_nothing_of_what_is_given_is_found_after_a_while():
    unfed = StarvedInput()
    found = [t for t in times(160) if unfed.look(t, 0.0, 60.0)]
    waits = [min(UNFED_S * 2**k, UNFED_MOST_S) + 0.1 for k in range(6)]
    assert np.diff([-0.1, *found]) == pytest.approx(waits) and waits[-1] > UNFED_MOST_S

    for t in times(61):  # a minute in which it gets something
        assert not unfed.look(160 + t, 60.0, 60.0)
    found = [t for t in times(UNFED_S + 1) if unfed.look(221 + t, 0.0, 60.0)]
    assert found == [pytest.approx(UNFED_S)]

    unfed = StarvedInput()
    assert [t for t in times(20) if unfed.look(t, 0.0, 60.0, starting=True)] == [UNFED_FIRST_S]


def test_who_got_nothing_is_started_again_at_once_and_who_then_dies_is_not():
    policy = Policy()
    policy.start(0.0)
    policy.unfed = True
    assert policy.died(10.0) == 0.0
    policy.start(10.0)
    assert policy.died(11.0) == 1.0
    assert policy.restarts == 2


@pytest.mark.parametrize(
    ('gets', 'given'), [(60.0, 60.0), (0.5, 60.0), (0.0, 0.0)], ids=['all', 'little', 'none given']
)
def test_who_gets_something_or_is_given_nothing_is_left_alone(gets, given):
    unfed = StarvedInput()
    assert not any(unfed.look(t, gets, given) for t in times(60))


def test_one_look_that_finds_something_is_enough_and_who_was_away_begins_again():
    unfed = StarvedInput()
    assert not any(
        unfed.look(t, float(round(10 * t) % (10 * UNFED_S - 1) == 0), 60.0) for t in times(60)
    )
    unfed = StarvedInput()
    assert not any(unfed.look(t * 10, 0.0, 60.0) for t in times(60))


@pytest.mark.parametrize('counted', [True, False])
@pytest.mark.parametrize(
    'case, after_s',
    [('blocked', SILENT_S), ('spinning', SILENT_S), ('driver', SILENT_S), ('stopped', STOPPED_S)],
)
def test_what_could_run_and_says_nothing_is_hung(case, after_s, counted):
    verdicts = dict(silent(case, running(), 12.0, counted))

    assert set(verdicts.values()) == {FINE, HUNG}
    hung_s = min(s for s, verdict in verdicts.items() if verdict == HUNG)
    assert after_s < hung_s < after_s + 1.0


@pytest.mark.parametrize('counted', [True, False])
def test_what_gets_no_processor_is_left_alone_for_a_minute(counted):
    verdicts = dict(silent('starved', running(), STARVED_S + 1, counted))

    assert verdicts[SILENT_S - 0.1] == FINE
    assert {v for s, v in verdicts.items() if SILENT_S < s < STARVED_S} == {STARVED}
    assert verdicts[STARVED_S + 0.5] == HUNG


def test_it_says_for_how_long_it_waited():
    policy = running()
    list(silent('starved', policy, 5.5))

    assert policy.silence.words() == 'starved: waited 4.0 of the last 4.0 s for a processor'


@pytest.mark.parametrize('counted', [True, False])
def test_the_heartbeat_is_due_after_so_much_time_in_which_it_ran(counted):
    # What spins and was left 18 % of a processor is found out when it has used up 5 s of it.
    verdicts = dict(silent('squeezed', running(), 40.0, counted))

    hung_s = min(s for s, verdict in verdicts.items() if verdict == HUNG)
    assert 15 < hung_s < 30
    assert {v for s, v in verdicts.items() if SILENT_S < s < hung_s} == {STARVED}


def test_a_heartbeat_ends_it():
    policy = running()
    assert list(silent('starved', policy, 20.0))[-1][1] == STARVED

    policy.beat(121.1)

    assert policy.verdict() == FINE
    assert dict(silent('blocked', policy, 6.0))[6.0] == HUNG  # what it waited before is forgotten


def test_who_waits_for_a_disk_is_starved_while_the_disk_is_busy():
    busy = dict(silent('driver', running(), 20.0, disk_s=0.9))
    idle = dict(silent('driver', running(), 20.0, disk_s=0.01))
    asleep = dict(silent('blocked', running(), 20.0, disk_s=0.9))

    assert busy[20.0] == STARVED
    assert idle[6.0] == asleep[6.0] == HUNG


def test_waits_of_threads_add_up_to_the_whole_span():
    blocked = Thread('S', 26_331_620, 61_957_353, 8)
    before = {1: blocked, 2: Thread('R', 0, 0, 1), 3: Thread('S', 0, 0, 1)}

    def after(*waited):
        threads = (Thread('S', 10**6, w * 10**6, 3) for w in waited)
        return waited_s(before, {1: blocked, **dict(enumerate(threads, 2))}, 0.5)

    assert after(200, 100) == pytest.approx(0.3)
    assert after(400, 400) == 0.5
    assert after() == 0.0


def test_a_wait_is_never_longer_than_what_was_left_beside_running():
    # It comes in one piece when it is over, much of it from before.
    before, after = Thread('R', 0, 0, 1), Thread('R', 10**8, 3 * 10**9, 2)

    assert waited_s({1: before}, {1: after}, 0.5) == pytest.approx(0.4)


@pytest.mark.parametrize('state', ['S', 'R'])
def test_while_bringup_sleeps_nobody_is_silent(state):
    policy = running()
    for _ in range(3):  # gone for 20 s each time, and one look in between
        now_s = policy.silence.last_s + 20.0
        policy.silence.pass_until(now_s)
        policy.silence.take(Look(now_s, {1: Thread(state, 0, 0, 1)}, None))

        assert policy.verdict() == FINE
    assert policy.silence.silent_s == 3 * PAUSE_S

    # What it waited meanwhile is no credit either.
    assert dict(silent('blocked', policy, 8.0))[8.0] == HUNG


def test_a_start_takes_as_long_as_it_could_run():
    def started(case, seconds):
        policy = Policy()
        policy.start(100.0)
        return dict(silent(case, policy, seconds))

    assert set(started('blocked', START_S - 1).values()) == {FINE}
    assert started('blocked', START_S + 1)[START_S + 1] == HUNG
    starved = started('starved', START_STARVED_S + 1)
    assert {v for s, v in starved.items() if SILENT_S < s < START_STARVED_S} == {STARVED}
    assert starved[START_STARVED_S + 1] == HUNG


@pytest.mark.parametrize('took_s, allowed_s', [(1.0, START_AGAIN_S), (8.0, 8.0 * START_AGAIN)])
def test_who_has_run_before_starts_about_as_soon_again(took_s, allowed_s):
    policy = Policy()
    policy.start(100.0)
    for _ in range(round(took_s / PAUSE_S)):
        policy.silence.pass_until(policy.silence.last_s + PAUSE_S)
    policy.beat(policy.silence.last_s)
    policy.died(policy.silence.last_s)
    policy.start(policy.silence.last_s + 1.0)

    verdicts = dict(silent('blocked', policy, allowed_s + 1))
    assert {v for s, v in verdicts.items() if s < allowed_s} == {FINE}
    assert verdicts[allowed_s + 1] == HUNG


def test_a_process_in_good_health_is_not_looked_at():
    policy = running()

    policy.silence.pass_until(policy.silence.last_s + 0.1)
    assert not policy.silence.due()
    for _ in range(round(QUIET_S / 0.1)):
        policy.silence.pass_until(policy.silence.last_s + 0.1)
    assert policy.silence.due()
