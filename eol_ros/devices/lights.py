# SPDX-License-Identifier: Apache-2.0
"""The light of the blocks: flash envelopes written straight to the board, real or the twin's."""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.light.flash import FlashField
from eol_ros.devices.board import Board, State, TapReport
from eol_ros.errors import ConfigError
from eol_ros.settings import LedsSettings


class Sent(NamedTuple):
    """One packet that went out: its number, its levels, infrared, cause and time of writing."""

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


class Lights:
    """Slips in, packets out. `on_tap` and `on_state` are called from the board's thread.

    All methods return the packet that they sent, or None while there is no board to send to.
    """

    def __init__(
        self,
        settings: LedsSettings,
        on_tap: Callable[[Tap], None] = lambda tap: None,
        on_state: Callable[[State], None] = lambda state: None,
    ):
        s = settings
        if not s.flash_limit and not s.flash_limit_off_because.strip():
            raise ConfigError(
                'leds.flash_limit: false needs a written reason in leds.flash_limit_off_because'
            )
        self.field = FlashField(s.decay_s, s.peak, s.flash_limit)
        self.asleep = False
        self.twin: Any = None
        self._on_tap = on_tap
        self._stamp_ns = 0
        self._twin_sigma_s = 0.0
        if s.port == 'twin':
            from eol_ros.devices.twin_board import TwinBoard

            self.twin = TwinBoard(s.board_log)
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

    def slip(self, block: int, stamp_ns: int) -> Sent | None:
        """Light `block` now, for a slip seen in the image of `stamp_ns`; not while asleep."""
        if self.asleep:
            return None
        self._stamp_ns = stamp_ns
        self.field.slip(time.monotonic(), block)
        return self._show(stamp_ns // 1000)

    def frame(self) -> Sent | None:
        """Send the light as it is now; such a packet carries no stamp."""
        return self._show(0)

    def test(self) -> Sent | None:
        """Light all blocks once, for the people who set up."""
        for block in range(N_BLOCKS):
            self.field.slip(time.monotonic(), block)
        return self._show(0)

    def infrared(self, mask: int) -> Sent | None:
        """Switch the infrared LEDs: bit b is that of block b."""
        return self._sent(self.board.infrared(mask), self.field.level_bytes(time.monotonic()))

    def truth(self, stamp_ns: int, moving: Sequence[bool]) -> None:
        """Let the twin's board feel which of the twin's blocks move."""
        self._twin_sigma_s = self.twin.feel(stamp_ns, moving)

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
            'lengthened': self.field.lengthened,
        }
        if board.round_trip_ms:
            values['round_trip_ms'] = round(min(board.round_trip_ms), 2)
        return values | (self.twin.late_ms() if self.twin else {})

    def _show(self, stamp_us: int) -> Sent | None:
        white = self.field.level_bytes(time.monotonic())
        return self._sent(self.board.show(white, stamp_us), white)

    def _sent(self, sequence: int | None, white: bytes) -> Sent | None:
        if sequence is None:
            return None
        return Sent(sequence, white, self.board.infrared_on, self._stamp_ns, time.time_ns())

    def _tap(self, tap: TapReport) -> None:
        ago_ns = time.monotonic_ns() - round(tap.time.time_s * 1e9)
        sigma_s = (tap.time.sigma_s**2 + self._twin_sigma_s**2) ** 0.5
        stamp_ns = time.time_ns() - ago_ns
        self._on_tap(Tap(stamp_ns, tap.block, tap.strength, tap.board_us, sigma_s))
