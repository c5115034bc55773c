# SPDX-License-Identifier: Apache-2.0
"""The firmware of the bridge on an emulated STM32F103 with an nRF24L01+, against the host's code.

Its line is a pty. The program is that which docs/build has written into a "Blue Pill".

`make firmware` installs the compiler and the emulator, builds and runs this.
"""

import os
import random
import struct
import tty

import pytest
from support import needs
from support.emulated import LIT, STATUS, TESTED, WORD
from support.emulated_bluepill import LiveBluePill
from support.waiting import wait_until

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.serial_protocol import FIRMWARE
from eol_ros.devices.board.bluepill import FRAME, KNOCK
from eol_ros.devices.board.board import Board
from eol_ros.settings import LedsSettings, MotionSettings

pytestmark = [
    pytest.mark.firmware,
    needs.marker('gcc-arm-none-eabi', 'libnewlib-arm-none-eabi', 'gcc-avr', 'libunicorn-dev'),
]
BY_ITSELF, FALLS = 1, 4
AIR_US = 550  # EOL_AIR_US
HELD_US = 1_001_000 // 3


def knock(block, number, age_us=6000, strength=299, lit_us=1100, flags=0):
    return struct.pack('<BBBHHHB', KNOCK, block, flags, age_us, strength, lit_us, number)


def status(block, flags=1, millivolts=3700, celsius=24):
    return struct.pack('<BBHbBBB', STATUS, block, millivolts, celsius, *FIRMWARE, flags)


class Host:
    """The other end of the pty, without the code under test but for the packets."""

    def __init__(self, port):
        self._fd = os.open(port, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
        tty.setraw(self._fd)
        self._decoder, self._sequence = protocol.Decoder(), 0
        self.heard = []

    def write(self, data):
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                self.look()

    def send(self, message):
        self._sequence = (self._sequence + 1) & 0xFF
        self.write(protocol.encode(message, self._sequence))

    def look(self):
        try:
            self.heard += [r.message for r in self._decoder.feed(os.read(self._fd, 65536))]
        except BlockingIOError:
            pass

    def of(self, kind):
        self.look()
        return [m for m in self.heard if isinstance(m, kind)]

    def ask(self, message, kind):
        """Send until it is answered; return the newest answer."""
        self.heard.clear()
        turns = iter(range(10**6))

        def answered():
            if next(turns) % 20 == 0:  # a line that was spoilt may have swallowed it
                self.send(message)
            return self.of(kind)

        return wait_until(answered)[-1]

    def close(self):
        os.close(self._fd)


@pytest.fixture
def bridge():
    with LiveBluePill() as one:
        yield one


@pytest.fixture
def host(bridge):
    one = Host(bridge.port)
    one.ask(protocol.Hello(), protocol.Welcome)
    yield one
    one.close()


def words(bridge, until):
    """Return the words that the bridge says until one makes `until` true."""
    found = []

    def look():
        found.extend(f for f in bridge.sent(0.05) if f[0] == WORD)
        return any(map(until, found))

    wait_until(look)
    return found


def falls(word):
    return bool(word[1] & FALLS)


def test_it_says_who_it_is_and_refuses_another_version(bridge):
    host = Host(bridge.port)
    assert host.ask(protocol.Hello(), protocol.Welcome) == protocol.Welcome(
        2, 25, b'eol bridge %d.%d\0\0' % FIRMWARE
    )
    assert host.ask(protocol.Hello(1), protocol.Refused) == protocol.Refused(2, 1)
    host.close()


def test_it_tells_the_blocks_what_the_host_wants(bridge, host):
    host.send(protocol.Lighting(protocol.LIMITED, 200, 500))
    host.send(protocol.Infrared(0b1010))
    last = words(bridge, lambda w: struct.unpack_from('<I', w, 5)[0] == 0b1010)[-1]
    assert (last[1] & BY_ITSELF, last[2], struct.unpack_from('<H', last, 3)[0]) == (0, 200, 500)
    wait_until(lambda: len(host.of(protocol.BlockStatus)) == 26)
    told = {s.block: s for s in host.of(protocol.BlockStatus)}
    assert sorted(told) == [*range(25), protocol.BRIDGE]
    assert told[protocol.BRIDGE] == protocol.BlockStatus(255, 0, 0, *FIRMWARE, 1)
    assert told[7].flags == 0  # not heard so far

    wanted = protocol.Detector(256, 13, 40, 7000, 67, 2016, 80640)
    host.send(wanted)
    found = []
    wait_until(lambda: found.extend(f for f in bridge.sent(0.05) if f[0] != WORD) or found)
    assert found[0][1:17] == wanted.BODY.pack(*vars(wanted).values())


def test_a_knock_is_told_once_with_its_time_on_the_bridges_clock(bridge, host):
    before = host.ask(protocol.Ping(1), protocol.Pong).board_us
    for _ in range(3):  # said again, as its acknowledgements were lost
        bridge.say(knock(7, number=1))
    wait_until(lambda: host.of(protocol.Knock))
    after = host.ask(protocol.Ping(2), protocol.Pong).board_us
    bridge.say(knock(7, number=2, age_us=1, lit_us=protocol.NOT_LIT, flags=protocol.WOKE))
    wait_until(lambda: [k for k in host.of(protocol.Knock) if k.flags])
    host.ask(protocol.Ping(3), protocol.Pong)

    bridge.say(knock(8, number=200))
    wait_until(lambda: [k for k in host.of(protocol.Knock) if k.block == 8])
    assert not [k for k in host.heard if isinstance(k, protocol.Knock) and k.block != 8]
    bridge.say(knock(7, number=1))  # after a reset of the block, say
    knocks = wait_until(lambda: [k for k in host.of(protocol.Knock) if k.block == 7])
    assert (knocks[0].strength, knocks[0].lit_us, knocks[0].flags) == (299, 1100, 0)
    assert before < after


def test_the_time_of_a_knock_lies_between_two_pings(bridge, host):
    for number in range(1, 20):
        age_us = 300 * number
        before = host.ask(protocol.Ping(1), protocol.Pong).board_us
        bridge.say(knock(3, number, age_us))
        told = wait_until(lambda: host.of(protocol.Knock))[0]
        after = host.ask(protocol.Ping(2), protocol.Pong).board_us
        assert before <= told.board_us + age_us + AIR_US <= after


def test_a_block_is_asked_to_test_itself_until_it_has(bridge, host):
    host.send(protocol.SelfTest(7))
    words(bridge, lambda w: w[14] == 8)
    found = protocol.SelfTested(7, 1, 300, -340, 500, 1500, 100, 1350)
    bridge.say(bytes([TESTED]) + found.BODY.pack(*vars(found).values()))
    assert wait_until(lambda: host.of(protocol.SelfTested))[-1] == found
    words(bridge, lambda w: w[14] == 0)
    host.send(protocol.SelfTest(25))  # there is none
    host.ask(protocol.Ping(1), protocol.Pong)
    assert words(bridge, lambda w: True)[-1][14] == 0


def test_an_order_to_light_is_in_the_words_for_a_while_only(bridge, host):
    first = words(bridge, lambda w: True)[-1]
    host.send(protocol.Light(5, 1 << 3))
    host.send(protocol.Light(5, 1 << 9))
    both = words(bridge, lambda w: struct.unpack_from('<I', w, 9)[0] == 1 << 3 | 1 << 9)[-1]
    assert both[13] == (first[13] + 2) & 0xFF
    gone = words(bridge, lambda w: not any(w[9:13]))[-1]
    assert gone[13] == both[13]


def test_what_blocks_flash_by_themselves_counts_for_the_limit(bridge, host):
    """Light falls, a block flashes: nothing falls for a third of a second."""
    host.ask(protocol.Lighting(3, 255, 350), protocol.BlockStatus)
    words(bridge, falls)
    bridge.say(knock(7, 1))
    wait_until(lambda: host.of(protocol.Knock))
    words(bridge, falls)
    before = host.ask(protocol.Ping(1), protocol.Pong).board_us
    bridge.say(knock(8, 1))  # the light of the first one is falling
    words(bridge, lambda w: not falls(w))
    words(bridge, falls)
    after = host.ask(protocol.Ping(2), protocol.Pong).board_us
    assert after - before >= HELD_US


def of_each(word):
    """Return a mask of the blocks that may fall by themselves."""
    return int.from_bytes(word[15:18], 'little') | (word[1] & 16) << 20 if word[1] & 8 else 0


def test_each_block_is_limited_by_itself(bridge, host):
    words(bridge, lambda w: of_each(w) == 2**25 - 1)  # it has held, and knows nothing of light
    for number in range(4):
        bridge.say(knock(24, number))
        wait_until(lambda: host.of(protocol.Knock))
        host.ask(protocol.Ping(1), protocol.Pong)
    words(bridge, lambda w: of_each(w) == 2**24 - 1)
    bridge.say(bytes([LIT, 3, *bytes(7), 1]).ljust(FRAME, b'\0'))  # a weak knock that is not told
    words(bridge, lambda w: of_each(w) == 2**25 - 1)
    assert not [k for k in host.of(protocol.Knock) if k.block == 3]
    bridge.say(status(5))
    words(
        bridge, lambda w: not of_each(w) >> 5 & 1 and of_each(w) & 1
    )  # it holds, for it is silent
    for number in (3, 5, 24):
        bridge.say(status(number))
    words(bridge, lambda w: of_each(w) == 2**25 - 1)


def test_while_a_block_is_silent_nothing_falls(bridge, host):
    host.ask(protocol.Lighting(3, 255, 350), protocol.BlockStatus)
    wait_until(lambda: len(host.of(protocol.BlockStatus)) == 26)
    host.heard.clear()
    words(bridge, falls)
    bridge.say(status(5))
    heard = wait_until(
        lambda: [s for s in host.of(protocol.BlockStatus) if s.block == 5 and s.flags]
    )
    assert heard[-1] == protocol.BlockStatus(5, 3700, 24, *FIRMWARE, protocol.LINKED)
    bridge.say(status(6, flags=protocol.LINKED | protocol.ASLEEP))
    words(bridge, falls)
    words(bridge, lambda w: not falls(w))
    gone = wait_until(
        lambda: [s for s in host.of(protocol.BlockStatus) if not s.flags & protocol.LINKED]
    )
    assert {s.block for s in gone} == {5}  # who sleeps is silent and all the same there
    bridge.say(status(5))
    words(bridge, falls)


def test_the_host_takes_it_for_its_board(bridge):
    taps = []
    board = Board(bridge.port, taps.append)
    board.configure(protocol.Lighting(3, 255, 350), protocol.Detector())
    board.start()
    try:
        wait_until(lambda: board.ready and board.sync.ready and len(board.blocks) == 26)
        bridge.say(knock(12, 1))
        tap = wait_until(lambda: taps)[0]
        assert (tap.block, tap.strength, tap.lit_s) == (12, 2.99, pytest.approx(1.1e-3))
        assert board.version == 2
    finally:
        board.close()


def test_the_leds_node_opens_it_and_publishes_its_taps(bridge, ros):
    from eol_msgs.msg import BlockTap
    from support.spinning import Nodes

    from eol_ros.nodes.leds import LedsNode
    from eol_ros.ros.node import EolNode

    class Listener(EolNode):
        NAME = 'motion'

    leds = LedsNode(LedsSettings(port=bridge.port))
    listener, taps = Listener(MotionSettings()), []
    listener.subscribe('block_taps', taps.append)
    number = iter(range(1, 10**6))

    def tapped():
        if leds.lights.board.sync.ready and not taps:
            bridge.say(knock(4, next(number) % 256))
            bridge.sent(0.05)
        return taps

    with Nodes(leds, listener) as nodes:
        tap = nodes.until(tapped)[0]
    assert isinstance(tap, BlockTap)
    assert tap.block == 4


def noise(bridge, host, rng, count):
    """Write `count` bytes on each line: packets that are whole or spoilt, and what is none."""
    kinds = [kind for kind in protocol.MESSAGES if kind < 0x80]
    written = 0
    while written < count:
        choice = rng.random()
        data = rng.randbytes(rng.randint(1, 120))
        if choice < 0.4:
            body = rng.randbytes(protocol.MESSAGES[rng.choice(kinds)].BODY.size)
            packet = bytes([rng.choice(kinds), 0]) + body
            packet += struct.pack('<H', protocol.crc16(packet))
            data = b'\0' + protocol.cobs_encode(packet) + b'\0'
            if choice < 0.1:
                at = rng.randrange(len(data))
                data = data[:at] + rng.randbytes(1) + data[at + 1 :]
        host.write(data)
        bridge.noise(rng.randbytes(len(data)))
        bridge.say(rng.choice((b'K', b'S', b'W')) + rng.randbytes(17))
        host.look()
        host.heard.clear()
        written += len(data)


def assert_lives(bridge, host):
    assert host.ask(protocol.Hello(), protocol.Welcome).version == 2
    host.ask(protocol.Lighting(protocol.BY_ITSELF, 255, 350), protocol.BlockStatus)
    number = iter(range(1, 10**6))
    bridge.noise(b'\0')

    def told():
        bridge.say(knock(3, next(number) % 256, strength=777))
        bridge.sent(0.02)
        return [k for k in host.of(protocol.Knock) if (k.block, k.strength) == (3, 777)]

    wait_until(told)


def test_whatever_the_lines_bring_it_goes_on(bridge, host):
    noise(bridge, host, random.Random(1), 40_000)
    assert_lives(bridge, host)


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_a_million_bytes_on_each_line_do_not_stop_it(bridge, host):
    noise(bridge, host, random.Random(2), 1_000_000)
    assert_lives(bridge, host)


def test_the_watchdog_ends_a_hang(bridge, host):
    host.send(protocol.Infrared(1))
    words(bridge, lambda w: w[5:9] == b'\1\0\0\0')
    bridge.hang()
    # started again it knows nothing of the host: all infrared LEDs shine
    words(bridge, lambda w: w[5:9] == b'\xff\xff\xff\x01')
    assert host.ask(protocol.Ping(1), protocol.Pong).board_us < 2**31
    assert_lives(bridge, host)


def test_a_reset_in_the_middle_of_anything_is_survived(bridge, host):
    rng = random.Random(3)
    for _ in range(10):
        noise(bridge, host, rng, rng.randrange(1, 3000))
        bridge.reset()
    assert_lives(bridge, host)
