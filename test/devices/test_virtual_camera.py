# SPDX-License-Identifier: Apache-2.0
"""The virtual camera keeps absolute deadlines, counts what it skips, hides no fault."""

import itertools
import threading

import numpy as np
from support.waiting import wait_until

from eol_ros.devices.camera.exposure_clock import NS, SPARE_NS, VirtualCamera, moved_to

RATE_HZ, PERIOD_NS, EXPOSURE_S = 200.0, NS // 200, 0.004
HALF_NS = round(EXPOSURE_S / 2 * NS)
BOOT_NS = 1_700_000_000 * NS  # when the steady clock was 0


class Clock:
    """Passes where the camera waits, and where a test says so; `late_ns` is added to each wait."""

    def __init__(self, late_ns=0):
        self.now_ns, self.set_ns, self.late_ns = 0, BOOT_NS, late_ns

    def monotonic_ns(self):
        return self.now_ns

    def time_ns(self):
        return self.set_ns + self.now_ns

    def wait(self, stop, seconds):
        self.now_ns += round(seconds * NS) + self.late_ns
        return stop.is_set()


def film(count, slow=None, clock=None):
    """Return the stamps of `count` images, when each was delivered, and the camera.

    slow: of some images by index, how long they take to make, in periods.
    """
    clock = clock or Clock()
    stamps, delivered, done = [], [], threading.Event()

    def expose(index, stamp_ns):
        stamps.append(stamp_ns)
        clock.now_ns += round((slow or {}).get(index, 0) * PERIOD_NS)

    def deliver():
        delivered.append(clock.time_ns())
        if len(delivered) == count:
            done.set()

    camera = VirtualCamera(RATE_HZ, EXPOSURE_S, expose, deliver, clock)
    assert done.wait(60)
    camera.close()
    return np.array(stamps[:count]), np.array(delivered[:count]), camera


def test_stamps_stand_on_the_grid():
    stamps, delivered, camera = film(30)
    assert (np.diff(stamps) == PERIOD_NS).all()
    assert (delivered - stamps == EXPOSURE_S / 2 * NS).all()  # the end of the exposure
    assert (camera.missed, camera.fault) == (0, None)


def test_slow_images_are_skipped_and_counted():
    stamps, delivered, camera = film(30, slow={4: 5.5, 11: 4.5})
    steps = np.diff(stamps) / PERIOD_NS
    assert (steps == np.round(steps)).all()
    assert np.flatnonzero(steps > 1).tolist() == [4, 11]
    assert camera.missed == (steps - 1).sum() == 5
    assert (delivered - stamps >= EXPOSURE_S / 2 * NS).all()


def test_who_has_the_stamps_of_images_knows_to_what_the_table_moved():
    moves, shown, clock, rate_hz = [], [], Clock(), 60.0

    def expose(index, stamp_ns):
        shown.append(stamp_ns)
        clock.now_ns += round({4: 3.5, 5: 2.5, 11: 1.2, 20: 9.0}.get(index, 0) * NS / rate_hz)

    camera = VirtualCamera(rate_hz, EXPOSURE_S, expose, lambda: None, clock, moves.append)
    wait_until(lambda: len(shown) > 30)
    camera.close()
    told = [shown[0]]
    for before_ns, stamp_ns in itertools.pairwise(shown):
        told += moved_to(shown[0], before_ns, stamp_ns, rate_hz)
    assert told == moves[: len(told)]
    assert camera.missed == 10 and len(told) > len(shown)


def test_a_machine_that_wakes_late_does_not_drift():
    late_ns = 300_000
    stamps, delivered, camera = film(30, clock=Clock(late_ns))
    assert (np.diff(stamps) == PERIOD_NS).all() and camera.missed == 0
    assert (delivered - stamps <= EXPOSURE_S / 2 * NS + late_ns).all()


def test_stamps_follow_the_system_clock_where_it_is_set():
    clock = Clock()

    def expose(index, stamp_ns):
        stamps.append(stamp_ns)
        if index == 9:
            clock.set_ns += 3600 * NS

    stamps = []
    camera = VirtualCamera(RATE_HZ, EXPOSURE_S, expose, lambda: None, clock)
    wait_until(lambda: len(stamps) > 20)
    camera.close()
    steps = np.diff(stamps[:20])
    # the table has moved to image 10 by then
    assert steps[10] == 3600 * NS + PERIOD_NS and (np.delete(steps, 10) == PERIOD_NS).all()


def test_what_an_image_shows_has_moved_before_the_one_before_is_made():
    calls, clock = [], Clock()
    camera = VirtualCamera(
        RATE_HZ, EXPOSURE_S,
        lambda index, stamp_ns: calls.append(('expose', stamp_ns, clock.time_ns())),
        lambda: calls.append(('deliver', 0, clock.time_ns())),
        clock,
        lambda stamp_ns: calls.append(('move', stamp_ns, clock.time_ns())),
    )  # fmt: skip
    wait_until(lambda: len(calls) > 60)
    camera.close()

    assert [name for name, _, _ in calls[:58]] == ['move', *['move', 'expose', 'deliver'] * 19]
    moved, exposed, delivered = calls[0:1] + calls[1:58:3], calls[2:58:3], calls[3:58:3]
    stamps = [stamp for _, stamp, _ in exposed]
    assert [stamp for _, stamp, _ in moved][:19] == stamps
    for stamp, at in zip(stamps, (at for _, _, at in moved[1:]), strict=False):
        assert at <= stamp + HALF_NS - SPARE_NS  # what follows an exposure is known ahead
    assert [at for _, _, at in delivered] == [stamp + HALF_NS for stamp in stamps]


def test_a_real_clock_is_kept():
    stamps, done = [], threading.Event()

    def expose(index, stamp_ns):
        stamps.append(stamp_ns)
        if index == 5:
            done.set()

    camera = VirtualCamera(RATE_HZ, EXPOSURE_S, expose, lambda: None)
    assert done.wait(60)
    camera.close()
    steps = np.diff(stamps) / PERIOD_NS
    assert np.abs(steps - np.round(steps)).max() < 0.21  # the system clock is slewed at most so


def test_a_fault_is_kept():
    def expose(index, stamp_ns):
        raise RuntimeError('lens cap')

    camera = VirtualCamera(RATE_HZ, EXPOSURE_S, expose, lambda: None)
    wait_until(lambda: camera.fault)
    assert str(camera.fault) == 'lens cap'
    camera.close()


def run_slowly(periods):
    """Return stamps and times of moves, in ns, stamps of images, and the camera."""
    moved, exposed, clock = [], [], Clock()

    def expose(index, stamp_ns):
        exposed.append(stamp_ns)
        clock.now_ns += round(periods[index % len(periods)] * PERIOD_NS)

    camera = VirtualCamera(
        RATE_HZ, EXPOSURE_S, expose, lambda: None, clock,
        lambda stamp_ns: moved.append((stamp_ns, clock.time_ns())),
    )  # fmt: skip
    wait_until(lambda: len(exposed) > 40)
    camera.close()
    return np.array(moved), np.array(exposed), camera


def test_an_image_that_takes_nearly_a_period_holds_up_nothing_that_moves():
    moved, _, camera = run_slowly([0.9])
    assert camera.missed == 0
    assert (moved[3:, 1] <= moved[2:-1, 0]).all()  # known before the exposure before it


def test_what_skipped_images_would_have_shown_is_moved_through_once():
    moved, exposed, camera = run_slowly([0.9, 3.2, 0.9, 0.9])
    assert camera.missed > 0
    assert (np.diff(moved[:, 0]) > 0).all()
    assert set(exposed) <= set(moved[:, 0])
