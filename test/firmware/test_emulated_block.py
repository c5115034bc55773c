# SPDX-License-Identifier: Apache-2.0
"""The firmware of a block in an emulated ATmega328P, against the same C on the host.

`make firmware` installs the compiler and the emulator, builds and runs this.
"""

import ctypes
import random
import struct

import numpy as np
import pytest
from support import needs
from support.emulated import (
    FEELS,
    FRAME,
    HZ,
    INFRARED,
    KNOCK,
    LEVEL,
    MS,
    RATE_HZ,
    SENT,
    STATUS,
    TESTED,
    WORD,
    Block,
    built,
    symbol,
)
from support.paper import N_BLOCKS
from support.true_slips import FPS, Twin

from eol_ros.core.physics.twin.accelerometer import Accelerometers
from eol_ros.core.serial_protocol import FIRMWARE, NOT_LIT, SelfTested
from eol_ros.devices.board import self_test
from eol_ros.devices.board.block import FELT, LEARN, TOLD, Detector
from eol_ros.settings import TwinSettings

pytestmark = [
    pytest.mark.firmware,
    needs.marker('gcc-avr', 'avr-libc', 'libsimavr-dev'),
]
SAMPLE = HZ / RATE_HZ  # cycles
SAMPLE_US = 744  # as the firmware takes it
LATENCY = 2 * MS  # from the end of the sample that crosses the threshold to the LED's pin
NUMBER = 7


def word(falls=False, infrared=2**25 - 1, test=-1):
    frame = struct.pack('<BBBHIIBB', WORD, 1 + 4 * falls, 255, 350, infrared, 0, 0, test + 1)
    return frame.ljust(FRAME, b'\0')


def detector(*fields):
    return struct.pack('<B6HI', FEELS, *fields).ljust(FRAME, b'\0')


def counts(mg):
    return np.clip(np.rint(np.asarray(mg) / 4) * 64, -32768, 32704).astype(np.int16)


def at_rest(rng, count):
    return counts(np.array([31.0, -17.0]) + rng.normal(0, 5.7, (count, 2)))


def slips(rng, count, every=600, length=160):
    """Samples of a block that learns, then slips `count` times, each begun anywhere in a sample."""
    samples = at_rest(rng, LEARN + 1500 + count * every).astype(float)
    for k in range(count):
        begin = LEARN + 1500 + k * every
        way, strength = rng.uniform(0, 2 * np.pi), rng.uniform(40, 700) * 16
        shape = strength * np.cos(np.linspace(0, np.pi, length))
        shape[0] *= rng.uniform(0.1, 1.0)
        samples[begin : begin + length] += shape[:, None] * [np.cos(way), np.sin(way)]
    return np.clip(np.rint(samples / 64) * 64, -32768, 32704).astype(np.int16)


def twin_samples(seconds):
    """What the block of the twin feels that slips most often."""
    twin, sensors = Twin(5, 0.3), Accelerometers(TwinSettings(seed=5), always=True)
    parts = [[samples] for samples in sensors.at_rest(LEARN + 600)]
    for begin_s, end_s in twin.images(round(seconds * FPS)):
        moves = bool(twin.rim.velocity.any())
        for part in sensors.advance(
            begin_s, end_s, twin.table.trace, moves, np.ones(N_BLOCKS, bool)
        ):
            parts[part.block].append(part.xy)
    blocks = [np.concatenate(part) for part in parts]
    return max(blocks, key=lambda samples: len(natively(samples)[1]))


def natively(samples):
    """Return the detector of the host after these samples, and what they brought."""
    detector, events = Detector(), []
    for begin in range(0, len(samples), 1000):
        found = detector.feed(samples[begin : begin + 1000])
        events += [e._replace(sample=begin + e.sample) for e in found]
    return detector, events


def sent(events, kind):
    return [e for e in events if e.what == SENT and e.frame[0] == kind]


def talking(block, cycles, say, every=2 * MS):
    """Run with a word of the bridge every 2 ms."""
    events, until = [], block.cycle + round(cycles)
    while block.cycle < until:
        block.hear(say)
        events += block.run(min(every, until - block.cycle))
    return events


@pytest.fixture
def block():
    with Block(NUMBER) as one:
        one.run(20 * MS)
        one.feel(at_rest(np.random.default_rng(1), 100_000))  # until a test gives something else
        yield one
        assert one.counts.strange == 0  # it asked its parts for nothing that they do not know


def test_the_emulated_block_feels_what_the_native_one_does(block):
    """Its detector's memory is the same to the last bit, and so is what it reports."""
    samples = twin_samples(12.0)
    native, found = natively(samples)
    told = [e for e in found if e.what == TOLD]
    assert len(told) > 10

    last = block.feel(samples)
    events = talking(block, last - block.cycle + 20 * MS, word())

    assert block.counts.read == len(samples)
    assert block.counts.lost == 0
    size = native._lib.eol_knock_size()
    assert block.memory(symbol('block'), size) == ctypes.string_at(native._memory, size)
    knocks = {}
    for event in sent(events, KNOCK):
        knocks.setdefault(event.frame[9], event)  # the first try of each
    assert list(knocks) == [(k + 1) % 256 for k in range(len(told))]
    first = last - (len(samples) - 1) * SAMPLE
    for event, expected in zip(knocks.values(), told, strict=True):
        _, number, flags, age_us, strength, lit_us, _ = struct.unpack('<BBBHHHB', event.frame[:10])
        onset = first + expected.sample * SAMPLE - expected.age_samples * SAMPLE_US * HZ / 1e6
        assert (number, flags) == (NUMBER, 0)
        assert strength == pytest.approx(expected.strength_mps2 * 100, abs=1.01)
        # in the air 217 us, settled 130 us, written in some 200 us
        assert (event.cycle - onset) / 8 - age_us == pytest.approx(550, abs=250)
        assert lit_us < 20_000 and lit_us != NOT_LIT


@pytest.mark.parametrize('alone', [False, True], ids=['busy radio', 'no bridge'])
def test_light_follows_the_sample_that_crosses_the_threshold_within_2_ms(block, alone):
    """From the end of that sample to the pin, whatever the block is doing."""
    rng = np.random.default_rng(3)
    samples = slips(rng, 30)
    felt = [e.sample for e in natively(samples)[1] if e.what == FELT]
    assert len(felt) == 30
    last = block.feel(samples)
    left = last - block.cycle
    # words drift through all phases of a sample
    events = block.run(left) if alone else talking(block, left, word(True), 2.03 * MS)
    on = np.array([e.cycle for e in events if (e.what, e.value) == (LEVEL, 255)])
    ended = last - (len(samples) - 1 - np.array(felt)) * SAMPLE
    late = on[np.searchsorted(on, ended)] - ended
    print(f'{np.median(late):.0f} cycles in the median, {late.max():.0f} at most')
    assert late.max() <= LATENCY


def test_it_fits(block):
    rng = np.random.default_rng(1)
    last = block.feel(slips(rng, 3))
    talking(block, last - block.cycle, word(True))
    flash = len((built() / 'block.bin').read_bytes())
    ram = block.counts.ram  # bytes that were ever written to: variables and the deepest stack
    awake = 1 - block.counts.asleep / block.cycle
    print(f'flash {flash} of 32768 bytes, RAM {ram} of 2048, processor {awake:.0%} of the time')
    assert flash < 16384
    assert ram < 1024
    assert awake < 0.95


@pytest.mark.parametrize('interrupts', [False, True], ids=['deaf', 'with interrupts'])
def test_the_watchdog_ends_a_hang(block, interrupts):
    talking(block, 100 * MS, word())
    block.hang(interrupts)
    events = block.run(100 * MS)
    assert not sent(events, STATUS)

    events = talking(block, 150 * MS, word())

    assert len(sent(events, STATUS)) == 1  # it has started again, and says so
    assert_lives(block)


def assert_lives(block, seed=9):
    """It learns, feels a knock, lights itself and says so; and takes a word."""
    samples = slips(np.random.default_rng(seed), 1)
    last = block.feel(samples)
    events = talking(block, last - block.cycle + 50 * MS, word())
    assert 255 in [e.value for e in events if e.what == LEVEL]
    knock = sent(events, KNOCK)
    assert len(knock) == 1 and knock[0].frame[1] == NUMBER
    events = talking(block, 20 * MS, word(infrared=0))
    assert [e.value for e in events if e.what == INFRARED][-1:] == [0]
    events = talking(block, 20 * MS, word())
    assert [e.value for e in events if e.what == INFRARED][-1:] == [1]


def test_a_reset_in_the_middle_of_anything_is_survived():
    """At random cycles, so in the middle of a byte on I2C, of a frame, of a division."""
    rng = random.Random(2)
    samples = slips(np.random.default_rng(2), 40)
    with Block(NUMBER) as block:
        for _ in range(60):
            block.feel(samples)
            talking(block, rng.uniform(0, 900) * MS if rng.random() < 0.2 else 40 * MS, word(True))
            block.run(rng.randrange(1, 20_000))
            block.reset()
        assert_lives(block)


def test_it_gives_up_where_nobody_hears_it_and_flashes_all_the_same():
    samples = slips(np.random.default_rng(4), 3)
    with Block(NUMBER) as block:
        block.surround(acknowledged=False)
        last = block.feel(samples)
        events = block.run(last - block.cycle + 100 * MS)
        tries = [e.frame[9] for e in sent(events, KNOCK)]
        assert {k: tries.count(k) for k in set(tries)} == {1: 12, 2: 12, 3: 12}
        assert block.counts.level > 150  # it holds: tau 4 s


def test_light_dies_away_as_the_bridge_says(block):
    """By its decay time while words say that light may fall, else by 8 % in a third of a second."""
    samples = slips(np.random.default_rng(4), 1, every=2000)
    last = block.feel(samples)
    lit = last - 2000 * SAMPLE
    talking(block, lit + 400 * MS - block.cycle, word())
    on, level = block.counts.level, block.counts.level
    assert level == pytest.approx(255 * np.exp(-0.4 / 4.003), abs=2)
    talking(block, 350 * MS, word(True))
    level = block.counts.level
    assert level == pytest.approx(on * np.exp(-0.35 / 0.35), rel=0.05)
    block.run(300 * MS)  # no word: it holds
    assert block.counts.level == pytest.approx(level * np.exp(-0.3 / 4.003), abs=2)


def test_a_sensor_that_is_gone_is_told_and_taken_up_again(block):
    talking(block, 1200 * MS, word())
    block.surround(dead_bus=True)
    events = talking(block, 300 * MS, word())
    assert [e.frame[7] & 2 for e in sent(events, STATUS)] == [2]
    block.surround(dead_bus=False)
    events = talking(block, 300 * MS, word())
    assert [e.frame[7] & 2 for e in sent(events, STATUS)] == [0]
    assert_lives(block)


def test_battery_temperature_and_version_are_told(block):
    events = talking(block, 2500 * MS, word())
    kind, number, millivolts, celsius, major, minor, flags = struct.unpack(
        '<BBHbBBB', sent(events, STATUS)[-1].frame[:8]
    )
    assert (kind, number, major, minor, flags) == (STATUS, NUMBER, *FIRMWARE, 1)
    assert millivolts == pytest.approx(3700, abs=10)  # a step of the converter is 4.3 mV
    assert celsius == pytest.approx(24, abs=2)


def found_by(events):
    """Return what self-tests have told, and how the host reads it."""
    found = [SelfTested(*SelfTested.BODY.unpack(e.frame[1:15])) for e in sent(events, TESTED)]
    return found, [sentence for one in found for sentence in self_test.faults(one)]


def test_it_tests_itself_when_the_bridge_asks_and_goes_on(block):
    talking(block, 600 * MS, word())
    events = talking(block, 50 * MS, word(test=3))  # another one
    events += talking(block, 400 * MS, word(test=NUMBER))
    found, wrong = found_by(events)
    assert len(found) == 1 and wrong == []
    assert (found[0].block, found[0].flags) == (NUMBER, 1)
    pulled = (found[0].x_mg, found[0].y_mg, found[0].z_mg)
    assert pulled == pytest.approx((300, 340, 500), abs=7)  # noise of two means of 16
    volts = (found[0].white_off_mv, found[0].white_on_mv, found[0].infrared_mv)
    assert volts == pytest.approx((1500, 100, 1350), abs=9)
    assert not sent(events, KNOCK)
    assert_lives(block)


@pytest.mark.parametrize(
    ('broken', 'says'),
    [
        (1, ['along x', 'along y', 'along z']),
        (2, ['its white LED does not conduct']),
        (4, ['its infrared LED does not conduct']),
        (8, ['its white LED is not switched on']),
    ],
)
def test_a_self_test_finds_what_is_broken(block, broken, says):
    block.break_parts(broken)
    _, wrong = found_by(talking(block, 400 * MS, word(test=NUMBER)))
    assert len(wrong) == len(says)
    assert all(one in sentence for one, sentence in zip(says, wrong, strict=True))


def test_a_block_that_rests_sleeps_and_wakes_at_a_knock(block):
    rng = np.random.default_rng(6)
    block.feel(at_rest(rng, 6000))
    talking(block, 50 * MS, word())
    assert block.hear(detector(0, 0, 0, 0, 0, 0, 1000))  # so many samples at rest
    talking(block, 2500 * MS, word())
    before, cycle = block.counts, block.cycle
    events = block.run(9000 * MS)
    after = block.counts
    power_down = (after.power_down - before.power_down) / (block.cycle - cycle)
    print(f'powered down for {power_down:.1%} of the time')
    assert power_down > 0.99
    assert not sent(events, KNOCK)
    assert after.infrared == 1
    woken = block.cycle + 100 * MS
    slip = at_rest(rng, 1134).astype(int)
    slip[134:294, 0] += 16 * np.rint(300 * np.cos(np.linspace(0, np.pi, 160))).astype(int)
    block.feel(slip, woken - 134 * SAMPLE)
    events = talking(block, 600 * MS, word())
    knock = sent(events, KNOCK)
    assert [e.frame[2] for e in knock] == [1]  # it slept until then
    lit = next(e.cycle for e in events if (e.what, e.value) == (LEVEL, 255))
    print(f'a first knock lights it after {(lit - woken) / MS:.1f} ms')
    assert lit - woken < 20 * MS


def fuzz(block, rng, frames):
    for n in range(frames):
        frame = bytearray(rng.randbytes(FRAME))
        if n % 3:
            frame[0] = rng.choice((WORD, FEELS))
        block.hear(bytes(frame))
        block.run(rng.randrange(400, 6000))
        if n % 500 == 0:
            block.feel(at_rest(np.random.default_rng(n), 3000))


def restore(block):
    """Any detector's numbers are obeyed, also those that let it sleep: set them right again."""
    right, knocked = detector(256, 13, 40, 7000, 67, 2016, 80640), np.zeros((60, 2), np.int16)
    knocked[40:] = 9000
    for _ in range(400):
        if block.hear(right):
            break
        block.feel(knocked)
        block.run(7 * MS)
    else:
        raise AssertionError('it never listens')
    block.feel(at_rest(np.random.default_rng(0), 500))
    talking(block, 300 * MS, word())


def test_whatever_the_radio_brings_it_goes_on(block):
    fuzz(block, random.Random(1), 3000)  # 54 000 bytes
    restore(block)
    assert_lives(block)


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_a_million_bytes_do_not_stop_it(block):
    fuzz(block, random.Random(2), 1_000_000 // FRAME + 1)
    restore(block)
    assert_lives(block)
    assert block.counts.ram < 1024
