# SPDX-License-Identifier: Apache-2.0
"""The virtual camera keeps absolute deadlines, counts what it skips, hides no fault."""

import itertools
import threading

import numpy as np
from support.exposures import moved_to
from support.waiting import wait_until

from eol_ros.devices.camera.exposure_clock import NS, SPARE_NS, VirtualCamera

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


class Film:
    """The first `count` images of a virtual camera: their stamps, deliveries and moves.

    slow: how long an image takes to make, in periods, by its index. `on_expose` is called with the
    index of each. Moves and deliveries are (stamp, when), in ns of system time.
    """

    def __init__(
        self, count=30, slow=lambda index: 0, clock=None, on_expose=lambda index: None,
        rate_hz=RATE_HZ,
    ):  # fmt: skip
        self.clock, self.calls = clock or Clock(), []

        def expose(index, stamp_ns):
            self.calls.append(('expose', stamp_ns, self.clock.time_ns()))
            on_expose(index)
            self.clock.now_ns += round(slow(index) * NS / rate_hz)

        self.camera = VirtualCamera(
            rate_hz, EXPOSURE_S, expose,
            lambda: self.calls.append(('deliver', 0, self.clock.time_ns())), self.clock,
            lambda stamp_ns: self.calls.append(('move', stamp_ns, self.clock.time_ns())),
        )  # fmt: skip
        wait_until(lambda: len(self.of('deliver')) >= count)
        self.camera.close()
        self.stamps = np.array([stamp for stamp, _ in self.of('expose')][:count])
        self.delivered = np.array([at for _, at in self.of('deliver')][:count])
        self.moved = np.array(self.of('move'))

    def of(self, kind):
        return [call[1:] for call in list(self.calls) if call[0] == kind]


def test_stamps_stand_on_the_grid():
    film = Film()
    assert (np.diff(film.stamps) == PERIOD_NS).all()
    assert (film.delivered - film.stamps == HALF_NS).all()  # the end of the exposure
    assert (film.camera.missed, film.camera.fault) == (0, None)


def test_slow_images_are_skipped_and_counted():
    film = Film(slow=lambda index: {4: 5.5, 11: 4.5}.get(index, 0))
    steps = np.diff(film.stamps) / PERIOD_NS
    assert (steps == np.round(steps)).all()
    assert np.flatnonzero(steps > 1).tolist() == [4, 11]
    assert film.camera.missed == (steps - 1).sum() == 5
    assert (film.delivered - film.stamps >= HALF_NS).all()


def test_who_has_the_stamps_of_images_knows_to_what_the_table_moved():
    slow = {4: 3.5, 5: 2.5, 11: 1.2, 20: 9.0}
    film = Film(slow=lambda index: slow.get(index, 0), rate_hz=60.0)
    told = [film.stamps[0]]
    for before_ns, stamp_ns in itertools.pairwise(film.stamps):
        told += moved_to(film.stamps[0], before_ns, stamp_ns, 60.0)
    assert told == film.moved[: len(told), 0].tolist()
    assert film.camera.missed == 10 and len(told) > len(film.stamps)


def test_stamps_follow_the_system_clock_where_it_is_set():
    clock = Clock()

    def set_clock(index):
        clock.set_ns += 3600 * NS * (index == 9)

    steps = np.diff(Film(20, clock=clock, on_expose=set_clock).stamps)
    # the table has moved to image 10 by then
    assert steps[10] == 3600 * NS + PERIOD_NS and (np.delete(steps, 10) == PERIOD_NS).all()


def test_what_an_image_shows_has_moved_before_the_one_before_is_made():
    film = Film(20)
    names = [name for name, _, _ in film.calls[:58]]
    assert names == ['move', *['move', 'expose', 'deliver'] * 19]
    assert film.moved[:20, 0].tolist() == film.stamps.tolist()
    # what follows an exposure is known ahead
    assert (film.moved[1:21, 1] <= film.stamps + HALF_NS - SPARE_NS).all()
    assert (film.delivered == film.stamps + HALF_NS).all()


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
