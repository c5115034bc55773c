# SPDX-License-Identifier: Apache-2.0
"""What the twin's blocks feel: their accelerometers' samples, through the firmware of a block."""

import numpy as np

from eol_ros.core.physics.twin.accelerometer import LIS3DH, Accelerometers, Sensing
from eol_ros.core.physics.twin.live import Trace
from eol_ros.core.serial_protocol import Detector as Wanted
from eol_ros.core.table import Table
from eol_ros.devices.board.block import FELT, LEARN, RESTS, TOLD, Detector
from eol_ros.devices.board.twin import Felt
from eol_ros.settings import TwinSettings

LEARNT = LEARN + 4096  # samples: what is at rest, and how loud the noise is
RIM_MOVES = 1e-3  # m/s or rad/s; below that it only settles
LIGHT_S = 1e-3  # from a sample to the LED: `make firmware` measures 0.4 ms, 0.6 at most
TRACE = 16  # samples of the solver from image to image, about one a millisecond at 60 images/s


class FeltBlocks:
    """Blocks that feel; time is that of the table, in s.

    Raises DeviceMissing where the firmware was not compiled.
    """

    def __init__(self, settings: TwinSettings, table: Table = Table(), sensing: Sensing = LIS3DH):
        self.sensors, cells = Accelerometers(settings, False, table, sensing), table.cells
        self.detectors = [Detector() for _ in range(cells)]
        for detector, samples in zip(self.detectors, self.sensors.at_rest(LEARNT), strict=True):
            detector.feed(samples)
        self._awake = np.zeros(cells, bool)  # has felt something, and is not at rest since
        self._moved_s = np.zeros(cells)  # when it was last not at rest
        self.lit: list[tuple[float, int]] = []  # in the last step: when which block felt a knock
        self._lit_s = np.zeros(cells)
        self._nominal_s = 1 / sensing.rate_hz  # the block knows no better
        self._wake_s = 1 / sensing.wake_hz

    def advance(
        self, begin_s: float, end_s: float, trace: Trace | None, rim_velocity: np.ndarray
    ) -> list[Felt]:
        """Return the taps reported between `begin_s` and `end_s`, in time of the table.

        rim_velocity: (3,) velocity of the rim at the end; hands that move the rim also tap it.
        """
        knocks = []
        self.lit = []
        rim_moves = bool(np.abs(rim_velocity).max() > RIM_MOVES)
        self.sensors.asleep |= self._sleepers(begin_s)
        for s in self.sensors.advance(begin_s, end_s, trace, rim_moves, self._awake):
            detector = self.detectors[s.block]
            if s.woken:
                detector.wake()
            for event in detector.feed(s.xy):
                ended_s = s.first_s + event.sample * s.period_s
                if event.what == FELT:
                    self._lit_s[s.block] = ended_s + LIGHT_S
                    self.lit.append((ended_s + LIGHT_S, s.block))
                if event.what != TOLD:
                    continue
                time_s = ended_s - event.age_samples * self._nominal_s
                if event.first:  # it began before the sensor looked
                    time_s -= self._wake_s / 2
                lit_s, told_s = float(self._lit_s[s.block]) - time_s, ended_s - time_s
                what = s.block, event.strength_mps2, lit_s, event.first, told_s
                knocks.append(Felt(round(time_s * 1e9), *what))
            moves = detector.state != RESTS
            if moves or self._awake[s.block]:
                self._moved_s[s.block] = end_s
            self._awake[s.block] = moves
        return sorted(knocks)

    def configure(self, wanted: Wanted) -> None:
        """Set what the detectors take for a knock; zero leaves it."""
        for detector in self.detectors:
            for name, value in vars(wanted).items():
                if value:
                    setattr(detector.running, name, value)

    def _sleepers(self, now_s: float) -> np.ndarray:
        """Return the blocks (cells,) that sleep after a long rest."""
        idle = (now_s - self._moved_s) / self._nominal_s
        return ~self._awake & ~self.sensors.woken & (idle > self.detectors[0].config.idle)
