# SPDX-License-Identifier: Apache-2.0
"""The true slips of the twin under visitors, and reports of accelerometers compared with them."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from eol_ros.core.physics.twin.accelerometer import LIS3DH, MG
from eol_ros.core.physics.twin.live import Coupling
from eol_ros.core.physics.twin.play import Play
from eol_ros.devices.board.block import WINDOW
from eol_ros.devices.board.felt import TRACE
from support.paper import N_BLOCKS

FPS = 60.0
NEAR_S = 0.010
STOP_S = 0.1
FALSE_PER_HOUR = 20.0  # asked of the whole table
BINS_MM = (0.0, 1.0, 2.0, 5.0, np.inf)
WAKING_S, SLEEPING_S = 15.0, 75.0


@dataclass
class Slip:
    """One slip of the twin: when, which block, how far, m; deflection of the ideal detector."""

    onset_s: float
    block: int
    end_s: float = np.inf
    length_m: float = 0.0
    rest_s: float = np.inf
    whole: float = 0.0
    early: float = 0.0
    left: int = 0  # samples of the trace that belong to its beginning


class Twin:
    """The table under visitors, and its slips."""

    def __init__(
        self, seed: int, drop: float, pauses: bool = False, coupling: Coupling | None = None
    ):
        coupling = coupling or Coupling()
        coupling = coupling._replace(mu_kinetic=coupling.mu_static - drop)
        self.play, self.pauses = Play(seed, TRACE, coupling), pauses
        self.table, self.rim = self.play.table, self.play.rim
        self.slips: list[Slip] = []
        self._running: dict[int, tuple[Slip, np.ndarray]] = {}
        self._ended = np.full(N_BLOCKS, -np.inf)

    def images(self, count: int) -> Iterator[tuple[float, float]]:
        """Move on image by image; yield begin and end of each."""
        for k in range(count):
            there = not self.pauses or (k + 1) / FPS % (WAKING_S + SLEEPING_S) < WAKING_S
            begin_s = self.play.advance(1 / FPS, there)
            self._note(begin_s)
            yield begin_s, self.play.time_s

    def all_slips(self) -> list[Slip]:
        """Return the slips so far, those that go on included."""
        return self.slips + [slip for slip, _ in self._running.values()]

    def _note(self, begin_s: float) -> None:
        trace = self.table.trace
        if trace is None:
            return
        dt = trace.t[1] - trace.t[0]
        sigma = _noise_mps2()
        power = (np.diff(trace.v, axis=0) ** 2).sum(axis=2) / dt * LIS3DH.rate_hz
        for slip, _ in self._running.values():
            slip.whole += power[:, slip.block].sum() / sigma**2
            slip.early += power[: slip.left, slip.block].sum() / sigma**2
            slip.left = max(slip.left - len(power), 0)
        for n in np.argsort(trace.event_t, kind='stable'):
            t, block = float(trace.event_t[n]), int(trace.event_block[n])
            row = min(max(int(np.searchsorted(trace.t, t)), 1), len(trace.t) - 1)
            if trace.event_start[n]:
                slip = Slip(begin_s + t, block, rest_s=begin_s + t - self._ended[block])
                slip.whole = power[row - 1 :, block].sum() / sigma**2
                early = round(WINDOW / LIS3DH.rate_hz / dt)
                slip.early = power[row - 1 : row - 1 + early, block].sum() / sigma**2
                slip.left = max(row - 1 + early - len(power), 0)
                self._running[block] = slip, trace.u[row - 1, block].copy()
            elif block in self._running:
                slip, where = self._running.pop(block)
                slip.end_s = self._ended[block] = begin_s + t
                slip.length_m = float(np.hypot(*(trace.u[row, block] - where)))
                self.slips.append(slip)


def _noise_mps2() -> float:
    return 1e-3 * LIS3DH.noise_ug * (LIS3DH.rate_hz / 2) ** 0.5 * MG


def compare(
    slips: list[Slip], told: list[tuple[float, int, float]], seconds: float
) -> dict[str, Any]:
    """Compare reports (moment, block, when it was felt, s) with `slips`."""
    of_block: list[list[Slip]] = [[] for _ in range(N_BLOCKS)]
    for slip in slips:
        of_block[slip.block].append(slip)
    found: set[int] = set()
    errors, delays = [], []
    false = {'stops': 0, 'sliding': 0, 'struck': 0}
    for time_s, block, felt_s in sorted(told):
        near = [
            s for s in of_block[block]
            if abs(s.onset_s - time_s) < NEAR_S and id(s) not in found
        ]  # fmt: skip
        if near:
            slip = min(near, key=lambda s: abs(s.onset_s - time_s))
            found.add(id(slip))
            errors.append(time_s - slip.onset_s)
            delays.append(felt_s - slip.onset_s)
        elif any(abs(time_s - s.end_s) < NEAR_S for s in of_block[block]):
            false['stops'] += 1
        elif any(s.onset_s <= time_s < s.end_s + STOP_S for s in of_block[block]):
            false['sliding'] += 1
        else:
            false['struck'] += 1
    row: dict[str, Any] = {}
    for low, high in itertools.pairwise(BINS_MM):
        part = [s for s in slips if low <= 1e3 * s.length_m < high]
        name = f'{low:g}-{high:g}mm' if high < np.inf else f'>{low:g}mm'
        row[name] = _shares(part, found)
    for least in (1.0, 2.0):
        part = [s for s in slips if 1e3 * s.length_m >= least]
        row[f'over_{least:g}mm'] = _shares(part, found)
    hours = seconds / 3600
    row |= {f'false_{name}_per_h': count / hours for name, count in false.items()}
    row['false_per_h'] = sum(false.values()) / hours
    row['onset_rms_ms'] = 1e3 * float(np.sqrt(np.mean(np.square(errors or [np.nan]))))
    row['onset_bias_ms'] = 1e3 * float(np.mean(errors or [np.nan]))
    row['felt_p50_ms'], row['felt_p99_ms'] = (
        1e3 * float(np.percentile(delays or [np.nan], p)) for p in (50, 99)
    )
    return row


def _shares(slips: list[Slip], found: set[int]) -> dict[str, Any]:
    """Return how many there are, how many were found, and what the ideal detector misses."""
    from scipy.special import ndtr, ndtri

    hits = sum(id(s) in found for s in slips)
    chance = FALSE_PER_HOUR / (3600 * N_BLOCKS * LIS3DH.rate_hz)
    limit = -ndtri(chance)

    def missed(values: list[float]) -> float:
        return float(np.mean(ndtr(limit - np.sqrt(values)))) if values else 0.0

    return {
        'slips': len(slips), 'found': hits / len(slips) if slips else float('nan'),
        'found_low': wilson(hits, len(slips))[0],
        'again': int(sum(s.rest_s < 0.04 and id(s) not in found for s in slips)),
        'ideal_missed': missed([s.whole for s in slips]),
        'ideal_missed_12ms': missed([s.early for s in slips]),
    }  # fmt: skip


def wilson(hits: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    if not of:
        return 0.0, 1.0
    z2, share = 1.96**2, hits / of
    middle = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = np.sqrt(z2 * (share * (1 - share) / of + z2 / (4 * of * of))) / (1 + z2 / of)
    return float(middle - half), float(min(middle + half, 1.0))
