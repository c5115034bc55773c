# SPDX-License-Identifier: Apache-2.0
import random

import pytest

from eol_ros.core.clock_offset import OneWay, offset

NS = 1_000_000_000


@pytest.mark.parametrize('ahead_s', [0.3, -0.3, 0.0005])
@pytest.mark.parametrize(('there_s', 'back_s'), [(0.0002, 0.0002), (0.02, 0.001)])
def test_the_true_offset_lies_within_the_error_whatever_the_delays(ahead_s, there_s, back_s):
    """Each message is late by chance; a link may be slower in one direction."""
    chance, here, there = random.Random(1), OneWay(), OneWay()
    for n in range(20):
        late_s = chance.expovariate(500)
        sent_ns = n * NS
        here_s = here.add(sent_ns, sent_ns + round((there_s + late_s + ahead_s) * NS))
        sent_ns = n * NS + round((0.4 + ahead_s) * NS)
        back_ns = sent_ns + round((back_s + late_s - ahead_s) * NS)
        found = offset(here_s, there.add(sent_ns, back_ns))
        assert abs(found.offset_s - ahead_s) <= found.error_s
    assert found.error_s < (there_s + back_s) / 2 + 0.001
    assert found.matters == (abs(ahead_s) > 0.002)


def test_nothing_is_said_while_the_messages_are_from_before_and_after_a_clock_was_set():
    here, there = OneWay(), OneWay()
    for n in range(10):
        here.add(n * NS, n * NS + 1000)
        there.add(n * NS, n * NS + 1000)
    set_s = 0.3  # this clock goes ahead: earlier arrivals here still look quicker
    assert offset(here.add(0, round(set_s * NS)), there.add(round(set_s * NS), 1000)) is None
