# SPDX-License-Identifier: Apache-2.0
"""The light of the blocks: what they flash by themselves, and what the host adds to it.

Blocks light themselves, the host names those whose slip only the camera saw, and the board limits
the flashes, so that a restart of the host does not break the limit. The levels here are a copy of
this light, for viewers and bags.

Levels are a function of the slips' stamps (core/light/frames.py), so that a replay shows the same
light again. But behind a replay a real board is in front of real eyes, while recorded time may run
four times as fast, stand still or begin again: there a slip counts from its arrival, on the wall
clock, and the limit of flashes holds in that.
"""

import heapq
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from eol_ros.core import serial_protocol as protocol
from eol_ros.core.light.frames import FELT_NS, Frames
from eol_ros.core.light.local import (
    BLOCK_FALLS,
    FIELD,
    FIELD_OF_VIEW,
    OFF,
    block_falls,
    new_field,
)
from eol_ros.core.light.looks import LOOKS, REST_S, Look, idle, spread, stressed
from eol_ros.core.stamp_watch import StampWatch
from eol_ros.core.table import Table
from eol_ros.devices.board.board import Board, State, TapReport
from eol_ros.errors import ConfigError
from eol_ros.said import said
from eol_ros.settings import LedsSettings
from eol_ros.streams.graph import NAMESPACE

TOLD_NS = 80_000_000  # frames wait this long for earlier taps and slips
PLAYED_NS = 400_000_000  # in a replay, which is as late as the recorder was
MOST_TAPS = 256  # between two looks at them
LOW_MV = 3000  # of a lithium cell, whose protection lets go soon after
SET_S = 0.02  # the system clock departs from steady time by more only where somebody sets it
FADE_STEP = 1 / 32  # of the peak
FRAME_HZ = 100.0  # rate at which light levels are sent while a block is lit
LOOK_S = 0.1  # period of the look for idle light behind a replay
FOREIGN_NS = 1_000_000_000  # a stamp so old, or of the future, is of another clock


DEFAULT_LATTICE = protocol.Lattice(5, BLOCK_FALLS, 25)  # what a bridge begins with


class Sent(NamedTuple):
    """Levels that went out: the number of the packet, infrared, cause and time of writing.

    `stamp_ns` is the stamp of the image with the slip, or of the tap, 0 while light fades. Light
    that blocks and board make themselves has the number of the last packet and its own time.
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


class _Cause(NamedTuple):
    """Why blocks were lit: a stamp, and when the packet that said so was written."""

    stamp_ns: int
    sent_ns: int


class Played(NamedTuple):
    """How recorded time, which stamps are of behind a replay, maps to system time and back, ns.

    `stretch` returns how many times longer than in the run all takes, where the replay is slower.
    """

    wall_ns: Callable[[int], int]
    recorded_ns: Callable[[int], int]
    stretch: Callable[[], float]


def check_settings(settings: LedsSettings) -> None:
    """Raise ConfigError when the limit of flashes is switched off without a reason."""
    if settings.flash_limit == OFF and not settings.flash_limit_off_because.strip():
        raise ConfigError(
            'leds.flash_limit: false needs a written reason in leds.flash_limit_off_because'
        )


def faults(blocks: Mapping[int, protocol.BlockStatus]) -> list[str]:
    """Return what is wrong with single blocks, by their last status; a sentence each.

    Where the bridge hears nobody because of its own radio, that is said, and not of each block.
    """
    found: list[str] = []
    bridge = blocks.get(protocol.BRIDGE)
    mute = bridge is not None and bool(bridge.flags & protocol.RADIO_DEAD)
    if mute:
        found.append(said('radio_dead'))
    for number, block in sorted(blocks.items()):
        name = said('the_bridge') if number == protocol.BRIDGE else said('one_block', number=number)
        if not block.flags & protocol.LINKED and not mute:
            found.append(said('block_mute', part=name))
        if block.flags & protocol.TWICE:
            found.append(said('block_twice', number=number))
        if block.flags & protocol.SENSOR_DEAD:
            found.append(said('sensor_dead', part=name))
        version = block.major, block.minor
        if block.flags & protocol.LINKED and version < protocol.FIRMWARE:
            found.append(said('firmware_old', part=name, version=_dotted(version), newest=NEWEST))
        if 0 < block.millivolts <= LOW_MV:
            found.append(said('battery_low', part=name, volts=f'{block.millivolts / 1000:.1f}'))
    return found


def _dotted(version: tuple[int, int]) -> str:
    return '.'.join(map(str, version))


NEWEST = _dotted(protocol.FIRMWARE)


class Lights:
    """Slips in, packets out. `on_tap` and `on_state` are called from the board's thread.

    `played` is given behind a replay. `stress` returns that of each place, NaN where unknown. The
    methods that send return what they sent, nothing while there is no board to send to.
    """

    def __init__(
        self,
        settings: LedsSettings,
        on_tap: Callable[[Tap], None] = lambda tap: None,
        on_state: Callable[[State], None] = lambda state: None,
        played: Played | None = None,
        namespace: str = NAMESPACE,
        table: Table = Table(),
        stress: Callable[[], np.ndarray] | None = None,
    ):
        s = settings
        check_settings(s)
        self._settings, self._played, self.table = settings, played, table
        self._ids = frozenset(table.ids.tolist())
        self._stress = stress
        self._lattice = protocol.Lattice(table.columns, block_falls(table), table.cells)
        self._asleep, self._awake = False, 1.0  # 0: it has fallen asleep
        self._peak_share = 1.0  # that new flashes have; asleep it stays the last one
        self._turned_s, self._turned_from = 0.0, 1.0  # when it last turned, and `_awake` then
        self.frames = self._new_frames()
        self._clock = StampWatch(SET_S, SET_S)
        self.twin: Any = None
        self._on_tap = on_tap
        self._white = bytes(table.cells)
        self._sequence = 0  # of the last packet with light
        self._felt_ns = [0] * table.cells  # when each block last felt a knock
        self._shone: OrderedDict[tuple[int, int], int] = OrderedDict()  # knock: when it shone
        self._shone_ns = [0] * table.cells  # when each last lit itself
        self._lit_ns = [0] * table.cells  # when each block was last lit, as far as that is known
        # heap: when light runs to which block, and to which share of the peak
        self._running: list[tuple[int, int, float]] = []
        self._still_ns = 0  # when the last slip or idle light began; 0: not known
        self._twin_sigma_s = 0.0  # of the time of a knock
        if s.port == 'twin':
            from eol_ros.devices.board.twin import SIGMA_S, TwinBoard

            self.twin, self._twin_sigma_s = TwinBoard(s.board_log, namespace, table), SIGMA_S
        line = self.twin.fake.open_line if self.twin else None
        port = self.twin.port if self.twin else s.port
        self.board = Board(port, self._tap, on_state, line=line)
        self._configure()

    def start(self) -> None:
        """Begin to look for the board."""
        self.board.start()

    @property
    def asleep(self) -> bool:
        """Whether it sleeps, or falls asleep over `sleep_fade_s`."""
        return self._asleep

    @asleep.setter
    def asleep(self, asleep: bool) -> None:
        self._turn(asleep, at_once=not self.board.ready)  # nobody sees it

    @property
    def dark(self) -> bool:
        """Whether it has fallen asleep: nothing lights up any more."""
        return self._awake == 0

    def _turn(self, asleep: bool, at_once: bool) -> None:
        self._asleep = asleep
        self._turned_s = time.monotonic_ns() * 1e-9
        self._turned_from = float(not asleep) if at_once else self._awake
        self._running.clear()
        self._still_ns = 0
        self._fade()

    def _faded(self) -> float:
        """Return what `_awake` is to be by now."""
        fade_s = self._settings.sleep_fade_s
        far = (time.monotonic_ns() * 1e-9 - self._turned_s) / fade_s if fade_s else 1.0
        return min(max(self._turned_from + (-far if self._asleep else far), 0.0), 1.0)

    def _fade(self) -> None:
        """Dim new flashes on the way into sleep, or out of it, in steps that nobody sees."""
        awake = self._faded()
        if abs(awake - self._awake) >= (FADE_STEP if 0 < awake < 1 else 1e-9):
            self._awake = awake
            if self.dark:
                self._running.clear()  # of slips during the fade
            self._dim(awake or self._peak_share)

    def _dim(self, peak_share: float) -> None:
        self._peak_share = peak_share
        self.frames.field.peak = self._peak
        self._configure()

    @property
    def _peak(self) -> float:
        """Of new flashes. Once dark, that of the last ones, whose frames may still be to come."""
        return self._settings.peak * self._peak_share

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
        fades = self._awake != float(not self._asleep)
        return fades or self.frames.glows or bool(self._running)

    @property
    def idle_in_s(self) -> float | None:
        """After how long `frame` is to be called for idle light to begin, s; None: none is due.

        Behind a replay, whose rate may change, at most LOOK_S.
        """
        now_ns = self._recorded_ns(self._now_ns())
        due_ns = self._idle_due_ns(now_ns)
        if due_ns is None:
            return None
        wait_s = max((due_ns - now_ns) * 1e-9, 0.0)
        return wait_s if self._played is None else min(wait_s, LOOK_S)

    def restart(self) -> None:
        """Time has jumped back: begin in the dark again. A real board's light goes on to fade."""
        self._turn(asleep=False, at_once=True)
        self._felt_ns, self._lit_ns = [0] * self.table.cells, [0] * self.table.cells
        if self.by_stamp:
            self.frames = self._new_frames()

    def set(self, settings: LedsSettings) -> None:
        """Take new settings while running. A fade goes on from where it is."""
        self._turned_from, self._turned_s = self._faded(), time.monotonic_ns() * 1e-9
        self._settings = settings
        self.frames.field.decay_s, self.frames.field.peak = self._decay_s, self._peak
        self._configure()

    @property
    def _decay_s(self) -> float:
        """As the board has it."""
        return max(self._look.decay_s, self.frames.field.SHORTEST_S)

    @property
    def _look(self) -> Look:
        s = self._settings
        return LOOKS.get(s.look) or Look(
            s.decay_s,
            s.spread_blocks,
            s.spread_delay_s,
            s.afterglow_s,
            s.spread_share,
            s.idle_period_s,
        )

    def slip(self, block: int, stamp_ns: int, onset_ns: int, ahead_ns: int = 0) -> float | None:
        """Light `block` for a slip seen in the image of `stamp_ns`, unless it has felt it; not
        while asleep.

        ahead_ns: how far the clock here, which the taps have, is ahead of that of stamp and onset.
        Returns how long after its onset it was lit, by itself or here, s; None where it was not.
        """
        trigger, here_ns = self._settings.trigger, stamp_ns + ahead_ns
        onset_ns += ahead_ns
        self._still_ns = max(self._at_ns(here_ns), self._still_ns)
        felt = trigger == 'both' and onset_ns - FELT_NS < self._felt_ns[block] <= here_ns
        if not (self.dark or felt or trigger == 'blocks'):
            at_ns = self._at_ns(here_ns)
            began_ns = None if trigger == 'slips' else onset_ns + at_ns - here_ns
            sent_ns = self._light(stamp_ns, block, at_ns=at_ns, onset_ns=began_ns)
            self._run_on(block, at_ns)
            return (sent_ns - onset_ns) * 1e-9 if sent_ns else None
        shone_ns = self._shone_ns[block] if felt and not self.dark else 0
        return (shone_ns - onset_ns) * 1e-9 if shone_ns > onset_ns - FELT_NS else None

    def tap(self, block: int, stamp_ns: int, board_us: int) -> None:
        """Count the light of a block that felt a knock; give it where it does not do so itself."""
        if self.dark or self._settings.trigger == 'slips':
            return
        self._felt_ns[block] = stamp_ns
        if self._played is not None:  # recorded taps: no block lights itself
            self._light(stamp_ns, block)
            self._run_on(block, self._at_ns(stamp_ns))
        elif (shone_ns := self._shone.pop((block, board_us), None)) is not None:
            self._shone_ns[block] = shone_ns
            self.frames.lit(self._at_ns(stamp_ns), _Cause(stamp_ns, shone_ns), block)
            self._run_on(block, self._at_ns(stamp_ns))

    def frame(self) -> list[Sent]:
        """Send the light as it is by now; such a packet carries no stamp."""
        self._fade()
        now_ns = self._now_ns()
        self._run(self._recorded_ns(now_ns))
        until_ns = self._recorded_ns(now_ns - self._lag_ns)
        self.frames.field.decay_s = self._decay_s
        found = self.frames.due(until_ns)
        if found:
            self._white = found[-1][1]
        if not self.board.ready:
            return []
        wall_ns = self._played.wall_ns if self._played and self.by_stamp else None
        infrared, sent = self.board.infrared_on, []
        for at_ns, white, cause in found:
            cause = cause or _Cause(0, wall_ns(at_ns) if wall_ns else at_ns)
            sent.append(Sent(self._sequence, white, infrared, *cause))
        return sent

    @property
    def _lag_ns(self) -> int:
        """How long frames wait for earlier taps and slips."""
        if not self.by_stamp:
            return 0
        return TOLD_NS if self._played is None else round(PLAYED_NS * self._played.stretch())

    def _run_on(self, block: int, at_ns: int) -> None:
        """Let light run on from `block`, which was lit at `at_ns`."""
        self._lit_ns[block] = max(at_ns, self._lit_ns[block])
        for after_s, other, share in spread(block, self._look, self.table):
            heapq.heappush(self._running, (at_ns + round(after_s * 1e9), other, share))
        self._still_ns = max(at_ns, self._still_ns)

    def _recorded_ns(self, now_ns: int) -> int:
        """Return system time on the clock of the light: behind a replay mostly recorded time."""
        played = self._played if self.by_stamp else None
        return now_ns if played is None else played.recorded_ns(now_ns)

    def _idle_due_ns(self, now_ns: int) -> int | None:
        """Return when idle light is due; None where there is none."""
        if not (self._look.idle_s and now_ns) or self._asleep:
            return None
        self._still_ns = self._still_ns or now_ns
        return self._still_ns + round(max(self._look.idle_s, REST_S) * 1e9)

    def _run(self, now_ns: int) -> None:
        """Light the blocks that running light has come to by now."""
        due_ns = self._idle_due_ns(now_ns)
        if due_ns is not None and due_ns <= now_ns:
            self._still_ns = due_ns if now_ns - due_ns <= self._lag_ns else now_ns
            stress = self._stress() if self._settings.idle_by_stress and self._stress else None
            lit = idle(self._look, self.table) if stress is None else stressed(stress)
            for after_s, one, dim in lit:
                heapq.heappush(self._running, (self._still_ns + round(after_s * 1e9), one, dim))
        while self._running and self._running[0][0] <= now_ns:
            at_ns, block, share = heapq.heappop(self._running)
            dimmer = self._white[block] < 255 * share * self._peak  # as Frames.lit has it
            if dimmer and at_ns - self._lit_ns[block] >= REST_S * 1e9:
                self._lit_ns[block] = at_ns
                self._light(0, block, at_ns=at_ns, spread=share)

    def test(self, stamp_ns: int) -> None:
        """Light all blocks once, for the people who set up and asked for it at `stamp_ns`.

        In full where all is dark.
        """
        if self.dark:
            self._dim(1.0)
        self._light(0, *self.table.ids.tolist(), at_ns=self._at_ns(stamp_ns))

    def infrared(self, mask: int) -> list[Sent]:
        """Switch the infrared LEDs: bit b is that of block b."""
        sequence = self.board.infrared(mask)
        if sequence is None:
            return []
        return [Sent(sequence, self._white, self.board.infrared_on, 0, time.time_ns())]

    def values(self) -> dict[str, Any]:
        """Return counters for the health report."""
        board = self.board
        values: dict[str, Any] = {
            'protocol': board.version,
            'sent': board.sent,
            'dropped': board.dropped,
            'taps': board.taps,
            'connections': board.connections,
            'damaged': board.decoder.bad + board.reported_bad,
            'rejected_reports': board.rejected,
            'flash_limit': limit
            if (limit := self._limit) != OFF
            else f'off: {self._settings.flash_limit_off_because}',
            'lengthened': self.frames.field.lengthened,
            'late_slips': self.frames.late,
            'sleep_fade_s': self._settings.sleep_fade_s,  # of the walls, too
        }
        if board.round_trip_ms:
            values['round_trip_ms'] = round(min(board.round_trip_ms), 2)
        batteries = [b.millivolts for b in dict(board.blocks).values() if b.millivolts]
        if batteries:
            values['lowest_battery_v'] = min(batteries) / 1000
        return values | (self.twin.late_ms() if self.twin else {})

    def faults(self) -> list[str]:
        """Return what is wrong with board and blocks, a sentence each; the others go on."""
        count, cells = self.board.count, self.table.cells
        wrong = [said('board_count', count=count, all=cells)] if 0 < count < cells else []
        known = self._ids | {protocol.BRIDGE}
        return wrong + faults({n: b for n, b in dict(self.board.blocks).items() if n in known})

    def follow_firmware(self) -> None:
        """Change the limit when the bridge is found to know this table, or not to know it."""
        if self._bridge_knows_table() != self._configured_for_table:
            self._configure()

    def _bridge_knows_table(self) -> bool:
        """Whether the bridge can limit fields of view: old firmware takes any table for 5 x 5."""
        if self.twin is not None or self._lattice == DEFAULT_LATTICE:
            return True
        bridge = self.board.blocks.get(protocol.BRIDGE)
        return bridge is not None and (bridge.major, bridge.minor) >= protocol.FIRMWARE

    @property
    def _limit(self) -> str:
        """As the bridge has it: one that cannot limit fields of view limits the whole field."""
        limit = self._settings.flash_limit
        return FIELD if limit == FIELD_OF_VIEW and not self._configured_for_table else limit

    def _configure(self) -> None:
        s = self._settings
        self._configured_for_table = self._bridge_knows_table()
        flags = protocol.LIMITED * (s.flash_limit != OFF)
        flags |= protocol.EACH_FIELD * (self._limit == FIELD_OF_VIEW)
        if s.trigger != 'slips' and not self.dark and self._played is None:
            flags |= protocol.BY_ITSELF
        self.board.configure(
            *([self._lattice] if self._lattice != DEFAULT_LATTICE else []),
            protocol.Lighting(flags, round(255 * self._peak), round(1000 * self._look.decay_s)),
            protocol.Detector(threshold=round(16 * s.tap_threshold_mg)),
        )

    def _light(
        self,
        stamp_ns: int,
        *blocks: int,
        at_ns: int = 0,
        onset_ns: int | None = None,
        spread: float | None = None,
    ) -> int:
        """Light `blocks` now, for the image or tap of `stamp_ns`; where there is none, for `at_ns`.

        With `spread`: for light that has run there, to this share of the peak.
        Returns when the packet was sent, ns; 0 where the line is down or the board lacks them.
        """
        at_ns = at_ns or self._at_ns(stamp_ns)
        count = self.board.count or self.table.cells  # 0: not known, and no line to send on
        blocks = tuple(block for block in blocks if block < count)
        mask = sum(1 << block for block in blocks)
        share = 1.0 if spread is None else spread
        wall_ns = self._played.wall_ns(stamp_ns) if self._played and stamp_ns else stamp_ns
        sequence = self.board.light(mask, wall_ns // 1000, share) if blocks else None
        if sequence is None:
            return 0
        self._sequence, sent_ns = sequence, time.time_ns()
        cause = _Cause(stamp_ns, sent_ns)
        self.frames.lit(at_ns, cause, *blocks, onset_ns=onset_ns, spread=spread)
        return sent_ns

    def _now_ns(self) -> int:
        """Return system time. Where it was set, the light goes on as if it had not been."""
        before_ns, now_ns, steady_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if steady_ns - before_ns > 1e9 * SET_S / 4:  # held up between the clocks: no pair of them
            return now_ns
        jump_ns = self._clock.take(now_ns, steady_ns)
        if jump_ns and (self._played is None or not self.by_stamp):
            self.frames.shift(jump_ns)
            self._running.clear()
            self._still_ns = 0
            self._lit_ns = [at_ns + jump_ns for at_ns in self._lit_ns]
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
        field = new_field(s.flash_limit, self._look.decay_s, self._peak, self.table)
        return Frames(field, FRAME_HZ)

    def _tap(self, tap: TapReport) -> None:
        if tap.block not in self._ids:
            self.board.rejected += 1
            return
        ago_ns = time.monotonic_ns() - round(tap.time.time_s * 1e9)
        sigma_s = (tap.time.sigma_s**2 + self._twin_sigma_s**2) ** 0.5
        stamp_ns = time.time_ns() - ago_ns
        if tap.lit_s is not None:
            self._shone[tap.block, tap.board_us] = stamp_ns + round(tap.lit_s * 1e9)
            if len(self._shone) > MOST_TAPS:  # nobody asks for them
                self._shone.popitem(last=False)
        self._on_tap(Tap(stamp_ns, tap.block, tap.strength, tap.board_us, sigma_s))
