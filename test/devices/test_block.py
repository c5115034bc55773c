# SPDX-License-Identifier: Apache-2.0
"""The detector of the firmware on steps, noise, rings and faults made here."""

from importlib.util import find_spec

import numpy as np
import pytest

from eol_ros.devices.board import block
from eol_ros.devices.board.block import (
    FELT,
    IDLE,
    LEARN,
    RESTS,
    TOLD,
    WINDOW,
    Detector,
    defaults,
)
from eol_ros.errors import DeviceMissing

pytestmark = pytest.mark.skipif(
    not block.compiled(), reason='in a checkout: python setup.py build_ext --inplace'
)
RATE_HZ = 1344.0
NOISE_MG = 5.7  # RMS of an LIS3DH at 1344 Hz: 220 ug/sqrt(Hz) over 672 Hz


def noise(random, count, sigma_mg=NOISE_MG, offset_mg=(31.0, -17.0)):
    """Samples (n, 2) of a block at rest, mg."""
    return np.array(offset_mg) + random.normal(0, sigma_mg, (count, 2))


def counts(mg):
    """As the sensor writes it in its normal mode: 4 mg a step, in 1/16 mg."""
    return np.clip(np.rint(np.asarray(mg) / 4) * 64, -32768, 32704).astype(np.int16)


def learnt(random, **more):
    detector = Detector()
    assert detector.feed(counts(noise(random, LEARN + 4000, **more))) == []
    assert detector.state == RESTS
    return detector


def slip(strength_mg, direction, lead, length=167, late=0.0):
    """Samples of a slip, the mean of the acceleration over each; it begins `late` of a sample
    after sample `lead`. Half a period of a sine, then the stop."""
    fine = 64
    time = (np.arange((lead + length + 200) * fine) + 0.5) / fine - lead - late
    signal = np.where((time > 0) & (time < length), np.cos(np.pi * time / length), 0.0)
    signal = strength_mg * signal.reshape(-1, fine).mean(axis=1)
    return signal[:, None] * (np.cos(direction), np.sin(direction))


def felt(detector, random, signal, **more):
    """Return what a signal (n, 2) in mg brings, in noise."""
    return [e.what for e in detector.feed(counts(signal + noise(random, len(signal), **more)))]


@pytest.mark.parametrize('strength_mg, rms_ms', [(30, 0.8), (60, 0.4), (250, 0.25), (1000, 0.25)])
def test_a_slip_is_felt_once_and_its_moment_and_strength_told(strength_mg, rms_ms):
    random = np.random.default_rng(1)
    detector = learnt(random)
    errors, delays = [], []
    for _ in range(100):
        late, lead = random.uniform(), 60
        signal = slip(strength_mg, random.uniform(0, 2 * np.pi), lead, late=late)
        events = detector.feed(counts(signal + noise(random, len(signal))))

        assert [e.what for e in events] == [FELT, TOLD]  # and not again where it stops
        felt, told = events
        assert told.strength_mps2 == pytest.approx(strength_mg * 9.80665e-3, rel=0.2, abs=0.06)
        errors.append((told.sample + 1 - told.age_samples - lead - late) / RATE_HZ * 1e3)
        delays.append((felt.sample + 1 - lead - late) / RATE_HZ * 1e3)
        assert detector.state == RESTS
    assert np.sqrt(np.mean(np.square(errors))) < rms_ms
    assert max(delays) < (3 if strength_mg > 100 else 14)


def test_noise_alone_is_felt_as_often_as_its_law_says():
    """The window's mean of two axes is Rayleigh distributed; a threshold that it does pass."""
    random, seconds, sigma_mg = np.random.default_rng(2), 100, 16.0
    config = defaults()
    config.threshold, config.ratio = 1, 5
    low, usual, felt = Detector(config), Detector(), 0
    for _ in range(seconds):
        mg = counts(noise(random, 1344, sigma_mg))
        for part in np.array_split(mg, 21):
            if any(e.what == FELT for e in low.feed(part)):
                felt += 1
                low.wake()  # it would wait for more calm than there is
        assert not any(e.what == FELT for e in usual.feed(mg))
    limit = low.limit_mg / (sigma_mg / WINDOW**0.5)
    assert limit == pytest.approx(5 / 4 * (2 / np.pi) ** 0.5 * 4, rel=0.03)
    above = seconds * RATE_HZ * np.exp(-(limit**2) / 2)  # samples; several in a row are one knock
    assert above / WINDOW < felt < above


def test_the_threshold_rises_with_the_noise_and_comes_back():
    random = np.random.default_rng(3)
    detector = learnt(random)
    still = detector.limit_mg
    detector.feed(counts(noise(random, 8000, 20.0)))
    loud = detector.limit_mg
    detector.feed(counts(noise(random, 12000)))

    assert still == detector.config.threshold / 16
    assert loud == pytest.approx(13 / 4 * (2 / np.pi) ** 0.5 * 20, rel=0.1)
    assert detector.limit_mg == still


def test_offset_and_a_slow_tilt_are_no_knock_and_a_new_offset_is_learnt():
    random = np.random.default_rng(4)
    detector = learnt(random, offset_mg=(300.0, -250.0))
    tilt = np.linspace(0, 40, 20_000)[:, None] * (1, 0)  # 40 mg in 15 s
    assert felt(detector, random, tilt, offset_mg=(300.0, -250.0)) == []

    rest = np.zeros((6000, 2))
    assert felt(detector, random, rest, offset_mg=(700.0, 0.0)) == [FELT, TOLD]
    assert detector.state == RESTS
    assert felt(detector, random, slip(250, 1.0, 50), offset_mg=(700.0, 0.0)) == [FELT, TOLD]


def test_a_speed_that_never_comes_back_does_not_make_it_deaf():
    """A push without a stop, as after an error of the base: still is still."""
    random = np.random.default_rng(11)
    detector = learnt(random)
    signal = np.zeros((3000, 2))
    signal[10:110] = 100.0, 0.0
    assert felt(detector, random, signal) == [FELT, TOLD]
    assert detector.state == RESTS
    assert felt(detector, random, slip(100, 2.0, 10)) == [FELT, TOLD]


def knocks(detector, random, strengths_mg):
    """Return what slips of such strengths bring, a list for each."""
    ways = random.uniform(0, 2 * np.pi, len(strengths_mg))
    return [
        felt(detector, random, slip(strength, way, 10))
        for strength, way in zip(strengths_mg, ways, strict=True)
    ]


def test_what_is_far_weaker_than_usual_is_lit_and_not_told():
    random = np.random.default_rng(12)
    detector = learnt(random)
    assert knocks(detector, random, [60] * 5) == [[FELT, TOLD]] * 5  # nothing is usual yet
    assert knocks(detector, random, [300] * 60) == [[FELT, TOLD]] * 60
    weak = knocks(detector, random, [40, 110, 40])
    assert weak == [[FELT], [FELT, TOLD], [FELT]]
    # the table is another one now: what was weak becomes usual
    assert knocks(detector, random, [40] * 40)[-20:] == [[FELT, TOLD]] * 20


def test_what_rings_counts_for_less_than_what_goes_on():
    random = np.random.default_rng(5)
    detector, time = learnt(random), np.arange(400) / RATE_HZ
    ring = 40 * np.exp(-time / 0.05) * np.sin(2 * np.pi * 60 * time)
    assert felt(detector, random, ring[:, None] * (1, 0)) == []
    assert felt(detector, random, slip(40, 0.0, 10)) == [FELT, TOLD]


def test_a_saturated_sensor_feels():
    random = np.random.default_rng(6)
    detector = learnt(random)
    signal = slip(9000, 0.3, 20)
    events = detector.feed(counts(signal + noise(random, len(signal))))
    assert events[0].what == FELT and events[1].strength_mps2 > 15


def test_sleep_and_the_first_knock_after_it():
    random = np.random.default_rng(7)
    detector = learnt(random)
    idle = detector.config.idle
    assert [e.what for e in detector.feed(counts(noise(random, idle)))] == [IDLE]
    detector.wake()
    signal = slip(250, 0.3, 0)
    events = detector.feed(counts(signal + noise(random, len(signal))))
    assert [(e.what, e.first) for e in events] == [(FELT, False), (TOLD, True)]
    events = detector.feed(counts(signal + noise(random, len(signal))))
    assert [(e.what, e.first) for e in events] == [(FELT, False), (TOLD, False)]
    events = detector.feed(counts(noise(random, idle + 10)))
    assert [e.what for e in events] == [IDLE]


def test_a_stuck_value_is_a_dead_sensor():
    random = np.random.default_rng(8)
    detector = learnt(random)
    assert not detector.dead
    detector.feed(np.full((4096, 2), 512, np.int16))
    assert detector.dead
    detector.feed(counts(noise(random, 10)))
    assert not detector.dead


def test_where_it_was_not_compiled_one_line_says_so(monkeypatch):
    monkeypatch.setattr(block, 'find_spec', lambda name: None)
    block.library.cache_clear()
    with pytest.raises(DeviceMissing, match='apt-get install'):
        Detector()
    assert not block.compiled()


def test_what_was_compiled_for_another_version_is_said(monkeypatch):
    another = find_spec('numpy.random.bit_generator')  # a library, without what is looked for
    monkeypatch.setattr(block, 'find_spec', lambda name: another)
    with pytest.raises(DeviceMissing, match='another version of eol_ros: install eol_ros again'):
        block.library.__wrapped__()
