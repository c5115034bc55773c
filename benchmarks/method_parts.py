# SPDX-License-Identifier: Apache-2.0
"""Error against run time of one method, and some of the curves of `eol bench methods`.

The automaton against exact fractions, grains against loops, the mixer against a formula.
"""

import ctypes
import dataclasses
import math
import subprocess
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from support.automaton_rule import by_the_rule
from support.paper import rest_lattice

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.sound.select import FORGET_S, Selector
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.errors import DeviceMissing
from eol_ros.lab.automaton.ofc import Automaton
from eol_ros.settings import GrainsSettings


@dataclasses.dataclass
class Curve:
    """Error against run time of one method.

    Args:
        method, reference: what is measured, against what.
        unit: of the errors; `per` what a time in ms is of.
        points: (label, ms, error) of ours, of several realisations with the deviation of one;
            `peers` of others.
        n: realisations.
        default: the label of what runs.
        limit: what is known of the best that can be.
        breaks: where it does not hold.
        every: show all points in the table, not only the default.
    """

    method: str
    reference: str
    unit: str
    per: str
    default: str
    limit: str
    breaks: str
    points: list[tuple] = dataclasses.field(default_factory=list)
    peers: list[tuple] = dataclasses.field(default_factory=list)
    n: int = 1
    every: bool = False


def milliseconds(work: Callable[[], Any], repeat: int = 5) -> float:
    """Return the least processor time of `work`, in ms."""
    best = float('inf')
    for _ in range(repeat):
        begin = time.process_time()
        work()
        best = min(best, time.process_time() - begin)
    return best * 1e3


def rms(values: Any) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))


class Rescan:
    """The automaton in C, in double precision, which reads the whole lattice again and again."""

    def __init__(self) -> None:
        """Compile it; raises DeviceMissing without a C compiler."""
        source = Path(__file__).with_name('ofc_rescan.c')
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / 'ofc_rescan.so'
            command = ['cc', '-shared', '-fPIC', '-O3', '-march=native', '-o', library, source]
            try:
                subprocess.run(command, check=True, capture_output=True)
            except (OSError, subprocess.CalledProcessError) as error:
                raise DeviceMissing(f'the automaton in C needs a compiler (cc): {error}') from None
            self._run = ctypes.CDLL(str(library)).rescan
        self._run.restype = ctypes.c_int64

    def run(
        self, stress: np.ndarray, alpha: float, count: int
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Return size and first site of `count` events, and how many topplings; takes a copy."""
        sites = np.ascontiguousarray(stress, float).copy()
        size, first = np.zeros(count, np.int64), np.zeros(count, np.int64)
        there = (ctypes.c_void_p(a.ctypes.data) for a in (size, first))
        all_ = self._run(
            ctypes.c_void_p(sites.ctypes.data), ctypes.c_int64(len(sites)), ctypes.c_double(alpha),
            ctypes.c_int64(count), *there,
        )  # fmt: skip
        return size, first, int(all_)


def automaton(count: int = 1500) -> Curve:
    """The lattice at alpha 0.20 and 0.25: events that are not those of exact arithmetic."""
    curve = Curve(
        'automaton', 'exact fractions, event by event', '% of events that differ',
        '1000 topplings', 'L 128, 0.20', 'exact: 0',
        'exact ties between sites: the last bit decides',
    )  # fmt: skip
    baseline = Rescan()
    for alpha, sides in ((Fraction(1, 5), (16, 35, 128)), (Fraction(1, 4), (16, 35))):
        for side in sides:
            start = np.random.default_rng(side).integers(0, 10**9, (side, side))
            exact = by_the_rule(start, 10**9, alpha, count)
            stress = start / 10**9
            ours = Automaton(stress, float(alpha)).run(count, full=True)
            topplings = int(ours.size.sum())
            took = milliseconds(lambda s=stress, a=alpha: Automaton(s, float(a)).run(count), 3)
            label = f'L {side}, {float(alpha):.2f}'
            differ = (ours.size != exact[:, 0]) | (ours.first != exact[:, 3])
            curve.points.append((label, 1e3 * took / topplings, 100 * float(differ.mean())))
            size, first, topplings = baseline.run(stress, float(alpha), count)
            took = milliseconds(lambda s=stress, a=alpha: baseline.run(s, float(a), count), 2)
            differ = (size != exact[:, 0]) | (first != exact[:, 3])
            name = f'C, doubles, rescans, {label}'
            curve.peers.append((name, 1e3 * took / topplings, 100 * float(differ.mean())))
    return curve


def _walk(images: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (images, 25, 2) places of blocks that stick and slip, and who is seen."""
    random = np.random.default_rng(4)
    going = random.uniform(size=(images, 25)) < 0.5
    going = np.repeat(going[::20], 20, axis=0)[:images]
    way = random.normal(0.0, 0.004, (images, 25, 2)) * going[..., None]
    return rest_lattice() + np.cumsum(way, axis=0), random.uniform(size=(images, 25)) < 0.97


def _corpus(count: int) -> Corpus:
    grains = np.zeros(count, GRAIN)
    grains['x'], grains['y'] = np.random.default_rng(5).uniform(size=(2, count))
    grains['duration_s'] = 0.25
    return Corpus((Source('ice.wav', 48_000, 99.0, ''),), grains)


class Loops:
    """The rule of mode `fence`, block by block and grain by grain, with no array."""

    def __init__(self, settings: GrainsSettings, corpus: Corpus):
        self.s, half = settings, settings.space_m / 2
        self.grains = [
            (2 * half * float(g['x']) - half, 2 * half * float(g['y']) - half)
            for g in corpus.grains
        ]
        self.last: dict[int, tuple[float, float, float]] = {}
        self.fast: dict[int, float] = {}
        self.disarmed: set[tuple[int, int]] = set()
        self.sounded: dict[int, float] = {}
        self.history: list[tuple[float, int]] = []

    def image(self, t: float, at: list[Any], seen: list[bool]) -> list[tuple[int, int]]:
        """Return (block, grain) of what sounds."""
        s, touched = self.s, []
        for b in range(25):
            speed, known = 0.0, False
            if seen[b] and b in self.last and t - self.last[b][0] <= FORGET_S:
                then, x, y = self.last[b]
                speed, known = math.hypot(at[b][0] - x, at[b][1] - y) / (t - then), True
            if seen[b]:
                self.last[b] = (t, *at[b])
            was = b in self.fast
            if known and speed >= (s.stop_mps if was else s.start_mps):
                self.fast[b] = t
            elif was and t - self.fast[b] >= s.rest_s:
                del self.fast[b]
                if s.rearm_at_rest:
                    self.disarmed = {pair for pair in self.disarmed if pair[0] != b}
            if b not in self.fast or not seen[b]:
                continue
            for g, (x, y) in enumerate(self.grains):
                far = math.sqrt((x - at[b][0]) ** 2 + (y - at[b][1]) ** 2)
                if far > s.radius * s.rearm_ratio:
                    self.disarmed.discard((b, g))
                elif far <= s.radius and (b, g) not in self.disarmed:
                    touched.append((far, b, g))
        found = []
        for _, b, g in sorted(touched):
            if t - self.sounded.get(g, -math.inf) < s.refractory_s:
                continue
            self.disarmed.add((b, g))
            self.history = [row for row in self.history if t - row[0] < 1.0]
            mine = sum(block == b for _, block in self.history)
            if len(self.history) < s.total_cap and mine < s.block_cap:
                self.history.append((t, b))
                self.sounded[g] = t
                found.append((b, g))
        return found


def selection(images: int = 150) -> Curve:
    """Blocks that stick and slip over 128 to 8192 grains: triggers that loops do not find."""
    settings = GrainsSettings(mode='fence', choose='all', ambience_rate=0.0)
    places, seen = _walk(images)
    still = np.zeros(25)
    curve = Curve(
        'grain selection', 'the rule in plain loops',
        '% of triggers that differ', 'image', '2048 grains', 'exact: 0',
        'time grows with moving blocks times grains',
    )  # fmt: skip
    for count in (128, 512, 2048, 8192):
        corpus = _corpus(count)

        def ours(corpus: Corpus = corpus) -> list[list[tuple[int, int]]]:
            selector, found = Selector(settings, corpus), []
            for k in range(images):
                row = selector.update(k / 60, *places[k].T, seen[k], still)
                found.append(list(zip(row['block'].tolist(), row['grain'].tolist(), strict=True)))
            return found

        def loops(corpus: Corpus = corpus) -> list[list[tuple[int, int]]]:
            rule = Loops(settings, corpus)
            return [rule.image(k / 60, places[k].tolist(), seen[k].tolist()) for k in range(images)]

        mine, theirs = ours(), loops()
        several = max(1, sum(map(len, theirs)))
        differ = sum(len(set(a) ^ set(b)) for a, b in zip(mine, theirs, strict=True))
        took = milliseconds(ours, 2) / images
        curve.points.append((f'{count} grains', took, 100 * differ / several))
        if count == 2048:
            curve.peers.append((f'loops, {count} grains', milliseconds(loops, 1) / images, 0.0))
    return curve


def mixer() -> Curve:
    """A tone read 1.37 times as fast: what is beside the tone that it should be."""
    from scipy.interpolate import make_interp_spline
    from scipy.signal import resample_poly

    rate, pace, seconds, voices = 48_000, 1.37, 2, 64
    curve = Curve(
        'mixer, resampled', 'formula: tone, 1.37 times as high', '% distortion',
        'second of a voice', '1000 Hz', 'float32: 1e-5 %',
        'tones above a quarter of the sample rate',
    )  # fmt: skip

    def beside(out: np.ndarray, hz: float) -> float:
        part = np.asarray(out[rate // 4 : rate], float)
        angle = 2 * np.pi * hz * pace * np.arange(len(part)) / rate
        basis = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        left = part - basis @ np.linalg.lstsq(basis, part, rcond=None)[0]
        return 100 * rms(left) / rms(part)

    trigger = np.zeros(voices, TRIGGER)
    trigger['gain'], trigger['rate'] = 0.3 / voices, pace
    trigger['attack_s'] = trigger['release_s'] = 0.01
    for hz in (1000.0, 4000.0):
        tone = np.sin(2 * np.pi * hz * np.arange(seconds * rate) / rate).astype('f4')
        bank = Bank([tone], [0], [0.0], [float(seconds)], rate)
        at = np.arange(rate) * pace
        index = np.arange(len(tone))

        def ours(bank: Bank = bank) -> np.ndarray:
            made = Mixer(rate, governor_db=0, gain_db=0)
            return render_all(made, trigger, bank, rate)[:, 0]

        others = {
            'np.interp': lambda at=at, index=index, tone=tone: np.interp(at, index, tone),
            'SciPy cubic spline': lambda at=at, i=index, t=tone: make_interp_spline(i, t)(at),
            'SciPy resample_poly': lambda tone=tone: resample_poly(tone, 100, 137)[:rate],
        }
        took = milliseconds(ours, 3) / voices
        curve.points.append((f'{hz:g} Hz', took, beside(ours(), hz)))
        for name, work in others.items():
            row = (milliseconds(work, 2), beside(work(), hz))
            curve.peers.append((f'{name}, {hz:g} Hz', *row))
    return curve
