# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.clock_sync import ClockSync


class Pair:
    """A host clock and a board clock of known offset and rate, with a line between them."""

    def __init__(self, offset_s=1234.5, rate=40e-6, seed=1, delay_s=200e-6):
        self.offset_s, self.rate, self.delay_s = offset_s, rate, delay_s
        self.rng = np.random.default_rng(seed)

    def board_us(self, host_s):
        return int((host_s * (1 + self.rate) + self.offset_s) * 1e6) % 2**32

    def ping(self, sync, host_s):
        there, back = self.delay_s + self.rng.exponential(self.delay_s, 2)
        sync.add(host_s, self.board_us(host_s + there), host_s + there + back)


def run(pair, seconds, start_s=7.0, every_s=0.5):
    sync = ClockSync()
    for t in np.arange(start_s, start_s + seconds, every_s):
        pair.ping(sync, t)
    return sync


@pytest.mark.parametrize('rate', [-100e-6, 0.0, 100e-6])
def test_offset_and_rate_are_found(rate):
    pair = Pair(rate=rate)
    sync = run(pair, 40)

    assert sync.rate == pytest.approx(rate, abs=5e-6)
    for t in (20.0, 46.0, 50.0):
        assert sync.to_host(pair.board_us(t)).time_s == pytest.approx(t, abs=200e-6)


def test_the_32_bit_clock_may_wrap():
    pair = Pair(offset_s=2**32 * 1e-6 - 8.0)
    sync = run(pair, 40)

    assert pair.board_us(8.5) < pair.board_us(7.0)  # it did wrap
    assert sync.to_host(pair.board_us(46.0)).time_s == pytest.approx(46.0, abs=200e-6)
    assert sync.to_host(pair.board_us(7.5)).time_s == pytest.approx(7.5, abs=200e-6)
    assert sync.restarts == 0


def test_a_board_that_starts_anew_is_noticed():
    sync = run(Pair(), 20)
    fresh = Pair(offset_s=-26.9)  # its clock shows 0.1 s at host time 27
    for t in (27.0, 27.5, 28.0):
        fresh.ping(sync, t)

    assert sync.restarts == 1
    assert sync.to_host(fresh.board_us(27.7)).time_s == pytest.approx(27.7, abs=1e-3)


def test_slow_exchanges_do_not_spoil_quick_ones():
    pair, sync = Pair(rate=0.0), ClockSync()
    for k, t in enumerate(np.arange(0, 20, 0.5)):
        late = 0.03 if k % 3 else 0.0  # a busy host reads two of three answers 30 ms late
        sync.add(t, pair.board_us(t + 0.0002), t + 0.0004 + late)

    assert sync.to_host(pair.board_us(19.0)).time_s == pytest.approx(19.0, abs=100e-6)


def test_an_answer_before_its_question_is_ignored():
    sync = ClockSync()
    sync.add(5.0, 100, 4.0)

    assert not sync.ready
