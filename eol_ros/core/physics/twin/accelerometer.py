# SPDX-License-Identifier: Apache-2.0
"""What the accelerometer in each of the twin's blocks writes: samples as an LIS3DH makes them.

A sample is the mean of the acceleration since the sample before, as the sensor's own filter (half
its rate wide) gives it: the difference of two velocities, which the event solver knows to
rounding. Between the solver's samples velocity is the parabola with their values and their
displacement, and it is parted where the block itself breaks loose or comes to rest.

To this comes what a rigid block on a rigid platform would not feel. Stopping: grit is elastic, so
a block that is held rings with what decelerated it. The platform: what a block's friction gains or
loses goes into it, and other blocks feel that by the ratio of the masses, ringing; those beside it
also feel the springs, by the ratio of the stiffnesses. Hands that knock the rim, at random times
while it moves, and footsteps. And noise, offset, resolution, range, and a clock of its own.

Where nothing but noise would be felt nothing is sampled: at rest the threshold of the firmware is
more than 10 standard deviations away, which noise passes less than once in 1e11 years.
"""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.twin.live import Trace
from eol_ros.core.table import Table
from eol_ros.settings import TwinSettings

MG = 9.80665e-3  # m/s^2
STEP_MG = 4.0  # resolution at +-2 g: normal mode, 10 bit
LEAST, MOST = -32768, 32704  # of 10 bits, left-justified in 16
# Modes that ring: the platform, a block on its grit, a floor that somebody walks on.
PLATFORM, GRIT, FLOOR = range(3)
PLATFORM_DAMPING, GRIT_DAMPING, FLOOR_DAMPING = 0.05, 0.1, 0.1  # of the critical: guesses
FLOOR_HZ, STEPS_HZ = 12.0, 1.0  # a museum's floor; two visitors who walk now and then
HAND_SPREAD, FOOT_SPREAD = 0.7, 0.4  # of the logarithm of how hard they knock: guesses
REACH_M = 0.35  # where a knock on the rim has half its strength
RUB_MPS = 0.1  # the speed that the noise of sliding is stated for
FELT_MG = 6.0  # what a block at rest is sampled for; less cannot reach the threshold with noise
SILENT_MG = 0.05  # where all rings less, nothing does
NEAR_S = 5e-4  # acceleration before and after an event is taken over at least this


class Sensing(NamedTuple):
    """The sensors (LIS3DH in normal mode, ST DocID17530 rev 2, tables 4 and 31), and what they feel
    besides their block. What is marked with ? is a guess.
    """

    rate_hz: float = 1344.0
    noise_ug: float = 220.0  # density, for the square root of 1 Hz
    offset_mg: float = 40.0  # standard deviation of the zero-g level
    clock: float = 0.02  # ? relative standard deviation of the rate
    wake_hz: float = 100.0  # rate while a block sleeps
    wake_mg: float = 32.0  # wakes a block, in steps of 16 mg (INT1_THS at 2 g)
    platform_kg: float = 40.0  # 140 x 140 x 3 cm of plywood
    platform_hz: float = 60.0  # ? its resonance
    grit_hz: float = 250.0  # ? at which a block that has stopped rings on the grit
    rub_mg: float = 20.0  # ? RMS of a block that slides at RUB_MPS
    rim_hits_per_min: float = 2.0  # ? of hands, while they move the rim
    rim_hit_mg: float = 10.0  # median: 0.1 N s, a tenth of it by the casters, on 40 kg at 60 Hz
    footstep_mg: float = 2.0  # ? median; STEPS_HZ of them


LIS3DH = Sensing()


class Samples(NamedTuple):
    """Of one block: (n, 2) counts of 1/16 mg, when the first ended, s, from one to the next, s, and
    whether the first is that after a sleep.
    """

    block: int
    xy: np.ndarray
    first_s: float
    period_s: float
    woken: bool


class Accelerometers:
    """The sensors of the blocks. Time is that of the table, in s, and must not fall.

    `asleep` (cells,) may be set for a block at rest: it then looks `wake_hz` times a second,
    coarsely, until it sees `wake_mg`. `always` samples all blocks, even at rest.
    """

    def __init__(
        self,
        settings: TwinSettings,
        always: bool = False,
        table: Table = Table(),
        sensing: Sensing = LIS3DH,
    ) -> None:
        s, cells = sensing, table.cells
        self.sensing, self._table = sensing, table
        self._random = random = np.random.default_rng([settings.seed, 0x616363])
        self.always = always
        self.asleep = np.zeros(cells, bool)
        self.woken = np.zeros(cells, bool)  # and has not been sampled since
        rate = s.rate_hz * (1 + random.normal(0, s.clock, cells))
        self.period_s = 1 / rate
        self._next_s = random.uniform(0, self.period_s)  # when the next sample ends
        self._last_v = np.zeros((cells, 2))
        self._offset_mg = random.normal(0, s.offset_mg, (cells, 2))
        # white over half the rate
        self._noise_mg = 1e-3 * s.noise_ug * math.sqrt(s.rate_hz / 2)
        grit = 2 * np.pi * s.grit_hz
        self._rates = np.array([
            2 * np.pi * s.platform_hz * (1j - PLATFORM_DAMPING),
            grit * (1j - GRIT_DAMPING),
            2 * np.pi * FLOOR_HZ * (1j - FLOOR_DAMPING),
        ])  # fmt: skip
        # Struck, what was at rest is at rest again in the end: the integral of each is zero.
        self._strike = 1 + 1j * np.array([PLATFORM_DAMPING, GRIT_DAMPING, FLOOR_DAMPING])
        self._rings = np.zeros((cells, 3, 2), complex)  # of each mode, as it is now, m/s^2
        self._ringing = False
        self._rest = table.rest
        self._by_platform = settings.block_kg / s.platform_kg
        self._by_spring = settings.stiffness / (settings.block_kg * grit**2)
        between = table.springs[table.springs[:, 1] >= 0]
        self._beside = np.zeros((cells, cells), bool)
        self._beside[between, between[:, ::-1]] = True
        self._step_s = random.exponential(1 / STEPS_HZ)
        # of no block, for no time: compiles or loads the kernel before the clock runs
        self._still = _still(cells)
        self._sample(0.0, 0.0, None, self.asleep, *_never(cells))

    def at_rest(self, count: int) -> np.ndarray:
        """Return `count` samples of each block at rest, (cells, count, 2)."""
        noise = self._noise_mg * self._random.standard_normal((self._table.cells, count, 2))
        return _counts(self._offset_mg[:, None] + noise)

    def advance(
        self,
        begin_s: float,
        end_s: float,
        trace: Trace | None,
        rim_moves: bool,
        keep: np.ndarray,
    ) -> list[Samples]:
        """Return what the blocks that feel something write from `begin_s` to `end_s`.

        `keep` (cells,): blocks that are sampled whatever they feel, because they felt something.
        """
        when, mode, size = self._knocks(begin_s, end_s, trace, rim_moves)
        active = keep | (self.always & self._table.present)
        loud = np.zeros(self._table.cells)
        if trace is None and not self._ringing and not len(when) and not active.any():
            return []
        if trace is not None:
            active |= (trace.v != 0).any(axis=(0, 2))
            active[trace.event_block] = True
        if self._ringing:
            loud = np.abs(self._rings).sum(axis=(1, 2))
        if len(when):
            loud += np.abs(size).sum(axis=(0, 2))
        self._ringing = loud.max() > SILENT_MG * MG
        if not self._ringing:
            self._rings[:] = 0.0
        active |= (loud > FELT_MG * MG) & self._table.present
        if active.all():
            return self._sample(begin_s, end_s, trace, active, when, mode, size)
        self._pass(begin_s, end_s, active, when, mode, size)
        return self._sample(begin_s, end_s, trace, active, when, mode, size) if active.any() else []

    def _pass(
        self,
        begin_s: float,
        end_s: float,
        active: np.ndarray,
        when: np.ndarray,
        mode: np.ndarray,
        size: np.ndarray,
    ) -> None:
        """Let the time pass for those that are not sampled."""
        idle = ~active
        self._last_v[idle] = 0.0
        if self._ringing:
            self._rings[idle] *= np.exp(self._rates * (end_s - begin_s))[:, None]
            for t, m, one in zip(when, mode, size, strict=True):
                self._rings[idle, m] += one[idle] * np.exp(self._rates[m] * (end_s - begin_s - t))

    def _sample(
        self,
        begin_s: float,
        end_s: float,
        trace: Trace | None,
        active: np.ndarray,
        when: np.ndarray,
        mode: np.ndarray,
        size: np.ndarray,
    ) -> list[Samples]:
        s = self.sensing
        blocks = np.flatnonzero(active)
        # those that were passed over have gone on looking meanwhile
        late = np.maximum(np.ceil((begin_s - self._next_s[blocks]) / self.period_s[blocks]), 0)
        self._next_s[blocks] += late * self.period_s[blocks]
        capacity = int((end_s - begin_s) / self.period_s.min()) + 3
        noise = self._random.standard_normal((len(blocks), capacity, 4))
        out = np.zeros((len(blocks), capacity, 2))
        count, first_s = np.zeros(len(blocks), np.int64), np.zeros(len(blocks))
        _write(
            end_s - begin_s,
            trace or self._still,
            blocks,
            self._next_s,
            begin_s,
            self.period_s,
            self._last_v,
            self.asleep,
            1.0 / s.wake_hz,
            s.wake_mg,
            self._rings,
            self._rates,
            when,
            mode,
            size,
            self._noise_mg,
            s.rub_mg * MG / RUB_MPS / math.sqrt(2),
            noise,
            out,
            count,
            first_s,
            self.woken,
        )
        out = _counts(out + self._offset_mg[blocks, None])
        found = []
        for k, b in enumerate(blocks.tolist()):
            if count[k]:
                xy, start_s = out[k, : count[k]], begin_s + float(first_s[k])
                found.append(Samples(b, xy, start_s, float(self.period_s[b]), bool(self.woken[b])))
                self.woken[b] = False
        return found

    def _knocks(
        self, begin_s: float, end_s: float, trace: Trace | None, rim_moves: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return when after `begin_s`, in which mode and how hard all is struck, m/s^2."""
        s, random, cells = self.sensing, self._random, self._table.cells
        found = []
        if trace is not None and len(trace.event_t):
            for t, block, start in zip(
                trace.event_t, trace.event_block, trace.event_start, strict=True
            ):
                jump = _jump(trace, float(t), int(block), bool(start))
                size = np.tile(-self._by_platform * jump, (cells, 1))
                size[self._beside[block]] += self._by_spring * jump
                size[block] = 0.0
                found.append((float(t), PLATFORM, size))
                if not start:
                    own = np.zeros((cells, 2))
                    own[block] = -jump
                    found.append((float(t), GRIT, own))
        if rim_moves and s.rim_hits_per_min:
            span_s = end_s - begin_s
            for _ in range(random.poisson(s.rim_hits_per_min / 60 * span_s)):
                along, side = random.uniform(-0.5, 0.5), random.integers(4)
                length, away = self._table.rim_m()[:: 1 if side < 2 else -1]
                place = np.array([along * length, 0.5 * away]) * (1 if side % 2 else -1)
                far = np.hypot(*(self._rest - (place if side < 2 else place[::-1])).T)
                size = self._struck(s.rim_hit_mg, HAND_SPREAD) / (1 + far[:, None] / REACH_M)
                found.append((random.uniform(0, span_s), PLATFORM, size))
        while self._step_s < end_s:
            if s.footstep_mg and self._step_s >= begin_s:
                size = np.tile(self._struck(s.footstep_mg, FOOT_SPREAD), (cells, 1))
                found.append((self._step_s - begin_s, FLOOR, size))
            self._step_s += random.exponential(1 / STEPS_HZ)
        if not found:
            return _never(cells)
        found.sort(key=lambda knock: knock[0])
        modes = np.array([knock[1] for knock in found])
        sizes = np.array([knock[2] for knock in found]) * self._strike[modes, None, None]
        return np.array([knock[0] for knock in found]), modes, sizes

    def _struck(self, median_mg: float, spread: float) -> np.ndarray:
        """Return a knock of random strength and direction (2,), m/s^2."""
        way = self._random.uniform(0, 2 * np.pi)
        strength = median_mg * MG * math.exp(spread * self._random.standard_normal())
        return strength * np.array([math.cos(way), math.sin(way)])


def _never(cells: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros(0), np.zeros(0, np.int64), np.zeros((0, cells, 2), complex)


def _still(cells: int) -> Trace:
    return Trace(
        np.zeros(2), np.zeros((2, cells, 2)), np.zeros((2, cells, 2)),
        np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int8),
    )  # fmt: skip


def _counts(mg: np.ndarray) -> np.ndarray:
    """Return what the sensor writes for `mg`."""
    steps = np.rint(mg * (1 / STEP_MG)) * (16 * STEP_MG)
    return np.clip(steps, LEAST, MOST).astype(np.int16)


def _jump(trace: Trace, t: float, block: int, start: bool) -> np.ndarray:
    """Return by how much the acceleration (2,) of `block` changes in its event at `t`, m/s^2."""
    if start:
        row = min(int(np.searchsorted(trace.t, t + NEAR_S)), len(trace.t) - 1)
        since = trace.t[row] - t
    else:
        row = max(int(np.searchsorted(trace.t, t - NEAR_S)) - 1, 0)
        while row > 0 and not trace.v[row, block].any():  # the solver has finished the stop by then
            row -= 1
        since = t - trace.t[row]
    return trace.v[row, block] / max(since, NEAR_S)


@njit(cache=True, inner=True)
def _velocity(block, time, row, trace, own_t, own_start, events):
    """Return the velocity of a block at `time`, in cell `row` of the trace.

    The solver finishes a stop in closed form: from some time before the event on, the trace has the
    place where the block comes to rest, and no velocity. There it falls by a straight line.
    """
    last, following = -1, events
    for q in range(events):
        if own_t[q] <= time:
            last = q
        elif following == events:
            following = q
    slides = True
    if last >= 0:
        slides = own_start[last] != 0
    elif following < events:
        slides = own_start[following] == 0
    if not slides:
        return 0.0, 0.0
    r = row
    since = own_t[last] if last >= 0 else -1.0
    known = True  # the displacement at both ends
    if since >= trace.t[row]:
        ta, ax, ay = since, 0.0, 0.0
        known = last == 0 or own_t[last - 1] < trace.t[row]
    else:
        if following < events:
            while (
                r > 0
                and trace.v[r, block, 0] == 0.0
                and trace.v[r, block, 1] == 0.0
                and trace.t[r - 1] > since
            ):
                r -= 1
        ta, ax, ay = trace.t[r], trace.v[r, block, 0], trace.v[r, block, 1]
    tb, bx, by = trace.t[row + 1], trace.v[row + 1, block, 0], trace.v[row + 1, block, 1]
    if following < events and (own_t[following] <= tb or (bx == 0.0 and by == 0.0)):
        known = known and (following + 1 == events or own_t[following + 1] > tb)
        tb, bx, by = own_t[following], 0.0, 0.0
    h = tb - ta
    if h < 1e-9:
        return bx, by
    s = (time - ta) / h
    x, y = ax + (bx - ax) * s, ay + (by - ay) * s
    if known:
        bend = 6.0 * s * (1.0 - s)
        u, w = trace.u[r, block], trace.u[row + 1, block]
        x += bend * ((w[0] - u[0]) / h - 0.5 * (ax + bx))
        y += bend * ((w[1] - u[1]) / h - 0.5 * (ay + by))
    return x, y


@njit(cache=True, inner=True)
def _decay(ring, rates, span):
    """Let the modes of one block ring for `span`, s."""
    for m in range(len(rates)):
        factor = np.exp(rates[m] * span)
        ring[m, 0] *= factor
        ring[m, 1] *= factor


@njit(cache=True, inner=True)
def _strike_until(time, ring, rates, rung, struck, when, mode, size):
    """Strike a block that has rung until `rung` as often as `when`, `mode`, `size` (n, 2) say.

    Returns the time of the last strike, or `rung`, and the strikes so far.
    """
    while struck < len(when) and when[struck] <= time:
        _decay(ring, rates, when[struck] - rung)
        rung = when[struck]
        ring[mode[struck], 0] += size[struck, 0]
        ring[mode[struck], 1] += size[struck, 1]
        struck += 1
    return rung, struck


@njit(cache=True)
def _write(
    span, trace, blocks, next_s, begin_s, periods, last_v, asleep, wake_s, wake_mg, rings, rates,
    when, mode, size, noise_mg, rub, noise, out, count, first_s, woken,
):  # fmt: skip
    """Write the samples (mg, without offset) of `blocks`, and leave all as it is after them."""
    own_t, own_start = np.empty(64), np.empty(64, np.int8)
    for k in range(len(blocks)):
        b = blocks[k]
        events = 0
        for q in range(len(trace.event_t)):
            if trace.event_block[q] == b and events < len(own_t):
                at = events
                while at > 0 and own_t[at - 1] > trace.event_t[q]:
                    own_t[at], own_start[at] = own_t[at - 1], own_start[at - 1]
                    at -= 1
                own_t[at], own_start[at] = trace.event_t[q], trace.event_start[q]
                events += 1
        ring = rings[b]
        rung, struck, row, drawn = 0.0, 0, 0, 0
        before_x, before_y = last_v[b, 0], last_v[b, 1]
        time = next_s[b] - begin_s
        while time <= span:
            step = wake_s if asleep[b] else periods[b]
            while row + 2 < len(trace.t) and trace.t[row + 1] < time:
                row += 1
            x, y = _velocity(b, time, row, trace, own_t, own_start, events)
            # grit shakes a block as it slides, and does not carry it off: noise of the velocity
            shake = rub * math.sqrt(x * x + y * y) * step
            x += shake * noise[k, drawn, 2]
            y += shake * noise[k, drawn, 3]
            middle = time - 0.5 * periods[b]
            rung, struck = _strike_until(middle, ring, rates, rung, struck, when, mode, size[:, b])
            if middle > rung:
                _decay(ring, rates, middle - rung)
                rung = middle
            ringing_x = ring[0, 0].real + ring[1, 0].real + ring[2, 0].real
            ringing_y = ring[0, 1].real + ring[1, 1].real + ring[2, 1].real
            ax = ((x - before_x) / step + ringing_x) / 9.80665e-3
            ay = ((y - before_y) / step + ringing_y) / 9.80665e-3
            before_x, before_y = x, y
            ax += noise_mg * noise[k, drawn, 0]
            ay += noise_mg * noise[k, drawn, 1]
            drawn = min(drawn + 1, len(noise[k]) - 1)
            if asleep[b]:
                if max(abs(np.rint(ax / 16.0)), abs(np.rint(ay / 16.0))) * 16.0 >= wake_mg:
                    asleep[b] = False
                    woken[b] = True
                    time += periods[b]  # waking takes one sample
                else:
                    time += wake_s
                continue
            if count[k] < len(out[k]):
                if count[k] == 0:
                    first_s[k] = time
                out[k, count[k], 0], out[k, count[k], 1] = ax, ay
                count[k] += 1
            time += periods[b]
        next_s[b] = begin_s + time
        last_v[b, 0], last_v[b, 1] = before_x, before_y
        rung, struck = _strike_until(np.inf, ring, rates, rung, struck, when, mode, size[:, b])
        _decay(ring, rates, span - rung)
