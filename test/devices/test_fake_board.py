# SPDX-License-Identifier: Apache-2.0
"""The fake board, spoken to byte by byte, without the host's own class."""

import math
import os
import select
import subprocess
import sys
import time
import tty

import pytest
from support.waiting import wait_until

from eol_ros.core import serial_protocol as p
from eol_ros.devices.board.fake import Arrival, FakeBoard, latency_s
from eol_ros.errors import UsageError


class Line:
    """The host's end of a pty, raw."""

    def __init__(self, port):
        self.fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        self.decoder, self.inbox, self.sequence = p.Decoder(), [], 0

    def say(self, message):
        os.write(self.fd, p.encode(message, self.sequence))
        self.sequence += 1

    def gone(self):
        try:
            self.say(p.Ping(1))
        except OSError:
            return True
        return False

    def hear(self, kind, timeout_s=2.0):
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for at, message in enumerate(self.inbox):
                if isinstance(message, kind):
                    return self.inbox.pop(at)
            if select.select([self.fd], [], [], 0.05)[0]:
                self.inbox += [r.message for r in self.decoder.feed(os.read(self.fd, 4096))]
        return None


@pytest.fixture
def board():
    with FakeBoard() as board:
        yield board


@pytest.fixture
def line(board):
    line = Line(board.port)
    yield line
    os.close(line.fd)


def test_says_who_it_is(line):
    line.say(p.Hello())

    assert line.hear(p.Welcome) == p.Welcome(p.VERSION, 25, b'fake'.ljust(16, b'\0'))


def test_refuses_another_version(line):
    line.say(p.Hello(version=9))

    assert line.hear(p.Refused) == p.Refused(p.VERSION, 9)


def test_notes_when_an_order_to_flash_came(board, line):
    before_ns = time.time_ns()
    line.say(p.Light(before_ns // 1000 & 0xFFFFFFFF, 1 << 6))

    assert wait_until(lambda: board.levels()[6] > 0)
    arrival = board.log[-1]
    assert (arrival.kind, arrival.sequence) == ('Light', 0)
    assert before_ns < arrival.time_ns < time.time_ns()
    assert latency_s(arrival) >= 0


@pytest.mark.parametrize('late_us', [0, 1500, 40_000])
def test_latency_is_right_over_the_wrap_of_the_stamp(late_us):
    stamp_us = 17 * 2**32 - 1000

    arrival = Arrival((stamp_us + late_us) * 1000, 'Light', 0, stamp_us % 2**32)

    assert latency_s(arrival) == pytest.approx(late_us * 1e-6)


def test_switches_infrared(board, line):
    line.say(p.Infrared(0b101))

    assert wait_until(lambda: board.infrared_mask == 0b101)


def test_answers_pings_with_its_own_running_clock(board, line):
    line.say(p.Ping(11))
    first = line.hear(p.Pong)
    time.sleep(0.1)
    line.say(p.Ping(12))
    second = line.hear(p.Pong)

    assert (first.host_us, second.host_us) == (11, 12)
    assert 0.1e6 <= (second.board_us - first.board_us) % 2**32 < 2e6
    assert second.good == 2


def test_a_block_lights_itself_and_says_so(board, line):
    board.knock(13, 2.5, ago_s=4e-3, lit_s=1.5e-3, woke=True)

    knock = line.hear(p.Knock)
    assert (knock.block, knock.strength, knock.lit_us) == (13, 250, 1500)
    assert knock.flags == p.WOKE
    assert board.levels()[13] > 0


def test_blocks_are_lit_as_the_host_says_and_flash_by_themselves_if_they_may(board, line):
    line.say(p.Lighting(p.LIMITED, 100, 400))
    line.say(p.Light(0, 1 << 3 | 1 << 24))
    assert wait_until(lambda: board.levels()[24] > 0)
    assert [b for b, level in enumerate(board.levels()) if level] == [3, 24]
    assert max(board.levels()) <= 100
    board.knock(7, 1.0)
    assert line.hear(p.Knock).lit_us == p.NOT_LIT
    assert board.levels()[7] == 0


def test_without_a_bridge_blocks_flash_and_fade_slowly(board, line):
    line.say(p.Lighting(p.BY_ITSELF | p.LIMITED, 255, 182))
    assert line.hear(p.BlockStatus).block == p.BRIDGE
    board.fault('unplug')
    began = time.monotonic()
    board.knock(5, 1.0)
    time.sleep(0.3)
    level, took = board.levels()[5] / 255, time.monotonic() - began
    assert math.exp(-took / 4.0) - 0.01 < level < 1  # and not exp(-0.3 / 0.182)
    board.fault('plug')
    assert wait_until(lambda: board.levels()[5] < 40)


def test_while_a_block_is_silent_that_might_flash_nothing_falls(board, line):
    line.say(p.Lighting(p.BY_ITSELF | p.LIMITED, 255, 182))
    assert all(line.hear(p.BlockStatus) for _ in range(26))
    board.report(20, flags=0)
    began = time.monotonic()
    board.knock(5, 1.0)
    time.sleep(0.5)
    level, took = board.levels()[5] / 255, time.monotonic() - began
    assert level > math.exp(-took / 4.0) - 0.01
    board.report(20)
    assert wait_until(lambda: board.levels()[5] < 40)


def test_says_how_blocks_are_when_it_is_told_how_they_flash(board, line):
    line.say(p.Lighting(p.LIMITED, 255, 350))
    found = [line.hear(p.BlockStatus) for _ in range(26)]
    assert sorted(one.block for one in found) == [*range(25), p.BRIDGE]
    assert all(one.flags & p.LINKED for one in found)


@pytest.mark.parametrize(('fault', 'heard'), [('noise', 2), ('truncate', 1), ('oversize', 2)])
def test_spoils_one_packet_when_told(board, line, fault, heard):
    board.fault(fault)
    board.knock(1, 1.0)
    board.knock(2, 1.0)

    assert len([t for t in (line.hear(p.Knock), line.hear(p.Knock, 0.2)) if t]) == heard
    assert line.decoder.bad >= 1


def test_an_unplugged_board_is_back_under_its_stable_name(tmp_path):
    link = str(tmp_path / 'board')
    with FakeBoard(link) as board:
        line = Line(link)
        board.fault('unplug')

        assert not os.path.exists(link)
        assert wait_until(lambda: line.gone())
        os.close(line.fd)
        board.fault('plug')
        line = Line(link)
        line.say(p.Hello())
        assert line.hear(p.Welcome)
        os.close(line.fd)
    assert not os.path.lexists(link)


def test_mute_is_silent(board, line):
    board.fault('mute')
    line.say(p.Ping(1))

    assert line.hear(p.Pong, 0.2) is None


def test_an_unknown_fault_is_named():
    with pytest.raises(UsageError, match='explode'):
        FakeBoard().fault('explode')


def test_runs_as_a_program(tmp_path):
    link, log = tmp_path / 'board', tmp_path / 'log.csv'
    command = [sys.executable, '-m', 'eol_ros.devices.board.fake']
    options = ['--link', str(link), '--taps', '50', '--log', str(log)]
    program = subprocess.Popen(command + options, stdout=subprocess.PIPE, text=True)
    try:
        assert program.stdout.readline().strip() == str(link)
        line = Line(link)
        line.say(p.Hello())
        assert line.hear(p.Welcome)
        assert line.hear(p.Knock).strength == 500
        os.close(line.fd)
    finally:
        program.terminate()
        program.wait(5)
        program.stdout.close()

    assert 'Hello' in log.read_text()
