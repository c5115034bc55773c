# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.camera_clock import CameraClock

ORIGIN_NS = 10**18 + 123_456_789  # a clock of its own, for longer than 32 bits of microseconds


def device_ns(host_s, rate=5e-5):
    return ORIGIN_NS + round(host_s * (1 + rate) * 1e9)


def test_a_clock_that_is_asked_is_known_within_the_error_that_is_told():
    rng, clock = np.random.default_rng(1), CameraClock(0.01)
    for k in range(60):
        sent = 100 + k * 0.5
        there, back = rng.uniform(50e-6, 400e-6, 2)
        clock.exchange(sent, device_ns(sent + there), sent + there + back)
        if k >= 10:
            true = sent + 0.37
            found = clock.to_host(device_ns(true))
            assert abs(found.time_s - true) <= found.sigma_s
            assert found.sigma_s < 300e-6


@pytest.mark.parametrize('rate', [-1e-4, 0.0, 1e-4])
def test_a_clock_that_cannot_be_asked_loses_its_jitter_and_keeps_its_delay(rate):
    rng, clock, errors = np.random.default_rng(2), CameraClock(1 / 60), []
    for k in range(60 * 60):
        true = 50 + k / 60
        jitter = rng.exponential(2e-3) + (0.4 if k == 700 else 0)  # once, the machine was away
        clock.arrival(device_ns(true, rate), true + 4e-3 + jitter)
        if k > 600:
            found = clock.to_host(device_ns(true, rate))
            errors.append(found.time_s - true)
            assert 0 <= errors[-1] <= found.sigma_s

    assert np.median(errors) == pytest.approx(4e-3, abs=1e-3)
    assert np.std(errors) < 0.5e-3  # 2 ms as they come


def test_a_clock_that_was_set_is_learnt_again():
    clock = CameraClock(0.02)
    for k in range(600):
        true = 10 + k / 60
        shift_ns = 0 if k < 300 else -5 * 10**9
        clock.arrival(device_ns(true) + shift_ns, true + 3e-3)

    assert clock.to_host(device_ns(true) - 5 * 10**9).time_s == pytest.approx(true + 3e-3, abs=1e-3)


def test_arrivals_are_of_no_use_once_the_clock_was_asked():
    clock = CameraClock(0.02)
    clock.exchange(1.0, device_ns(1.0001), 1.0002)
    clock.arrival(device_ns(2.0), 3.0)

    assert clock.to_host(device_ns(2.0)).time_s == pytest.approx(2.0, abs=2e-4)
