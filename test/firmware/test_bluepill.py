# SPDX-License-Identifier: Apache-2.0
"""The program of the bridge that docs/build tells how to build, with a radio and blocks around it.

Time is that of the emulated bridge. test_emulated_bridge.py has it at the host's own code.
"""

import ctypes
import random
import struct
import subprocess

import numpy as np
import pytest
from support import needs
from support.emulated import HZ, MS, RATE_HZ, SENT, WORD, Block, built
from support.emulated_bluepill import HIGH, LOW, NO_CE, NO_IRQ, POWER, TO_BLOCKS, BluePill

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.serial_protocol import BRIDGE, LINKED, RADIO_DEAD
from eol_ros.devices.board.bluepill import AIR_US, ANSWER_US, KNOCK, packet
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
TRIES = 12


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


def knock(number, age_us=6000, block=BLOCK):
    return struct.pack('<BBBHHHB', KNOCK, block, 0, age_us, 299, 1100, number).ljust(18, b'\0')


def offer(pill, frame, number):
    """Send a packet; return whether it was acknowledged. Words that it sends meanwhile are lost."""
    pill.run(AIR_US)
    took = pill.hears(packet(frame, pill.now_us, number))
    pill.run(ANSWER_US + STEP_US)
    return took and pill.answered


def alone(pill, us):
    """Wait until the bridge has just begun to listen, `us` after the end of a word."""
    while not (words := pill.run(STEP_US)):
        pass
    assert words[-1].frame[0] == WORD
    pill.run(us)


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
    assert flash < FLASH / 4
    assert ram + 2 * counts.stack < RAM  # only its depth where it went to sleep is seen
    assert busy < 0.5


def sizes():
    lines = subprocess.run(
        ['arm-none-eabi-size', str(built() / 'bluepill.elf')],
        check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    return zip(lines[0].split()[:3], map(int, lines[1].split()[:3]), strict=True)


def test_three_frames_at_once_are_read_and_a_fourth_finds_no_room(pill, host):
    alone(pill, 500)
    end_us = pill.now_us
    took = []
    for number in range(4):  # its processor gets no turn between them
        one = packet(knock(number + 1), end_us, number)
        one.unanswered = 1  # an acknowledgement would make it deaf for a while
        took.append(pill.hears(one))
    assert took == [True, True, True, False]
    pill.run(3000)
    assert len(host.look(protocol.Knock)) == 3
    alone(pill, 300)
    assert offer(pill, knock(4), 0)
    pill.run(1000)
    assert len(host.look(protocol.Knock)) == 1


def test_what_is_not_for_it_is_not_heard(pill, host):
    for change in ('address', 'channel', 'setup', 'size'):
        alone(pill, 300)
        pill.run(AIR_US)
        one = packet(knock(9), pill.now_us)
        if change == 'address':
            one.address = (ctypes.c_uint8 * 5)(*TO_BLOCKS)
        else:
            setattr(one, change, getattr(one, change) ^ 1 if change != 'setup' else 0x08)
        assert not pill.hears(one)
    pill.run(3000)
    assert not host.look(protocol.Knock)


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


def test_without_the_wire_of_its_interrupt_it_is_only_slower(pill, host):
    pill.break_radio(NO_IRQ)
    alone(pill, 300)
    assert offer(pill, knock(1), 0)
    pill.run(1000)
    assert len(host.look(protocol.Knock)) == 1


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
