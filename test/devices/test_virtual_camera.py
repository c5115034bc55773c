# SPDX-License-Identifier: Apache-2.0
"""The virtual camera keeps absolute deadlines, counts what it skips, hides no fault."""

import itertools
import threading
import time

from eol_ros.devices.camera.exposure_clock import NS, VirtualCamera


def film(count, rate_hz=200.0, slow=()):
    """Run until `count` images are delivered; return their stamps and the camera."""
    stamps, done = [], threading.Event()

    def expose(index, stamp_ns):
        stamps.append(stamp_ns)
        if index in slow:
            time.sleep(5.5 / rate_hz)

    def deliver():
        if len(stamps) == count:
            done.set()

    camera = VirtualCamera(rate_hz, 0.001, expose, deliver)
    assert done.wait(10)
    camera.close()
    return stamps[:count], camera


def test_stamps_stand_on_the_grid_even_after_slow_images():
    stamps, camera = film(30, slow={4, 11})
    period_ns = NS / 200
    steps = [(b - a) / period_ns for a, b in itertools.pairwise(stamps)]
    assert all(abs(step - round(step)) < 1e-6 for step in steps)
    skipped = sum(round(step) - 1 for step in steps)
    assert skipped >= 4
    assert camera.missed >= skipped
    assert camera.fault is None


def test_delivery_waits_for_the_end_of_the_exposure():
    late = []
    camera = VirtualCamera(
        100.0, 0.004, lambda i, ns: late.append(ns), lambda: late.append(time.time_ns() - late[-1])
    )
    time.sleep(0.2)
    camera.close()
    waits = late[1::2]
    assert len(waits) > 5
    assert min(waits) >= 0.0019 * NS


def test_a_fault_is_kept():
    def expose(index, stamp_ns):
        raise RuntimeError('lens cap')

    camera = VirtualCamera(200.0, 0.001, expose, lambda: None)
    time.sleep(0.05)
    assert str(camera.fault) == 'lens cap'
    camera.close()
