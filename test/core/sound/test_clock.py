# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.sound.clock import frame_at, step_clock
from eol_ros.core.sound.mixer import Mixer

FS = 48000


def run(times, block, mixer=None):
    """Step the clock through callbacks at `times`; return the error of each in samples."""
    mixer = mixer or Mixer(FS)
    s = mixer.state[0]
    for now in times:
        step_clock(s, now)
        s['frame'] += block
    return mixer


def jitter(rng, count):
    """Lateness like a real callback's: a little always, much now and then."""
    seldom = rng.random(count) < 0.01
    return rng.exponential(60e-6, count) + seldom * rng.uniform(0, 2.5e-3, count)


@pytest.mark.parametrize(
    'block',
    [pytest.param(64, marks=pytest.mark.slow), 128, pytest.param(256, marks=pytest.mark.slow)],
)
def test_smooths_the_lateness_of_callbacks(block):
    rng = np.random.default_rng(1)
    count = 20 * FS // block
    true_rate = FS * (1 + 80e-6)  # a card that runs 80 ppm fast
    begun = 1000.0 + np.arange(count) * block / true_rate
    seen = begun + jitter(rng, count)
    mixer = Mixer(FS)
    s = mixer.state[0]
    errors, rates = [], []
    for now, true in zip(seen, begun, strict=True):
        step_clock(s, now)
        errors.append((mixer.time_of(s['frame']) - true) * FS)
        s['frame'] += block
        rates.append(1 / s['clock_period'])
    settled = np.array(errors[count // 4 :])
    assert s['clock_locks'] == 1
    assert settled.std() <= 2
    assert np.abs(settled - settled.mean()).max() <= 8
    assert (seen - begun).std() * FS > 3 * settled.std()
    assert np.mean(rates[count // 2 :]) == pytest.approx(true_rate, abs=1)


def test_maps_times_to_frames_and_back():
    mixer = run(5.0 + np.arange(100) * 256 / FS, 256)
    s = mixer.state[0]
    for frame in (0, 25600, 999_999):
        assert frame_at(s, mixer.time_of(frame)) == frame
    assert frame_at(s, 6.0) == FS


def test_locks_anew_when_the_system_clock_is_set_and_when_the_card_stood_still():
    period = 256 / FS
    mixer = run(1.0 + np.arange(100) * period, 256)
    run(501.0 + np.arange(100) * period, 256, mixer)
    s = mixer.state[0]
    assert s['clock_locks'] == 2
    assert frame_at(s, 501.0 + 100 * period) == pytest.approx(200 * 256, abs=1)
    run(502.0 + np.arange(100) * period, 256, mixer)
    assert s['clock_locks'] == 3


def test_a_nan_time_does_not_poison_it():
    mixer = run([1.0, np.nan, 1.0 + 512 / FS], 256)
    assert np.isfinite(mixer.state['clock_time'][0])


def test_without_callbacks_time_is_that_of_the_samples():
    s = Mixer(FS).state[0]
    assert [frame_at(s, k / FS) for k in (0, 1, 47999, 10**7)] == [0, 1, 47999, 10**7]
