# SPDX-License-Identifier: Apache-2.0
"""The host's side of the line, against the fake board on a real pty."""

import threading
import time

import pytest
from support.fake_board import FakeBoard
from support.waiting import wait_until

from eol_ros.core import serial_protocol as protocol
from eol_ros.devices.backoff import Backoff
from eol_ros.devices.board.board import KNOCK_SPAN_S, Board
from eol_ros.devices.ports import Port, find
from eol_ros.errors import DeviceMissing


class Host:
    """A Board with its taps and states kept, and short pauses."""

    def __init__(self, port):
        self.taps, self.states = [], []
        self.board = Board(port, self.taps.append, self.states.append, backoff=Backoff(0.05, 0.2))

    def __enter__(self):
        self.board.start()
        return self

    def __exit__(self, *_):
        self.board.close()


@pytest.fixture
def fake(tmp_path):
    with FakeBoard(str(tmp_path / 'board')) as fake:
        yield fake


@pytest.fixture
def host(fake):
    with Host(fake.link) as host:
        assert wait_until(lambda: host.board.ready), host.states
        yield host


def test_infrared_reaches_the_board(host, fake):
    host.board.infrared(False)

    wait_until(lambda: fake.infrared_mask == 0)
    assert not host.board.infrared_on


def test_a_tap_is_stamped_with_the_time_of_the_knock(host, fake):
    wait_until(lambda: len(host.board.round_trip_ms) >= 9)
    before = time.monotonic()
    fake.knock(17, 6.5)
    after = time.monotonic()

    wait_until(lambda: host.taps)
    tap = host.taps[0]
    assert (tap.block, tap.strength) == (17, pytest.approx(6.5))
    assert before - 5 * tap.time.sigma_s - 1e-3 < tap.time.time_s < after + 5 * tap.time.sigma_s
    assert tap.time.sigma_s < 0.02


def test_a_block_that_lit_itself_says_when_and_one_that_slept_is_less_sure(host, fake):
    assert host.board.version == 2
    wait_until(lambda: len(host.board.round_trip_ms) >= 9)
    fake.knock(3, 2.0, ago_s=0.005, lit_s=0.002)
    fake.knock(4, 2.0, ago_s=0.012, lit_s=0.009, woke=True)
    wait_until(lambda: len(host.taps) == 2)
    first, second = host.taps
    assert (first.lit_s, second.lit_s) == (pytest.approx(0.002), pytest.approx(0.009))
    assert first.time.sigma_s < second.time.sigma_s >= 3e-3


def test_what_a_board_says_of_other_blocks_or_another_time_is_counted_and_not_passed_on(host, fake):
    wait_until(lambda: len(host.board.round_trip_ms) >= 9)
    ahead_s = KNOCK_SPAN_S + 1.0
    for ago_s in (ahead_s, -ahead_s, 2131.0, -2131.0):
        fake.knock(3, 1.0, ago_s)
    for number in range(256):
        fake._send(protocol.BlockStatus(number, 3700, 20, 2, 2, protocol.LINKED))
        fake._send(protocol.SelfTested(number, 1, 0, 0, 0, 0, 0, 0))
        if number >= 25:
            fake._send(protocol.Knock(fake.clock_us(), number, 100, 0, 0))
    fake.knock(24, 1.0, 1.0)
    wait_until(lambda: host.taps)
    assert [tap.block for tap in host.taps] == [24] and host.board.taps == 1
    assert set(host.board.blocks) == {*range(25), protocol.BRIDGE}
    assert set(host.board.tests) == set(range(25))
    assert host.board.rejected == 4 + 230 + 231 + 231


def test_a_board_that_comes_back_is_told_how_blocks_flash_and_feel(host, fake):
    detector = protocol.Detector(threshold=384)
    host.board.configure(protocol.Lighting(protocol.LIMITED, 128, 500), detector)
    wait_until(lambda: fake.detector == detector)
    fake.fault('unplug')
    wait_until(lambda: not host.board.ready)
    fake.detector = protocol.Detector()
    fake.fault('plug')
    wait_until(lambda: fake.detector == detector)
    assert host.board.light(1 << 9, 5) is not None
    wait_until(lambda: 0 < fake.levels()[9] <= 128)
    wait_until(lambda: len(host.board.blocks) == 26)


def test_an_unplugged_board_is_met_again_and_shown_what_it_missed(host, fake):
    host.board.infrared(0b11)
    fake.fault('unplug')

    wait_until(lambda: not host.board.ready)
    assert host.board.light(1, 5) is None
    fake.infrared_mask = protocol.ALL_BLOCKS
    fake.fault('reboot')
    fake.fault('plug')
    wait_until(lambda: host.board.ready)
    wait_until(lambda: fake.infrared_mask == 0b11)
    assert host.board.connections == 2
    kinds = [s.kind for s in host.states]
    assert kinds[0] == 'ready' and kinds[-1] == 'ready'
    assert {'lost', 'looking'} >= set(kinds[1:-1]) != set()
    assert all('trying again in' in s.text for s in host.states[1:-1])


def test_a_board_that_started_again_is_told_again(host, fake):
    """Its watchdog bit; the line stays open."""
    host.board.infrared(False)
    wait_until(lambda: fake.infrared_mask == 0)
    before = host.board.connections
    fake.fault('reboot')
    assert fake.infrared_mask

    wait_until(lambda: fake.infrared_mask == 0)
    assert host.board.connections == before


def test_a_silent_board_counts_as_lost(host, fake, monkeypatch):
    monkeypatch.setattr('eol_ros.devices.board.board.SILENT_AFTER_S', 0.3)
    fake.fault('mute')

    wait_until(lambda: host.board.state.kind == 'lost')
    assert 'silent' in host.board.state.text
    fake.fault('unmute')
    wait_until(lambda: host.board.ready)


def test_noise_truncation_and_oversize_cost_a_packet_and_nothing_else(host, fake):
    for fault in ('noise', 'truncate', 'oversize'):
        fake.fault(fault)
        fake.knock(0, 1.0)
    fake.knock(24, 1.0)

    wait_until(lambda: host.taps and host.taps[-1].block == 24)
    assert host.board.ready
    assert host.board.decoder.bad >= 3


def test_another_version_is_one_clear_line(tmp_path):
    for version, cure in ((1, 'update the firmware'), (7, 'update eol_ros')):
        with FakeBoard(version=version) as fake, Host(fake.port) as host:
            wait_until(lambda: host.states)
            state = host.states[0]
            assert state.kind == 'refused'
            assert f'speaks protocol version {version}, this program 2: ' in state.text
            assert cure in state.text


def test_a_port_that_never_answers_is_not_a_board(monkeypatch):
    monkeypatch.setattr('eol_ros.devices.board.board.HELLO_FOR_S', 0.3)
    with FakeBoard() as fake:
        fake.fault('mute')
        with Host(fake.port) as host:
            wait_until(lambda: host.states)
            assert 'no board answers on' in host.states[0].text


def test_a_missing_port_is_looked_for_until_it_is_there(tmp_path):
    link = str(tmp_path / 'later')
    with Host(link) as host:
        wait_until(lambda: host.states)
        assert f'{link} is not there' in host.states[0].text
        with FakeBoard(link):
            wait_until(lambda: host.board.ready)


def test_a_board_in_use_is_said_to_be(host, fake):
    with Host(fake.link) as second:
        wait_until(lambda: second.states)
        assert 'in use by another program' in second.states[0].text


def test_a_line_that_nobody_reads_never_blocks(host, fake, monkeypatch):
    asleep = threading.Event()
    monkeypatch.setattr(fake, '_take', lambda *_: asleep.wait())
    results = [host.board.light(1, k) for k in range(8000)]

    asleep.set()  # one that blocked would not have come so far

    assert None in results
    assert host.board.dropped > 0


PORTS = [
    Port('/dev/serial/by-id/usb-Teensy_1234', '/dev/ttyACM0', 'Teensy'),
    Port('/dev/serial/by-id/usb-FTDI_99', '/dev/ttyUSB0', 'FTDI chip'),
]


def test_ports_are_found_by_stable_name():
    assert find('serial port', 'Teensy', PORTS) == PORTS[0].name
    assert find('serial port', 'FTDI chip', PORTS) == PORTS[1].name
    assert find('serial port', 'auto', PORTS[:1]) == PORTS[0].name


@pytest.mark.parametrize(
    ('wanted', 'ports', 'words'),
    [
        ('auto', [], 'no serial port found: plug it in'),
        ('auto', PORTS, 'serial port auto: 2 fit'),
        ('Arduino', PORTS, "no serial port has 'Arduino'"),
        ('/dev/nowhere', PORTS, '/dev/nowhere is not there'),
    ],
)
def test_ports_that_cannot_be_found_are_explained(wanted, ports, words):
    with pytest.raises(DeviceMissing, match=words):
        find('serial port', wanted, ports)
