# SPDX-License-Identifier: Apache-2.0
"""The program of the bridge on an emulated STM32F103, with a radio, blocks and a host around it.

Time is that of the emulated bridge.
"""

import itertools
import random
import struct
import subprocess

import numpy as np
import pytest
from support import needs
from support.emulated import (
    FRAME,
    HZ,
    KNOCK,
    MS,
    RATE_HZ,
    SENT,
    STATUS,
    TESTED,
    WORD,
    Block,
    built,
)  # fmt: skip
from support.emulated_bluepill import (
    AIR_US,
    ANSWER_US,
    HIGH,
    LOW,
    NO_CE,
    POWER,
    TO_BLOCKS,
    BluePill,
    packet,
)  # fmt: skip

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.serial_protocol import BRIDGE, FIRMWARE, LINKED, RADIO_DEAD
from eol_ros.devices.board.lights import faults

pytestmark = [
    pytest.mark.firmware,
    needs.marker('gcc-arm-none-eabi', 'libnewlib-arm-none-eabi', 'libunicorn-dev', 'gcc-avr',
                 'libsimavr-dev'),
]  # fmt: skip
FLASH, RAM = 65536, 20480
US = HZ // 1_000_000
STEP_US = 20
BLOCK = 7
BY_ITSELF, FALLS = 1, 4


class Host:
    """What the bridge tells, and what it is told."""

    def __init__(self, pill):
        self._pill, self._decoder, self._sequence = pill, protocol.Decoder(), 0
        self.heard = []

    def send(self, message):
        self._pill.write(protocol.encode(message, self._sequence))
        self._sequence = (self._sequence + 1) & 0xFF

    def look(self, kind):
        """Return what has come of one kind since the last call."""
        self.heard += [r.message for r in self._decoder.feed(self._pill.read())]
        found = [m for m in self.heard if isinstance(m, kind)]
        self.heard = [m for m in self.heard if not isinstance(m, kind)]
        return found

    def ask(self, message, kind, us=5000):
        self.send(message)
        self._pill.run(us)
        return self.look(kind)


@pytest.fixture
def pill():
    with BluePill() as one:
        one.run(10_000)
        yield one
        assert one.counts.strange == 0  # nothing that manual or data sheet forbids


@pytest.fixture
def host(pill):
    return Host(pill)


def knock(number, age_us=6000, block=BLOCK, strength=299, lit_us=1100, flags=0):
    packed = struct.pack('<BBBHHHB', KNOCK, block, flags, age_us, strength, lit_us, number)
    return packed.ljust(FRAME, b'\0')


def status(block, flags=LINKED):
    return struct.pack('<BBHbBBB', STATUS, block, 3700, 24, *FIRMWARE, flags).ljust(FRAME, b'\0')


def offer(pill, frame, number):
    """Send a packet; return whether it was acknowledged. Words that it sends meanwhile are lost."""
    pill.run(AIR_US)
    took = pill.hears(packet(frame, pill.now_us, number))
    pill.run(ANSWER_US + STEP_US)
    return took and pill.answered


def say(pill, frame, number=itertools.count(1)):  # noqa: B008, numbers go on
    """Send a frame as a block does, until it is acknowledged."""
    own = next(number) & 3
    while not offer(pill, frame, own):
        pill.run(1000)


def words(pill, wanted):
    """Return the words that the bridge says until one is `wanted`."""
    found = []
    while not any(map(wanted, found)):
        assert len(found) < 10_000, 'it has not come in 20 s'
        found += [one.frame for one in pill.run(10_000) if one.frame[0] == WORD]
    return found


def falls(word):
    return bool(word[1] & FALLS)


def alone(pill, us):
    """Wait until the bridge has just begun to listen, `us` after the end of a word."""
    while not (words := pill.run(STEP_US)):
        pass
    assert words[-1].frame[0] == WORD
    pill.run(us)


def test_it_says_who_it_is_and_refuses_another_version(host):
    name = b'eol bridge %d.%d\0\0' % FIRMWARE
    assert host.ask(protocol.Hello(), protocol.Welcome) == [protocol.Welcome(2, 225, name)]
    assert host.ask(protocol.Hello(1), protocol.Refused) == [protocol.Refused(2, 1)]


def test_it_tells_the_blocks_what_the_host_wants(pill, host):
    host.send(protocol.Lighting(protocol.LIMITED, 200, 500))
    host.send(protocol.Infrared(0b1010))
    last = words(pill, lambda w: struct.unpack_from('<I', w, 5)[0] == 0b1010)[-1]
    assert (last[1] & BY_ITSELF, last[2], struct.unpack_from('<H', last, 3)[0]) == (0, 200, 500)
    pill.run(50_000)
    told = {s.block: s for s in host.look(protocol.BlockStatus)}
    assert sorted(told) == [*range(25), BRIDGE]
    assert told[BRIDGE] == protocol.BlockStatus(255, 0, 0, *FIRMWARE, 1)
    assert told[7].flags == 0  # not heard so far

    wanted = protocol.Detector(256, 13, 40, 7000, 67, 2016, 80640)
    host.send(wanted)
    found = next(one.frame for one in pill.run(50_000) if one.frame[0] != WORD)
    assert found[1:17] == wanted.BODY.pack(*vars(wanted).values())


def test_a_knock_is_told_once_by_its_number(pill, host):
    for _ in range(3):  # said again, as its acknowledgements were lost
        say(pill, knock(1))
    say(pill, knock(2, lit_us=protocol.NOT_LIT, flags=protocol.WOKE))
    say(pill, knock(200, block=8))
    say(pill, knock(1))  # after a reset of the block, say
    pill.run(5000)
    told = [(k.block, k.strength, k.lit_us, k.flags) for k in host.look(protocol.Knock)]
    one = (7, 299, 1100, 0)
    assert told == [one, (7, 299, protocol.NOT_LIT, protocol.WOKE), (8, 299, 1100, 0), one]


def test_a_block_is_asked_to_test_itself_until_it_has(pill, host):
    host.send(protocol.SelfTest(7))
    words(pill, lambda w: w[14] == 8)
    found = protocol.SelfTested(7, 1, 300, -340, 500, 1500, 100, 1350)
    frame = bytes([TESTED]) + found.BODY.pack(*vars(found).values())
    say(pill, frame.ljust(FRAME, b'\0'))
    words(pill, lambda w: w[14] == 0)
    assert host.look(protocol.SelfTested) == [found]
    host.send(protocol.SelfTest(25))  # there is none
    pill.run(10_000)
    assert words(pill, lambda w: True)[-1][14] == 0


def test_an_order_to_light_is_in_the_words_for_a_while_only(pill, host):
    first = words(pill, lambda w: True)[-1]
    host.send(protocol.Light(5, 1 << 3))
    host.send(protocol.Light(5, 1 << 9))
    both = words(pill, lambda w: struct.unpack_from('<I', w, 9)[0] == 1 << 3 | 1 << 9)[-1]
    assert both[13] == (first[13] + 2) & 0xFF
    gone = words(pill, lambda w: not any(w[9:13]))[-1]
    assert gone[13] == both[13]


def test_while_a_block_is_silent_nothing_falls(pill, host):
    host.ask(protocol.Lighting(3, 255, 350), protocol.BlockStatus)
    words(pill, falls)
    say(pill, status(5))
    say(pill, status(6, flags=LINKED | protocol.ASLEEP))
    words(pill, falls)
    heard = [s for s in host.look(protocol.BlockStatus) if s.block == 5 and s.flags]
    assert heard[-1] == protocol.BlockStatus(5, 3700, 24, *FIRMWARE, LINKED)
    words(pill, lambda w: not falls(w))
    pill.run(1000)
    gone = [s for s in host.look(protocol.BlockStatus) if not s.flags & LINKED]
    assert {s.block for s in gone} == {5}  # who sleeps is silent and all the same there
    say(pill, status(5))
    words(pill, falls)


def test_it_serves_225_blocks(pill, host):
    """Words of nine groups take turns; orders go first; knocks of all come through; it has room."""
    everyone = (1 << 225) - 1
    host.send(protocol.Lattice(15, 3, 225))
    host.send(protocol.Lighting(protocol.LIMITED | protocol.EACH_FIELD, 255, 100))
    host.send(protocol.Infrared(everyone & ~(1 << 224)))
    rng, knocks = random.Random(5), 0
    for number in range(225):
        say(pill, status(number))
    for number in range(600):  # some 170 a second, and 30 orders a second to all
        say(pill, knock(number & 255, block=rng.randrange(225)))
        knocks += 1
        if number % 5 == 0:
            host.send(protocol.Light(0, everyone))
        pill.run(5000)
    statuses = {s.block: s.flags for s in host.look(protocol.BlockStatus)}
    assert statuses == dict.fromkeys([*range(225), BRIDGE], LINKED)
    assert len(host.look(protocol.Knock)) == knocks
    pill.run(300_000)  # the last order is over
    said = [one.frame for one in pill.run(18_000)]
    assert sorted(w[0] - WORD for w in said) == [*range(9)]
    infrared = [struct.unpack_from('<I', w, 5)[0] for w in sorted(said)]
    assert infrared == [8 << 28 | 2**25 - 1] * 8 + [8 << 28 | 2**24 - 1]
    host.send(protocol.Light(0, 1 << 30 | 1 << 200))
    first = [one.frame for one in pill.run(4500)][-2:]
    orders = {w[0] - WORD: struct.unpack_from('<I', w, 9)[0] for w in first}
    assert orders == {1: 1 << 5, 8: 1 << 0}
    counts, sections = pill.counts, dict(sizes())
    ram, busy = sections['data'] + sections['bss'], 1 - counts.asleep / counts.cycles
    print(f'225 blocks: RAM {ram + counts.stack} of {RAM} bytes, awake {busy:.1%}')
    assert ram + counts.stack < RAM - 512 and busy < 0.9


def test_it_says_a_word_every_2_ms_to_the_address_of_the_blocks(pill):
    words = pill.run(100_000)
    assert len(words) in (50, 51)
    assert {w.frame[0] for w in words} == {WORD}
    assert {bytes(w.address) for w in words} == {TO_BLOCKS}
    assert all(w.unanswered for w in words)
    apart = np.diff([w.end_ns for w in words]) / 1e6
    assert apart.min() > 1.9 and apart.max() < 2.3
    assert pill.lit


def test_it_fits():
    with BluePill() as pill, Block(BLOCK) as block:
        table = Air(pill, block)
        table.slips(np.random.default_rng(3), 4)
        table.run(3_000_000)
        counts = pill.counts
    sections = dict(sizes())
    flash, ram = sections['text'] + sections['data'], sections['data'] + sections['bss']
    busy = 1 - counts.asleep / counts.cycles
    print(f'flash {flash} of {FLASH}, RAM {ram + counts.stack} of {RAM} bytes, awake {busy:.1%}')
    assert flash < FLASH / 3
    assert ram + 2 * counts.stack < RAM  # only its depth where it went to sleep is seen
    assert busy < 0.5


def sizes():
    lines = subprocess.run(
        ['arm-none-eabi-size', str(built() / 'bluepill.elf')],
        check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    return zip(lines[0].split()[:3], map(int, lines[1].split()[:3]), strict=True)


def test_it_does_not_cut_off_its_own_acknowledgement(pill, host):
    """Whenever a frame comes that it hears, its sender learns so."""
    heard = lost = 0
    for number in range(1, 120):
        pill.run(17 * number % 2000)
        pill.run(AIR_US)
        took = pill.hears(packet(knock(number), pill.now_us, number & 3))
        pill.run(ANSWER_US + STEP_US)
        heard += took
        lost += took and not pill.answered
    print(f'of 119 frames at any time it heard {heard}')
    assert lost <= 2  # that came in the 10 us between its last look and its sending
    assert heard > 60
    pill.run(10_000)
    assert len(host.look(protocol.Knock)) == heard


@pytest.mark.parametrize('fault', [LOW, HIGH, NO_CE])
def test_a_radio_that_is_missing_is_one_line_and_comes_back(pill, host, fault):
    host.ask(protocol.Lighting(protocol.LIMITED, 255, 350), protocol.BlockStatus)
    pill.break_radio(fault)
    statuses = host.ask(protocol.Ping(1), protocol.BlockStatus, us=250_000)
    blocks = {s.block: s for s in statuses}
    assert blocks[BRIDGE].flags == LINKED | RADIO_DEAD
    assert not pill.lit
    (line,) = faults(blocks)
    assert line.startswith('the radio of the bridge does not work')
    assert host.ask(protocol.Ping(2), protocol.Pong)  # the host's line goes on
    pill.break_radio(0)
    (last,) = host.ask(protocol.Ping(3), protocol.BlockStatus, us=250_000)
    assert last.flags == LINKED
    alone(pill, 300)
    assert offer(pill, knock(1), 0)
    assert pill.counts.resets == 0


def test_a_radio_whose_supply_fails_is_set_up_again():
    rng = random.Random(4)
    with BluePill() as pill:  # until the bridge notices it says to the chip what that does not know
        host = Host(pill)
        for number in range(1, 6):
            pill.run(rng.randrange(5000))
            pill.break_radio(POWER)
            pill.run(250_000)
            alone(pill, 300)
            assert offer(pill, knock(number), number & 3)
        pill.run(1000)
        assert len(host.look(protocol.Knock)) == 5


def test_a_reset_at_any_moment_is_survived(pill, host):
    rng = random.Random(5)
    for number in range(1, 40):
        host.send(protocol.Lighting(protocol.LIMITED, 255, 350))
        offer(pill, knock(number), number & 3)
        pill.run(rng.randrange(2500))
        pill.reset()
        pill.run(rng.randrange(6000))
    pill.run(10_000)
    pill.write(b'\0')
    assert host.ask(protocol.Hello(), protocol.Welcome)
    alone(pill, 300)
    assert offer(pill, knock(200), 2)


def noise(pill, host, rng, count):
    """Write `count` bytes on each line: whole and damaged packets, and noise."""
    kinds = [kind for kind in protocol.MESSAGES if kind < 0x80]
    written = 0
    while written < count:
        choice = rng.random()
        data = rng.randbytes(rng.randint(1, 120))
        if choice < 0.4:
            body = rng.randbytes(protocol.MESSAGES[rng.choice(kinds)].BODY.size)
            packed = bytes([rng.choice(kinds), 0]) + body
            packed += struct.pack('<H', protocol.crc16(packed))
            data = b'\0' + protocol.cobs_encode(packed) + b'\0'
            if choice < 0.1:
                at = rng.randrange(len(data))
                data = data[:at] + rng.randbytes(1) + data[at + 1 :]
        pill.write(data)
        offer(
            pill, rng.choice((b'K', b'S', b'W', rng.randbytes(1))) + rng.randbytes(17), written & 3
        )
        host.look(protocol.Message)
        written += len(data)


def assert_lives(pill, host):
    pill.run(50_000)
    pill.write(b'\0')
    assert host.ask(protocol.Hello(), protocol.Welcome)
    host.send(protocol.Lighting(protocol.BY_ITSELF, 255, 350))
    for number in (7, 8):  # one of them may have been told
        say(pill, knock(number, strength=777))
    pill.run(50_000)
    assert any(k.strength == 777 for k in host.look(protocol.Knock))


@pytest.mark.parametrize(
    'count',
    [40_000, pytest.param(1_000_000, marks=[pytest.mark.soak, pytest.mark.timeout(3600)])],
)
def test_whatever_the_lines_bring_it_goes_on(pill, host, count):
    noise(pill, host, random.Random(1), count)
    assert_lives(pill, host)


def test_the_watchdog_ends_a_hang_within_60_ms(pill, host):
    pill.hang()
    pill.run(60_000)
    assert pill.counts.resets == 1
    assert pill.run(10_000)


class Air:
    """A block and the bridge, each with its own program and its own radio; `lost` of the packets.

    The bridge's clock leads; the block's crystal is right.
    """

    def __init__(self, pill, block, loss=0.0, seed=1):
        self.pill, self.block = pill, block
        self._random, self._loss = random.Random(seed), loss
        self._ahead = block.cycle - pill.now_us * US
        self._waits, self._number = None, 0
        self.knocks, self.onsets = [], []  # frames that left the block, and when it was struck

    def slips(self, rng, count, every=600, length=160):
        samples = rng.normal(0, 96, ((count + 1) * every + 900, 2))
        shape = 16 * 300 * np.cos(np.linspace(0, np.pi, length))
        begin = self.block.cycle + HZ / RATE_HZ
        for k in range(count):
            at = 900 + k * every
            samples[at : at + length, 0] += shape
            self.onsets.append((begin + at * HZ / RATE_HZ - self._ahead) / US)
        self.block.feel(np.rint(samples).astype(np.int16), begin)

    def _lost(self):
        return self._random.random() < self._loss

    def run(self, us):
        until = self.pill.now_us + us
        while self.pill.now_us < until:
            self.turn()

    def turn(self):
        words = self.pill.run(STEP_US)
        now_us = self.pill.now_us
        events = self.block.run(now_us * US + self._ahead - self.block.cycle)
        for word in words:
            if not self._lost():
                shifted = type(word).from_buffer_copy(word)
                ahead_ns = round(self._ahead / US * 1000)
                shifted.begin_ns, shifted.end_ns = word.begin_ns + ahead_ns, word.end_ns + ahead_ns
                self.block.hears(shifted)
        for event in events:
            if event.what != SENT:
                continue
            self._number = (self._number + 1) & 3
            end_us = (event.cycle - self._ahead) / US
            if event.frame[0] == KNOCK:
                self.knocks.append((end_us, event.frame))
            if not self._lost() and self.pill.hears(packet(event.frame, end_us, self._number)):
                self._waits = end_us + ANSWER_US
        if self._waits is not None and now_us >= self._waits:
            if self.pill.answered and not self._lost():
                self.block.acknowledged()
            self._waits = None


@pytest.mark.parametrize('loss', [0.0, 0.3])
def test_knocks_of_a_block_reach_the_host_once_and_with_their_time(loss):
    """Block, its radio, the air, the bridge's radio, the bridge, its line: each as it is built."""
    with BluePill() as pill, Block(BLOCK) as block:
        block.surround(acknowledged=False)  # but by the bridge
        host, air = Host(pill), Air(pill, block, loss)
        air.run(20_000)
        host.send(protocol.Lighting(protocol.LIMITED | protocol.BY_ITSELF, 255, 350))
        air.slips(np.random.default_rng(11), 8)
        air.run(700_000 + 8 * 450_000)
        told = host.look(protocol.Knock)
        (board_us,) = [p.board_us for p in host.ask(protocol.Ping(1), protocol.Pong)]
        offset_us = pill.now_us - board_us  # of the two clocks, to some ms
        assert len(air.onsets) == 8
        numbers = [frame[9] for _, frame in air.knocks]
        tries = np.bincount(np.unique(numbers, return_inverse=True)[1])
        onsets = zip(told, air.onsets, strict=True)
        late_us = [knock.board_us + offset_us - onset for knock, onset in onsets]
        print(
            f'loss {loss:.0%}: {len(told)} knocks told, in {tries.mean():.1f} tries each, '
            f'{tries.max()} at most; their times off by {np.std(late_us):.0f} us RMS'
        )
        assert {k.block for k in told} == {BLOCK}
        assert all(k.lit_us < 20_000 for k in told)
        assert np.std(late_us) < 1000
        statuses = [s for s in host.look(protocol.BlockStatus) if s.block == BLOCK]
        assert statuses and statuses[-1].flags == LINKED
        assert block.counts.strange == pill.counts.strange == 0


@pytest.mark.parametrize('fault', [LOW, HIGH])
def test_a_block_without_a_radio_goes_on_and_sleeps(fault):
    """Lines that always say ones, or zeros, are no frames: the watchdog has nothing to end."""
    with Block(BLOCK) as block:
        rng = np.random.default_rng(6)
        block.feel(np.rint(rng.normal(0, 96, (4000, 2))).astype(np.int16))
        block.run(50 * MS)
        short = struct.pack('<BHHHHHHI', 0x46, 0, 0, 0, 0, 0, 0, 1000).ljust(18, b'\0')
        assert block.hear(short)  # it sleeps after so many samples at rest
        block.run(20 * MS)
        block.break_radio(fault)
        block.run(2500 * MS)
        before = block.counts.power_down
        assert before > 0
        block.run(6000 * MS)  # it has looked for a word meanwhile, and sleeps on
        assert block.counts.power_down - before > 0.98 * 6000 * MS
