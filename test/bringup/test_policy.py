# SPDX-License-Identifier: Apache-2.0
from eol_ros.bringup.policy import SILENT_S, START_S, Policy


def test_back_off_grows_to_thirty_seconds():
    policy = Policy()
    waits = []
    for death in range(8):
        policy.start(10.0 * death)
        waits.append(policy.died(10.0 * death + 1))

    assert waits == [1, 2, 4, 8, 16, 30, 30, 30]


def test_back_off_begins_again_after_a_healthy_minute():
    policy = Policy()
    policy.start(0.0)
    policy.died(1.0)
    policy.start(2.0)

    assert policy.died(100.0) == 1.0


def test_hung_after_silence_but_not_while_it_starts():
    policy = Policy()
    policy.start(100.0)

    assert not policy.hung(100.0 + START_S - 1)
    assert policy.hung(100.0 + START_S + 1)

    policy.beat(110.0)

    assert not policy.hung(110.0 + SILENT_S - 0.1)
    assert policy.hung(110.0 + SILENT_S + 0.1)


def test_three_deaths_in_a_minute_are_red():
    policy = Policy()
    for now in (0.0, 50.0, 70.0):
        policy.died(now)

    assert not policy.red()

    policy.died(90.0)

    assert policy.red()
