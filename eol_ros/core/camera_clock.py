# SPDX-License-Identifier: Apache-2.0
"""A camera's own clock carried over to the host's, with the error of that.

Where the camera can be asked for its time, each question is a ping of `ClockSync`, and the error is
half of the quickest round trip. Where it cannot, the arrivals of its images are all there is: the
quickest of each quarter of a second say how the clocks run, and jitter goes; but a delay that all
images share cannot be known from one end, so the error is the longest that it may be.
"""

from eol_ros.core.clock_sync import WRAP_US, ClockSync, HostTime

TICK_S = 1e-6  # to which stamps are rounded
GATHER_S = 0.25


class CameraClock:
    """Turns a camera's nanoseconds into the host's seconds.

    delay_s: the longest that an image may take from its stamp to its arrival, less what is known of
    it; counts where the camera's clock cannot be read.
    """

    def __init__(self, delay_s: float) -> None:
        self.readable = False
        self._delay_s = delay_s
        self._sync = ClockSync()
        self._quickest: tuple[float, int, float] | None = None  # lag, device us, arrival
        self._floor_s: float | None = None
        self._since_s = 0.0

    @property
    def ready(self) -> bool:
        """True as soon as a stamp can be turned."""
        return self._sync.ready

    def exchange(self, sent_s: float, device_ns: int, received_s: float) -> None:
        """Take in that the camera's clock showed `device_ns` between two moments of the host."""
        self.readable = True
        self._sync.add(sent_s, device_ns // 1000 % WRAP_US, received_s)

    def arrival(self, device_ns: int, arrived_s: float) -> None:
        """Take in an image stamped `device_ns`; of no use where the clock can be read."""
        if self.readable:
            return
        lag_s = arrived_s - device_ns * 1e-9
        if self._quickest is None or lag_s < self._quickest[0]:
            self._quickest = (lag_s, device_ns // 1000 % WRAP_US, arrived_s)
        if self.ready and arrived_s - self._since_s < GATHER_S:
            return
        lag_s, device_us, arrived_s = self._quickest
        if self._floor_s is None or abs(lag_s - self._floor_s) > 1.0:  # a clock that jumped
            self._floor_s = lag_s
        excess_s = max(lag_s - self._floor_s, 0.0)
        # The floor follows a clock that runs slower; one that runs faster moves it at once.
        self._floor_s = min(lag_s, self._floor_s + 1e-4 * (arrived_s - self._since_s))
        self._sync.add(arrived_s - 2 * excess_s, device_us, arrived_s)
        self._quickest, self._since_s = None, arrived_s

    def to_host(self, device_ns: int) -> HostTime:
        """Return the host's time at `device_ns`; ValueError before anything is known."""
        found = self._sync.to_host(device_ns // 1000 % WRAP_US)
        known_s = found.sigma_s if self.readable else self._delay_s
        return HostTime(found.time_s + (device_ns % 1000) * 1e-9, known_s + TICK_S)
