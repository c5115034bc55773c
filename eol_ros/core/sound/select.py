# SPDX-License-Identifier: Apache-2.0
"""Which grain sounds when: blocks wander over the space and touch what lies within reach.

The rule, image by image. A block *moves* from the image in which its speed reaches `start_mps`
(and its step stands out from the noise of the measurement) until it has been slower than
`stop_mps` for `rest_s`. A moving block reaches the grains within `radius`: all of them, the
nearest, or the k nearest. In mode `fence` a grain that it reaches sounds if it is armed for this
block, and is then disarmed. It is armed again once the moving block is farther than `radius *
rearm_ratio`, or (`rearm_at_rest`) when the block comes to rest, so that the next slip sounds from
its first image on. In the other modes a moving block sounds one of the grains in its reach, from
its first image on: every `bow_period_s` (`bow`), in the first image after each beat (`beat`),
whenever the grain before has ended (`chain`), or then the one after it in the recording for as long
as this motion lasts (`continue`). No grain sounds twice within `refractory_s`, no block more than
`block_cap` times and all blocks no more than `total_cap` times in any second; what a cap holds back
is dropped, not saved.

If `paths` are drawn, a block plays at its place along them (`paths.py`).

Where `match` says so, the nearest are those most like the block in weighted descriptors, not in
place. Where `weights` says so, a block can play only a share of the grains of a sound: always the
same ones, other ones for each block.

Ambience: with `ambience_rate` set, blocks at rest under stress trigger quiet, slow grains that name
no block, at random times, more often under greater stress (`stress.py`). The rules above do not
apply to them.

`space_m` and `radius` are those of the default table: positions are scaled to it by the area
that the blocks of a table reach along x and y, so that every table covers the space alike. A block
beyond the space is taken to be at its edge.

Everything follows from the sequence of images alone: chance is a hash of seed, stamp, block and
grain.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core import elementary
from eol_ros.core.sound.corpus import Corpus, table_bounds
from eol_ros.core.sound.paths import along
from eol_ros.core.sound.ranks import rank_shares
from eol_ros.core.sound.sources import weights
from eol_ros.core.sound.stress import stress
from eol_ros.core.sound.triggers import MAX_RATE, MIN_RATE, TRIGGER
from eol_ros.core.stamp_watch import BACK_S
from eol_ros.core.table import Table
from eol_ros.settings import GrainsSettings

FORGET_S = 0.25  # a block unseen for longer starts again
LONGEST_LEAD_S = 60.0  # a switch farther ahead is left over from before the stamps began again
AMBIENCE_EDGE_S = 10.0  # longer than any grain: half is attack, half is release
FELT_S = 0.01  # a block's acceleration at its tap times this is the speed that its image shows
SLIP_S = 0.04  # a slip that is felt lasts longer: what may sound again so soon still belongs to it
NOTHING = np.zeros(0, TRIGGER)
NOISE_SIGMAS = 6.0  # a step below this many standard deviations of a step is not motion


class Selector:
    """Turns block positions into triggers; `settings` may be replaced between two images.

    Parameters
    ----------
    settings : GrainsSettings
        Reach, mode (fence, bow, beat, chain or continue), caps and envelopes.
    corpus : Corpus, optional
        The grains; without one nothing sounds.
    table : Table
        The table of the blocks.

    References
    ----------
    D. Schwarz, "Corpus-based concatenative synthesis", IEEE Signal Process. Mag. 24 (2007) 92.

    Examples
    --------
    A block passes the one grain, in the middle of the table.

    >>> from eol_ros.core.sound.corpus import GRAIN, Source
    >>> grains = np.zeros(1, GRAIN)
    >>> grains['x'], grains['y'], grains['duration_s'] = 0.5, 0.5, 0.25
    >>> settings = GrainsSettings(ambience_rate=0.0)
    >>> selector = Selector(settings, Corpus((Source('ice.wav', 48000, 1.0, ''),), grains))
    >>> x, y = Table().rest.T.copy()
    >>> found = []
    >>> for k in range(20):
    ...     x[12] = -0.1 + 0.01 * k
    ...     found += selector.update(k / 60, x, y, np.ones(25, bool), np.zeros(25)).tolist()
    >>> len(found)
    1
    """

    def __init__(
        self, settings: GrainsSettings, corpus: Corpus | None = None, table: Table = Table()
    ):
        self.settings, self.table = settings, table
        self._scale = _reach_m(table) / _reach_m(Table())
        self.capped = 0  # triggers that a cap has dropped since the start
        self._reset()
        self._swapped_s = -np.inf
        self._grains = np.zeros(0, np.int64)
        self._armed = np.ones((table.cells, 0), bool)
        self._sounded_s = np.zeros(0)
        self._next: tuple[float, Corpus] | None = None
        self._corpus: Corpus | None = None
        self._made: dict[str, tuple[Any, np.ndarray]] = {}  # see `_once`
        if corpus is not None:
            self._take(corpus)

    def _reset(self) -> None:
        n, self._time_s = self.table.cells, -np.inf
        self._at = np.full((n, 2), np.nan)
        self._seen_s = np.full(n, -np.inf)
        self._fast_s = np.full(n, -np.inf)
        self._bow_s = np.full(n, -np.inf)
        self._last = np.full(n, -1)  # column of the grain that each block sounded last
        self._last_s = np.full(n, -np.inf)  # and when
        self._since_s = np.full(n, -np.inf)  # when its motion began
        self.moving = np.zeros(n, bool)
        self.speed = np.zeros(n)
        self._felt: dict[tuple[int, int], float] = {}  # block, grain column: its last tap
        self._felt_second: list[deque[float]] = [deque() for _ in range(n)]
        self._second: deque[tuple[float, int]] = deque()
        self._in_second = [0] * n

    def load(self, corpus: Corpus, lead_s: float = 0.0) -> float:
        """Take another corpus; return the stamp from which on triggers name its grains.

        That is `lead_s` after the last image, so that the node sound can have it loaded by
        then; the first corpus is taken at once (-inf). From there its grains rise over
        `crossfade_s`.
        """
        if not len(self._grains) or not np.isfinite(self._time_s):
            self._take(corpus)
            return -np.inf
        self._next = (self._time_s + lead_s, corpus)
        return self._next[0]

    def _take(self, corpus: Corpus) -> None:
        self._next, self._corpus = None, corpus
        self._grains = np.nonzero(corpus.placed)[0]
        self._last[:] = -1
        self._last_s[:] = -np.inf
        self._made.clear()
        self._durations = corpus.grains['duration_s'][self._grains]
        self._sounded_s = np.full(len(self._grains), -np.inf)
        self._armed = np.ones((self.table.cells, len(self._grains)), bool)
        self._felt.clear()  # its keys are columns of the earlier corpus
        places = corpus.grains[self._grains]
        self._places = np.stack([places['x'], places['y']])
        if np.isfinite(self._time_s):
            self._swapped_s = self._time_s
            busy = np.nonzero(self.moving)[0]  # what they stand in was not touched by this motion
            self._armed[busy] = self._distances(self._at[busy] / self._scale) > self._leave_m

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Region of the table that the space covers: x min, y min, x max, y max in metres."""
        right, high = (self.settings.space_m / 2 * self._scale).tolist()
        return -right, -high, right, high

    @property
    def radius_m(self) -> float:
        """Radius of the circle on the table that has the area of a block's reach."""
        return self.settings.radius * math.sqrt(self._scale[0] * self._scale[1])

    def update(
        self, time_s: float, x: np.ndarray, y: np.ndarray, seen: np.ndarray, sigma_m: np.ndarray
    ) -> np.ndarray:
        """Take the blocks of one image.

        Parameters
        ----------
        time_s : float
            The stamp; one that is not later is left out, one far back begins again.
        x, y : ndarray
            (cells,) metres.
        seen : ndarray
            (cells,) bool.
        sigma_m : ndarray
            (cells,) standard deviation of x and y; NaN: unknown.

        Returns
        -------
        ndarray
            (n,) TRIGGER.

        Examples
        --------
        >>> still = np.zeros(25)
        >>> Selector(GrainsSettings()).update(0.0, still, still, still == 0, still).shape
        (0,)
        """
        if self._time_s - BACK_S <= time_s <= self._time_s:
            return NOTHING
        if time_s < self._time_s:  # a bag begins again, or the clock was set back
            self._reset()
            self._sounded_s[:] = self._swapped_s = -np.inf
            self._armed[:] = True
        before_s, self._time_s = self._time_s, time_s
        if self._next is not None and not time_s < self._next[0] <= time_s + LONGEST_LEAD_S:
            self._take(self._next[1])
        span_s = time_s - before_s
        stopped = self._follow(time_s, np.stack([x, y], axis=1), np.asarray(seen, bool), sigma_m)
        s = self.settings
        if s.rearm_at_rest:
            self._armed[stopped] = True
        while self._second and time_s - self._second[0][0] >= 1.0:
            self._in_second[self._second.popleft()[1]] -= 1
        if not len(self._grains):
            return NOTHING
        found = self._of_moving(time_s, before_s, np.nonzero(self.moving & seen)[0])
        if s.ambience_rate and span_s <= FORGET_S:
            found = np.concatenate([found, self._creaks(time_s, span_s)])
        return found

    def _of_moving(self, time_s: float, before_s: float, rows: np.ndarray) -> np.ndarray:
        """Return the triggers (n,) of the blocks `rows` (m,), which move; before_s: last image."""
        if not len(rows):
            return NOTHING
        s = self.settings
        at = self._at[rows] / self._scale
        far, reached = self._reached(rows, at, self.speed[rows], self._last[rows])
        if s.mode == 'fence':
            touched = self._fence(time_s, rows, far, reached)
        else:
            touched = self._sustain(time_s, before_s, rows, reached)
        blocks = [block for block, _ in touched]
        found = self._triggers(
            time_s, touched, self.speed[blocks], self._at[blocks, 0] / self._scale[0]
        )
        if s.match or s.mode == 'continue':
            for block, column in touched:
                self._last[block], self._last_s[block] = column, time_s
        return found

    def felt(
        self, time_s: float, block: int, x: float, y: float, strength_mps2: float
    ) -> np.ndarray:
        """Take a slip that its block felt, before an image shows it.

        Return its triggers (n,) TRIGGER. time_s: the stamp of the tap; x, y: where the block
        rested, in m. Where the rule is that each slip sounds at its start (`fence`,
        `rearm_at_rest`) the block sounds the grains that it reaches from there; `refractory_s` and
        `block_cap` hold for the taps of one block. A grain that may sound again within SLIP_S
        sounds then, as it would by the images of a block that goes on moving. Nothing of `update`
        changes, and nothing of it counts here: images and taps may come in any order.
        """
        s = self.settings
        if s.mode != 'fence' or not s.rearm_at_rest or not len(self._grains):
            return NOTHING
        if time_s < self._swapped_s or (self._next is not None and time_s >= self._next[0]):
            return NOTHING  # the corpus is another than that of the images
        speed = FELT_S * strength_mps2
        at = np.array([[x, y]]) / self._scale
        far, reached = self._reached(np.array([block]), at, np.array([speed]))
        column = np.nonzero(reached[0])[0]
        second, found, waits = self._felt_second[block], [], []
        while second and not 0.0 <= time_s - second[0] < 1.0:
            second.popleft()
        for j in column[np.argsort(far[0, column], kind='stable')].tolist():
            wait_s = max(self._felt.get((block, j), -np.inf) + s.refractory_s - time_s, 0.0)
            if wait_s > s.refractory_s + SLIP_S:  # its last sound is in the future: a clock was set
                wait_s = 0.0
            if wait_s > SLIP_S or len(second) >= s.block_cap:
                continue
            self._felt[block, j] = time_s + wait_s
            second.append(time_s)
            found.append((block, j))
            waits.append(wait_s)
        n = len(found)
        out = self._triggers(time_s, found, np.full(n, speed), np.full(n, at[0, 0]))
        out['time_s'] += waits
        return out

    def _follow(
        self, time_s: float, at: np.ndarray, seen: np.ndarray, sigma_m: np.ndarray
    ) -> np.ndarray:
        """Update speed and motion of every block; return which came to rest."""
        s = self.settings
        dt = time_s - self._seen_s
        known = seen & (dt <= FORGET_S) & np.isfinite(at).all(axis=1)
        step = elementary.hypot(*(at - self._at).T)
        with np.errstate(invalid='ignore', divide='ignore'):
            speed = np.where(known, step / dt, 0.0)
            noise_m = np.fmax(np.asarray(sigma_m, float), 0.0)  # NaN: unknown
            clear = step >= NOISE_SIGMAS * np.sqrt(2) * noise_m
        fast = known & np.where(self.moving, speed >= s.stop_mps, (speed >= s.start_mps) & clear)
        self._fast_s[fast] = time_s
        moving = fast | (self.moving & (time_s - self._fast_s < s.rest_s))
        stopped = self.moving & ~moving
        started = moving & ~self.moving
        self._bow_s[started] = time_s
        self._since_s[started] = time_s
        self.moving = moving
        self.speed = np.where(seen, speed, self.speed)
        self._at[seen] = at[seen]
        self._seen_s[seen] = time_s
        return stopped

    @property
    def _leave_m(self) -> float:
        return self.settings.radius * self.settings.rearm_ratio

    def _distances(self, at: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """Return the distances (n, grains) of grains from places (n, 2), in m on the default table.

        A place beyond the space counts as the nearest one in it. `paths`, if any, replace it by a
        place along them. The distance is infinite for grains that blocks `rows` (n,) cannot play.
        """
        left, low, right, high = table_bounds(self.settings.space_m)
        x = left + self._places[0] * (right - left)
        y = low + self._places[1] * (high - low)
        at = np.clip(at, (left, low), (right, high))
        if self.settings.paths:
            corner, side = np.array([left, low]), np.array([right - left, high - low])
            at = corner + side * along(self.settings.paths, (at - corner) / side)
        far = np.sqrt((x - at[:, :1]) ** 2 + (y - at[:, 1:]) ** 2)
        if rows is not None and self.settings.weights:
            far[self._absent()[rows]] = np.inf
        return far

    def _once(self, name: str, key: Any, make: Callable[[Corpus], np.ndarray]) -> np.ndarray:
        """Return `make(corpus)`, cached until the corpus or `key` changes."""
        if name not in self._made or self._made[name][0] != key:
            assert self._corpus is not None  # there are grains
            self._made[name] = key, make(self._corpus)
        return self._made[name][1]

    def _absent(self) -> np.ndarray:
        """Return which grains each block cannot play, (cells, grains)."""
        s = self.settings

        def make(corpus: Corpus) -> np.ndarray:
            sources = corpus.sources
            share = weights(s.weights, [x.name for x in sources], [x.folder for x in sources])
            u = chance(s.seed, 0.0, np.arange(self.table.cells)[:, None], self._grains, salt=8)
            return u >= share[corpus.grains['file'][self._grains]]

        return self._once('absent', (s.weights, s.seed), make)

    def _ranks(self) -> np.ndarray:
        """Return the rank of each grain in the descriptors to match, (grains, lines)."""

        def make(corpus: Corpus) -> np.ndarray:
            grains = corpus.grains[self._grains]
            return np.stack([rank_shares(grains[name]) for name in names], axis=1)

        names = [line.split()[0] for line in self.settings.match]
        return self._once('ranks', names, make)

    def _likeness(
        self, far: np.ndarray, at: np.ndarray, speed: np.ndarray, last: np.ndarray | None
    ) -> np.ndarray:
        """Return descriptor distances (n, grains), infinite where `far` (m) exceeds the radius.

        `last`: column of the grain that each block sounded last, -1 for none; None: not compared.
        """
        s, ranks = self.settings, self._ranks()
        half, total = s.space_m / 2, np.zeros(far.shape)
        for j, line in enumerate(s.match):
            _, weight, source = line.split()
            if source == 'last':
                if last is None:
                    continue
                target = np.where(last >= 0, ranks[last, j], np.nan)
            elif source == 'speed':
                target = np.clip(speed / s.full_mps, 0, 1)
            else:
                target = np.clip((at[:, 'xy'.index(source)] + half) / (2 * half), 0, 1)
            apart = (ranks[:, j] - target[:, None]) ** 2
            total += float(weight) * np.nan_to_num(apart)
        return np.where(far <= s.radius, total, np.inf)

    def _reached(
        self, rows: np.ndarray, at: np.ndarray, speed: np.ndarray, last: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return distances (n, grains), m, and which grains blocks `rows` (n,) at `at` reach.

        `choose` selects among the grains within the radius: the nearest in place, or with `match`
        the nearest in descriptors. Ties go to the lower number.
        """
        s, far = self.settings, self._distances(at, rows)
        near = far <= s.radius
        count = {'all': 0, 'nearest': 1, 'k': s.k}[s.choose]
        if 0 < count < far.shape[1]:
            like = self._likeness(far, at, speed, last) if s.match else far
            first = np.argsort(like, axis=1, kind='stable')[:, :count]
            among = np.zeros_like(near)
            np.put_along_axis(among, first, True, axis=1)
            near &= among
        return far, near

    def _fence(
        self, time_s: float, rows: np.ndarray, far: np.ndarray, reached: np.ndarray
    ) -> list[tuple[int, int]]:
        """Return (distance, block, grain column) of every grain that is newly touched."""
        self._armed[rows] |= far > self._leave_m
        row, column = np.nonzero(reached & self._armed[rows])
        order = np.lexsort((column, rows[row], far[row, column]))
        found = []
        for i, j in zip(row[order].tolist(), column[order].tolist(), strict=True):
            block = int(rows[i])
            if time_s - self._sounded_s[j] < self.settings.refractory_s:
                continue
            self._armed[block, j] = False
            if self._allowed(time_s, block):
                self._sounded_s[j] = time_s
                found.append((block, j))
        return found

    def _sustain(
        self, time_s: float, before_s: float, rows: np.ndarray, reached: np.ndarray
    ) -> list[tuple[int, int]]:
        """Return (block, grain column) of every moving block whose time has come."""
        s = self.settings
        if s.mode == 'beat' and time_s // s.beat_period_s == before_s // s.beat_period_s:
            return []
        ready = time_s - self._sounded_s >= s.refractory_s
        found = []
        for i, block in enumerate(rows.tolist()):
            if s.mode != 'beat' and time_s < self._bow_s[block]:
                continue
            u = chance(s.seed, time_s, block, 0, salt=np.arange(2))
            j = self._follower(block) if s.mode == 'continue' else -1
            if j < 0 or not ready[j]:
                choice = np.nonzero(reached[i] & ready)[0]
                if not len(choice):
                    continue
                j = int(choice[int(u[1] * len(choice))])
            if s.mode == 'bow':
                lasts_s = s.bow_period_s * (1 + s.bow_jitter * (2 * u[0] - 1))
            else:
                lasts_s = self._durations[j] / s.playback_rate
            self._bow_s[block] = time_s + lasts_s
            if self._allowed(time_s, block):
                self._sounded_s[j] = time_s
                ready[j] = s.refractory_s <= 0
                found.append((block, j))
        return found

    def _follower(self, block: int) -> int:
        """Return the column of the grain that follows the block's last in its sound; -1: none."""
        if self._last[block] < 0 or self._last_s[block] < self._since_s[block]:
            return -1  # of another motion

        def make(corpus: Corpus) -> np.ndarray:
            of = corpus.grains[self._grains]
            order = np.lexsort((of['start_s'], of['file']))
            same = of['file'][order][1:] == of['file'][order][:-1]
            successor = np.full(len(order), -1)
            successor[order[:-1][same]] = order[1:][same]
            return successor

        follower = int(self._once('successor', None, make)[self._last[block]])
        return -1 if self.settings.weights and self._absent()[block, follower] else follower

    def _allowed(self, time_s: float, block: int) -> bool:
        """Count a trigger against the caps of the last second; False if it must be dropped."""
        s = self.settings
        if len(self._second) >= s.total_cap or self._in_second[block] >= s.block_cap:
            self.capped += 1
            return False
        self._second.append((time_s, block))
        self._in_second[block] += 1
        return True

    def _triggers(
        self, time_s: float, found: list[tuple[int, int]], speed: np.ndarray, x: np.ndarray
    ) -> np.ndarray:
        """Return the triggers of (block, grain column), of blocks with `speed`, m/s.

        x: as `_distances` takes it.
        """
        s = self.settings
        out = np.zeros(len(found), TRIGGER)
        if not found:
            return out
        block, column = np.array(found).T
        grain = self._grains[column]
        u = 2 * chance(s.seed, time_s, block[:, None], grain[:, None], np.arange(2, 5)) - 1
        rate = s.playback_rate * elementary.exp2(s.rate_jitter_st * u[:, 0] / 12)
        loud = elementary.power(np.clip(speed / s.full_mps, 0, 1), s.gain_curve)
        rise = np.clip((time_s - self._swapped_s) / s.crossfade_s, 0, 1) if s.crossfade_s else 1.0
        out['time_s'], out['grain'], out['block'] = time_s, grain, block
        out['gain'] = s.gain * np.maximum(loud, s.gain_floor) * elementary.sin(np.pi / 2 * rise)
        out['rate'] = np.clip(rate, MIN_RATE, MAX_RATE)
        half = self.settings.space_m / 2
        out['pan'] = np.clip(s.pan_width * x / half, -1, 1)
        attack = s.attack_s * (1 + s.edge_jitter * u[:, 1])
        release = s.release_s * (1 + s.edge_jitter * u[:, 2])
        room = self._durations[column] / out['rate']
        if s.envelope == 'hann':
            attack = release = room
        elif s.envelope == 'percussive':
            release = np.maximum(room - attack, 0.0)
        elif s.envelope == 'swell':
            attack = np.maximum(room - release, 0.0)
        squeeze = np.minimum(1, room / np.maximum(attack + release, 1e-9))
        out['attack_s'], out['release_s'] = attack * squeeze, release * squeeze
        return out

    def _creaks(self, time_s: float, span_s: float) -> np.ndarray:
        """Return what blocks at rest under stress sound in the `span_s` up to now."""
        s = self.settings
        strain = np.minimum(stress(self._at, s.ambience_break_m, self.table), 1.0)
        u = chance(s.seed, time_s, np.arange(self.table.cells)[:, None], 0, salt=np.arange(5, 8))
        likely = 1 - elementary.exp(-s.ambience_rate * span_s * np.nan_to_num(strain) ** 2)
        rows = np.nonzero(~self.moving & (u[:, 0] < likely))[0]
        if not len(rows):
            return NOTHING
        at = self._at[rows] / self._scale
        far = self._distances(at, rows)
        there = np.isfinite(far).any(axis=1)
        at, far, rows = at[there], far[there], rows[there]
        out = np.zeros(len(rows), TRIGGER)
        out['time_s'], out['block'] = time_s, -1
        out['grain'] = self._grains[np.argmin(far, axis=1)]
        out['gain'] = s.ambience_gain * strain[rows] * (0.5 + 0.5 * u[rows, 1])
        out['rate'] = np.clip(
            s.ambience_playback_rate * elementary.exp2(2 * u[rows, 2] - 1), MIN_RATE, MAX_RATE
        )
        out['pan'] = np.clip(s.pan_width * at[:, 0] / (s.space_m / 2), -1, 1)
        out['attack_s'] = out['release_s'] = AMBIENCE_EDGE_S
        return out


def _reach_m(table: Table) -> np.ndarray:
    """Return width and depth (m) of the area that blocks reach while their rim moves."""
    return np.array(table.platform_m) - 2 * (table.rim_width_m + np.array(table.gaps_m))


def chance(
    seed: int, time_s: float, block: ArrayLike, grain: ArrayLike, salt: ArrayLike
) -> np.ndarray:
    """Return numbers 0 <= u < 1 that depend on nothing but the arguments (broadcast together).

    splitmix64 (Steele, Lea, Flood 2014, "Fast splittable pseudorandom number generators", fig. 19).
    """
    with np.errstate(over='ignore'):
        z = np.full((1,), seed, np.uint64)
        for word in (np.float64(time_s).view(np.uint64), block, grain, salt):
            z = z + np.asarray(word).astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
            z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * 2.0**-53
