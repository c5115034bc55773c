# SPDX-License-Identifier: Apache-2.0
"""The clock of a camera that is not there: exposures at absolute deadlines, late ones counted."""

import threading
import time
from collections.abc import Callable

from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.rounds import Rounds

NS = 1_000_000_000
SPARE_NS = 2_000_000


class SystemClock:
    """The clocks of this machine, and waiting that ends early where `stop` is set."""

    monotonic_ns = staticmethod(time.monotonic_ns)
    time_ns = staticmethod(time.time_ns)

    def wait(self, stop: threading.Event, seconds: float) -> bool:
        return stop.wait(seconds)


class VirtualCamera:
    """Calls `expose(index, stamp_ns)` for each image and `deliver()` when its exposure ends.

    Exposure i is centred on start + i * period, so the rate never drifts, and `stamp_ns` is that
    instant in system time. The image is made just ahead, when the readers of the one before it have
    had the processor, and delivered when the exposure ends, as a global shutter does. When
    making takes too long, whole images are skipped and counted in `missed`. `move(stamp_ns)` to the
    next exposure is called before an image is made, so that what happens after its middle is known
    before it happens, however long making takes: `expose` is for the moment to which a call before
    the last one has moved. All calls come from one thread of this object; what they raise is kept
    in `fault`.
    """

    def __init__(
        self,
        rate_hz: float,
        exposure_s: float,
        expose: Callable[[int, int], None],
        deliver: Callable[[], None],
        clock: SystemClock | None = None,
        move: Callable[[int], None] = lambda stamp_ns: None,
    ) -> None:
        self.missed = 0
        self.fault: BaseException | None = None
        self._rate_hz, self._half_ns = rate_hz, int(0.5 * exposure_s * NS)
        self._expose, self._deliver, self._move = expose, deliver, move
        self._clock = clock or SystemClock()
        self._stop = threading.Event()
        self.rounds = Rounds()
        self._thread = carrier_thread('camera', self._run)
        self._thread.start()

    def close(self) -> None:
        """Stop and wait for the thread."""
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        try:
            self._loop()
        except Exception as error:
            self.fault = error
        self.rounds.rest()

    def _wait_until(self, at_ns: int) -> bool:
        left_ns = at_ns - self._clock.monotonic_ns()
        with self.rounds.waiting():
            return left_ns > 0 and self._clock.wait(self._stop, left_ns / NS)

    def _loop(self) -> None:
        clock, period_ns = self._clock, NS / self._rate_hz
        start_ns = clock.monotonic_ns() + int(period_ns)
        making_ns = int(period_ns)  # the longest of late: how far ahead an image must be begun
        to_system_ns = clock.time_ns() - clock.monotonic_ns()
        index, image = 0, 0

        def exposure(image: int) -> tuple[int, int]:
            """Return the middle of an exposure in monotonic and in system time."""
            nonlocal to_system_ns
            offset_ns = clock.time_ns() - clock.monotonic_ns()
            if abs(offset_ns - to_system_ns) > NS // 1000:  # somebody set the system clock
                to_system_ns = offset_ns
            middle_ns = start_ns + round(image * period_ns)
            return middle_ns, middle_ns + to_system_ns

        middle_ns, stamp_ns = exposure(0)
        self._move(stamp_ns)
        while not self._stop.is_set():
            end_ns = middle_ns + self._half_ns
            if self._wait_until(end_ns - min(2 * making_ns + SPARE_NS, int(period_ns))):
                return
            began_ns = clock.monotonic_ns()
            middle_ns, next_ns = exposure(image + 1)
            self._move(next_ns)
            self._expose(index, stamp_ns)
            index += 1
            image += 1
            behind = int((clock.monotonic_ns() - start_ns) / period_ns) - image
            if behind > 0:
                self.missed += behind
                image += behind
                middle_ns, next_ns = exposure(image)
                self._move(next_ns)
            stamp_ns = next_ns
            making_ns = max(clock.monotonic_ns() - began_ns, making_ns * 15 // 16)
            if self._wait_until(end_ns):
                return
            self._deliver()
