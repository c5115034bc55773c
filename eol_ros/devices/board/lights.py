# SPDX-License-Identifier: Apache-2.0
"""The light of the blocks: flash envelopes written straight to the board, real or the twin's.

Levels are a function of the slips' stamps (core/light/frames.py), so that a replay shows the same
light again. But behind a replay a real board is in front of real eyes, while recorded time may run
four times as fast, stand still or begin again: there a slip counts from its arrival, on the wall
clock, and the limit of three flashes a second holds in that.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.light.flash import FlashField
from eol_ros.core.light.frames import Frames
from eol_ros.core.stamp_watch import StampWatch
from eol_ros.devices.board.board import Board, State, TapReport
from eol_ros.errors import ConfigError
from eol_ros.settings import LedsSettings
from eol_ros.streams.graph import NAMESPACE

LAG_NS = 40_000_000  # frames wait so long for the slips before them: 4 times what p99 takes
SET_S = 0.02  # the system clock departs from steady time by more only where somebody sets it
FOREIGN_NS = 1_000_000_000  # a stamp so old, or of the future, is of another clock


class Sent(NamedTuple):
    """Levels that went out: the number of the packet, infrared, cause and time of writing.

    `stamp_ns` is that of the image with the slip, 0 for what fades. Of levels that fall due
    together only the last are written; the others name the packet that overtook them.
    """

    sequence: int
    white: bytes
    infrared: bool
    stamp_ns: int
    sent_ns: int


class Tap(NamedTuple):
    """A knock that a block felt, on the system's clock."""

    stamp_ns: int
    block: int
    strength: float
    board_us: int
    sigma_s: float


class Played(NamedTuple):
    """How recorded time, which stamps are of behind a replay, maps to system time and back, ns.

    `stretch` returns how many times longer than in the run all takes, where the replay is slower.
    """

    wall_ns: Callable[[int], int]
    recorded_ns: Callable[[int], int]
    stretch: Callable[[], float]


def check_settings(settings: LedsSettings) -> None:
    """Raise ConfigError when the limit of flashes is switched off without a reason."""
    if not settings.flash_limit and not settings.flash_limit_off_because.strip():
        raise ConfigError(
            'leds.flash_limit: false needs a written reason in leds.flash_limit_off_because'
        )


class Lights:
    """Slips in, packets out. `on_tap` and `on_state` are called from the board's thread.

    `played` is given behind a replay. The methods that send return what they sent, nothing while
    there is no board to send to.
    """

    def __init__(
        self,
        settings: LedsSettings,
        on_tap: Callable[[Tap], None] = lambda tap: None,
        on_state: Callable[[State], None] = lambda state: None,
        played: Played | None = None,
        namespace: str = NAMESPACE,
    ):
        s = settings
        check_settings(s)
        self._settings, self._played = settings, played
        self.frames = self._new_frames()
        self._clock = StampWatch(SET_S, SET_S)
        self.asleep = False
        self.twin: Any = None
        self._on_tap = on_tap
        self._white = bytes(N_BLOCKS)
        self._twin_sigma_s = 0.0
        if s.port == 'twin':
            from eol_ros.devices.board.twin import TwinBoard

            self.twin = TwinBoard(s.board_log, namespace)
        self.limit = 'on' if s.flash_limit else f'off: {s.flash_limit_off_because}'
        self.board = Board(self.twin.port if self.twin else s.port, self._tap, on_state, s.baud)

    def start(self) -> None:
        """Begin to look for the board."""
        self.board.start()

    def close(self) -> None:
        """Let all go dark."""
        self.board.close()
        if self.twin:
            self.twin.close()

    @property
    def by_stamp(self) -> bool:
        """Whether light is a function of stamps, and not of when they came."""
        return self._played is None or self.twin is not None

    @property
    def glows(self) -> bool:
        """Whether frames are to come."""
        return self.frames.glows

    def restart(self) -> None:
        """Time has jumped back: begin in the dark again. A real board's light goes on to fade."""
        self.asleep = False
        if self.by_stamp:
            self.frames = self._new_frames()

    def set(self, decay_s: float, peak: float) -> None:
        """Take new settings while running."""
        self._settings = replace(self._settings, decay_s=decay_s, peak=peak)
        self.frames.field.decay_s, self.frames.field.peak = decay_s, peak

    def slip(self, block: int, stamp_ns: int) -> list[Sent]:
        """Light `block` now, for a slip seen in the image of `stamp_ns`; not while asleep."""
        if self.asleep:
            return []
        return self._show(self.frames.slip(self._at_ns(stamp_ns), block), stamp_ns)

    def frame(self) -> list[Sent]:
        """Send the light as it is by now; such a packet carries no stamp."""
        until_ns = self._now_ns()
        if self.by_stamp:
            if self._played is None:
                until_ns -= LAG_NS
            else:
                lag_ns = round(LAG_NS * self._played.stretch())
                until_ns = self._played.recorded_ns(until_ns - lag_ns)
        levels = self.frames.until(until_ns)
        return self._show(levels) if levels else []

    def test(self, stamp_ns: int) -> list[Sent]:
        """Light all blocks once, for the people who set up and asked for it at `stamp_ns`."""
        return self._show(self.frames.slip(self._at_ns(stamp_ns), *range(N_BLOCKS)))

    def infrared(self, mask: int) -> list[Sent]:
        """Switch the infrared LEDs: bit b is that of block b."""
        return self._sent(self.board.infrared(mask), [self._white])

    def truth(self, stamp_ns: int, moving: Sequence[bool]) -> None:
        """The twin has moved on: let its board hear what the blocks felt meanwhile."""
        self._twin_sigma_s = self.twin.listen()

    def values(self) -> dict[str, Any]:
        """Return counters for the health report."""
        board = self.board
        values = {
            'sent': board.sent,
            'dropped': board.dropped,
            'taps': board.taps,
            'connections': board.connections,
            'damaged': board.decoder.bad + board.reported_bad,
            'flash_limit': self.limit,
            'lengthened': self.frames.field.lengthened,
            'late_slips': self.frames.late,
        }
        if board.round_trip_ms:
            values['round_trip_ms'] = round(min(board.round_trip_ms), 2)
        return values | (self.twin.late_ms() if self.twin else {})

    def _now_ns(self) -> int:
        """Return system time. Where it was set, the light goes on as if it had not been."""
        before_ns, now_ns, steady_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if steady_ns - before_ns > 1e9 * SET_S / 4:  # held up between the clocks: no pair of them
            return now_ns
        jump_ns = self._clock.take(now_ns, steady_ns)
        if jump_ns and (self._played is None or not self.by_stamp):
            self.frames.shift(jump_ns)
        return now_ns

    def _at_ns(self, stamp_ns: int) -> int:
        """Return from when a slip of `stamp_ns` counts: its arrival where that is not of now."""
        now_ns = self._now_ns()
        if not self.by_stamp or not stamp_ns:
            return now_ns
        ours = self._played is not None or 0 <= now_ns - stamp_ns < FOREIGN_NS
        return stamp_ns if ours else now_ns

    def _new_frames(self) -> Frames:
        s = self._settings
        return Frames(FlashField(s.decay_s, s.peak, s.flash_limit), s.frame_hz)

    def _show(self, levels: Sequence[bytes], stamp_ns: int = 0) -> list[Sent]:
        """Write the last of `levels`, for the image of `stamp_ns` or for none; tell of all."""
        self._white = levels[-1]
        played_ns = self._played.wall_ns(stamp_ns) if self._played and stamp_ns else stamp_ns
        return self._sent(self.board.show(self._white, played_ns // 1000), levels, stamp_ns)

    def _sent(self, sequence: int | None, levels: Sequence[bytes], stamp_ns: int = 0) -> list[Sent]:
        if sequence is None:
            return []
        sent_ns, infrared = time.time_ns(), self.board.infrared_on
        stamps = [0] * (len(levels) - 1) + [stamp_ns]
        return [
            Sent(sequence, white, infrared, stamp, sent_ns)
            for white, stamp in zip(levels, stamps, strict=True)
        ]

    def _tap(self, tap: TapReport) -> None:
        ago_ns = time.monotonic_ns() - round(tap.time.time_s * 1e9)
        sigma_s = (tap.time.sigma_s**2 + self._twin_sigma_s**2) ** 0.5
        stamp_ns = time.time_ns() - ago_ns
        self._on_tap(Tap(stamp_ns, tap.block, tap.strength, tap.board_us, sigma_s))
