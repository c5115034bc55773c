# SPDX-License-Identifier: Apache-2.0
"""`eol bench sizes`: cascades, 1/f and patterns of light of the twin, by the size of its table.

Simulated visitors move square tables of 84 mm blocks. Motion finds slips and cascades in true
positions with the tracker's noise, and the LED field lights the blocks, as in the graph. The
statistics are those of `eol report`. One run a seed: seed 1, and others drawn at the start, which
the result names. Columns are means over the runs, and +- the standard deviation of one run:

    cascades       of a run, and how many independent ones tell as much
    b              of the nearest law of areas, up to all blocks
    rejected       runs whose areas are not a power law, of those with enough for a fit
    all            share of the cascades that move all blocks
    energy, slips  slope beta of the spectrum: kinetic energy, begun slips in 1/20 s
    1/f            runs with the verdict yes, undecided, no, of both series
    patterns       moments of light, and of 8 measures: how many chance does not give
    turns          corners of the lit regions over those by chance
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import tell
from benchmarks.tables import FPS, square
from benchmarks.twin_slips import NOISE_M
from eol_ros.analysis import light, series
from eol_ros.core.light.local import new_field
from eol_ros.core.motion.motion import Motion
from eol_ros.core.motion.slips import START
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.science import powerlaw
from eol_ros.lab.science import patterns, surrogates
from eol_ros.settings import LedsSettings, MotionSettings, TwinSettings
from eol_ros.verbs.progress import track

HELP = 'Laws of cascades, spectra and patterns of light, for tables of 3 x 3 to 8 x 8 blocks.'
EXAMPLES = ['eol bench sizes --plots docs/img', 'eol bench sizes --seconds 3600 --json']
SIDES = (3, 4, 5, 6, 8)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=900.0, help='of each run')
    parser.add_argument('--seeds', type=int, default=4, metavar='N', help='runs (default 4)')
    parser.add_argument('--plots', metavar='FOLDER', help='draw table_sizes.png there')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Simulate, ask, print."""
    drawn = np.random.SeedSequence().generate_state(args.seeds - 1) // 2
    seeds = [TwinSettings.seed, *drawn.tolist()]
    work = [(side, seed) for side in SIDES for seed in seeds]
    runs = [measure(side, args.seconds, seed) for side, seed in track(work, 'runs')]
    result = {'seconds': args.seconds, 'seeds': seeds, 'runs': runs}
    if args.plots:
        _draw(runs, Path(args.plots))
    tell(result, args.json, _table)
    return 0


def measure(side: int, seconds: float, seed: int) -> dict[str, Any]:
    """Return the figures of one run."""
    table, leds, rng = square(side), LedsSettings(), np.random.default_rng([seed, side])
    play, motion = Play(seed, 0, None, table), Motion(MotionSettings(), table)
    field = new_field(leds.flash_limit, leds.decay_s, leds.peak, table)
    known, sigma = np.ones(table.cells, bool), np.full(table.cells, NOISE_M)
    energy = series.Energy(seconds, table.count)
    areas: list[int] = []
    onsets: list[float] = []
    moments = np.zeros((int(seconds / light.MOMENT_S) + 1, table.cells), bool)
    images, before = round(seconds * FPS), np.zeros(table.cells)
    stamps, places = np.zeros(images, 'i8'), np.zeros((2, images, table.cells))
    for k in range(images):
        stamp_s = k / FPS
        play.advance(1 / FPS)
        at = np.stack([play.table.x, play.table.y]) + rng.normal(0, NOISE_M, (2, table.cells))
        slips, cascades = motion.update(stamp_s, *at, known, sigma)
        areas += [one.area for one in cascades]
        for event in (one.event for one in slips):
            if event.kind == START:
                onsets.append(event.onset_s)
                field.slip(stamp_s, event.block)
        levels = field.levels(stamp_s).astype(float)
        moments[int(stamp_s / light.MOMENT_S)] |= 255 * (levels - before) >= light.FLASH
        stamps[k], places[:, k], before = round(stamp_s * 1e9), at, levels
    energy.add({'stamp': stamps, 'blocks': {'x': places[0], 'y': places[1]}})
    times_s = np.sort([t for t in onsets if 0 <= t < seconds])
    counts = surrogates.event_counts(times_s, seconds, series.RATE_HZ)
    found: dict[str, Any] = {
        'side': side, 'seed': seed, 'blocks': table.count, 'cascades': len(areas),
        'all': float(np.mean(np.array(areas) == table.count)) if areas else None,
    }  # fmt: skip
    return (
        found
        | _law(areas, table.count)
        | _spectra(energy, counts, times_s)
        | _light(table.grid(moments), seed)
    )


def _law(areas: list[int], blocks: int) -> dict[str, Any]:
    try:
        law = powerlaw.cascade_law(np.array(areas), blocks)
    except powerlaw.FitError as why:
        return {'no_law': str(why)}
    tested = law.tested
    return {
        'b': law.fit.b_value, 'b_error': tested.error, 'ks': law.fit.ks, 'p': tested.p_value,
        'independent': tested.effective, 'rejected': law.rejected,
    }  # fmt: skip


def _spectra(energy: series.Energy, counts: np.ndarray, times_s: np.ndarray) -> dict[str, Any]:
    found: dict[str, Any] = {}
    both = energy.series(), series.Series('slips', counts, times_s=times_s)
    for name, one in zip(('energy', 'slips'), both, strict=True):
        answer = series.ask(one)
        found |= {f'{name}_1f': answer.answer, f'{name}_said': answer.sentence}
        if answer.slope is not None:
            found |= {f'{name}_beta': answer.slope.beta}
    return found


def _light(flashes: np.ndarray, seed: int) -> dict[str, Any]:
    try:
        found = patterns.ask(flashes, 1 / light.MOMENT_S, np.random.default_rng(seed))
    except patterns.TooFew as why:
        return {'no_patterns': str(why)}
    asked = [*found.static, found.follows]
    turns = next(one for one in asked if one.name == 'turns')
    return {
        'moments': found.moments, 'clear': sum(one.clear for one in asked),
        'turns': turns.mean / turns.by_chance,
        'measures': {one.name: [one.mean, one.by_chance, one.p_holm] for one in asked},
    }  # fmt: skip


def _spread(rows: list[dict[str, Any]], name: str) -> tuple[float, float] | None:
    """Return mean and standard deviation of one run; None where no run has it."""
    values = [row[name] for row in rows if row.get(name) is not None]
    return (float(np.mean(values)), float(np.std(values, ddof=len(values) > 1))) if values else None


def _by_side(runs: list[dict[str, Any]]) -> dict[int, list[dict[str, Any]]]:
    return {side: [row for row in runs if row['side'] == side] for side in SIDES}


def _draw(runs: list[dict[str, Any]], folder: Path) -> None:
    from benchmarks.plots import Curves, draw

    titles = {'b': 'b of areas', 'energy_beta': 'beta, energy', 'slips_beta': 'beta, slips',
              'turns': 'turns over chance'}  # fmt: skip
    panels: dict[str, Curves] = {title: {} for title in titles.values()}
    for rows in _by_side(runs).values():
        for name, title in titles.items():
            if (found := _spread(rows, name)) is not None:
                panels[title].setdefault('twin', []).append((rows[0]['blocks'], *found, ''))
    draw(folder / 'table_sizes.png', panels, 'blocks', 'value', ('linear', 'linear'))


def _table(result: dict[str, Any]) -> str:
    """Return the figures as Markdown."""
    names = ('blocks', 'cascades', 'b', 'rejected', 'all', 'energy', 'slips', '1/f', 'patterns',
             'turns')  # fmt: skip
    lines = [
        f'{len(result["seeds"])} runs of {result["seconds"]:g} s each, seeds {result["seeds"]}',
        f'| {" | ".join(names)} |', '|' + ' --- |' * len(names),
    ]  # fmt: skip

    def words(rows: list[dict[str, Any]], name: str, digits: int = 2) -> str:
        found = _spread(rows, name)
        return f'{found[0]:.{digits}f}±{found[1]:.{digits}f}' if found else '-'

    for rows in _by_side(result['runs']).values():
        fitted = [row['rejected'] for row in rows if 'rejected' in row]
        said = [row[f'{name}_1f'] for row in rows for name in ('energy', 'slips')]
        cells = [
            rows[0]['blocks'], f'{words(rows, "cascades", 0)}, {words(rows, "independent", 0)}',
            words(rows, 'b'), f'{sum(fitted)} of {len(fitted)}', words(rows, 'all', 3),
            words(rows, 'energy_beta'), words(rows, 'slips_beta'),
            '/'.join(str(said.count(answer)) for answer in ('yes', 'undecided', 'no')),
            f'{words(rows, "moments", 0)}, {words(rows, "clear", 0)}', words(rows, 'turns'),
        ]  # fmt: skip
        lines.append(f'| {" | ".join(map(str, cells))} |')
    return '\n'.join(lines)
