# SPDX-License-Identifier: Apache-2.0
"""eol bench measure: does `eol measure` find what a table is like, and are its errors true?

Each twin has values that nobody tells (benchmarks/measure_twins.py), and is measured by what runs
in `eol measure` too. Of 100 the 68 % interval should hold the true value for 68, the 95 % one for
95.
"""

import argparse
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import tell
from benchmarks.measure_twins import Blinks, Hung, Image, Pulled
from eol_ros.core.measure import friction, light, springs
from eol_ros.core.measure.estimate import Estimate, SampleMean
from eol_ros.errors import EolError, UsageError
from eol_ros.verbs.progress import track

HELP = 'Measure twins with unknown springs and friction: error, and how often intervals hold.'
EXAMPLES = [
    'eol bench measure',
    'eol bench measure --parts springs --twins 20 --plot docs/img',
    'eol bench measure --rendered 20 --first 7',
]

Measured = Estimate | SampleMean


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--parts', default=','.join(PARTS), help='parted by commas (default: all)')
    parser.add_argument('--twins', type=int, default=100, metavar='N', help='of each (100)')
    parser.add_argument('--first', type=int, default=0, metavar='SEED', help='of the first (0)')
    parser.add_argument(
        '--rendered', type=float, metavar='SECONDS',
        help='instead: friction of the blocks of the first twin, through drawn images',
    )  # fmt: skip
    parser.add_argument('--plot', type=Path, metavar='FOLDER', help='write measure_*.png there')
    parser.add_argument('--json', action='store_true')


def of_springs(seed: int) -> dict[str, tuple[float, Measured]]:
    """Return the true stiffness of a twin, and the measured one."""
    twin = Hung(seed)
    return {'stiffness': (twin.stiffness, measured_springs(twin).stiffness)}


def measured_springs(twin: Hung) -> springs.Springs:
    """Return what weights on a twin say."""
    rests = springs.Rests(twin.block)
    for image in twin.images():
        rests.add(*image)
    return springs.fit(rests.found, twin.weights_kg, twin.block, twin.natural_m)


def of_friction(seed: int) -> dict[str, tuple[float, Measured]]:
    """Return true and measured friction of a twin, and what its nine blocks say, were they known.

    The last is what an interval from nine blocks can do at best: its misses are the draw's.
    """
    twin = Pulled(seed)
    found = measured_friction(twin)
    return {
        'mu_static': (twin.coupling.mu_static, found.static),
        'mu_kinetic': (twin.coupling.mu_kinetic, found.kinetic),
        'nine, told': (twin.coupling.mu_static, SampleMean(twin.each[friction.INNER, 0])),
    }


def measured_friction(twin: Pulled) -> friction.Friction:
    """Return what pulling the rim of a twin says."""
    track = tracked(twin.images())
    slips = friction.find_slips(track, twin.stiffness.value, twin.mass.value, twin.natural_m)
    return friction.fit(slips, track, twin.stiffness, twin.mass, twin.natural_m)


def tracked(images: Iterable[Image]) -> friction.Track:
    """Return images as one track."""
    return friction.Track(*(np.array(part) for part in zip(*images, strict=True)))


def of_light(seed: int) -> dict[str, tuple[float, Measured]]:
    """Return true and measured delay of a light, s."""
    blinks = Blinks(seed)
    return {'light_seen_s': (blinks.delay_s, measured_light(blinks).delay)}


def measured_light(blinks: Blinks) -> light.Light:
    """Return what a camera says of blinks."""
    heard_s = blinks.stamp_s + blinks.heard_s
    return light.fit(blinks.sent_s, blinks.stamp_s, heard_s, blinks.seen, blinks.exposure_s)


def of_images(seed: int, seconds: float) -> dict[str, Any]:
    """Return by what share friction of single blocks is off, seen in drawn images by the tracker.

    Stiffness, mass and natural length are told, so that only seeing and the method are left.
    """
    twin = Pulled(seed, seconds)
    c, known = twin.coupling, (twin.coupling.stiffness, twin.coupling.block_kg)
    track = tracked(twin.rendered(seed))
    slips = friction.find_slips(track, *known, c.spring_natural_m)
    exact = (Estimate(value, 0.0) for value in known)
    found = friction.fit(slips, track, *exact, c.spring_natural_m)
    off = found.each / twin.each[friction.INNER] - 1
    return {
        'seconds': seconds, 'slips': len(slips), 'blocks': int(np.isfinite(off[:, 0]).sum()),
        'rms': np.sqrt(np.nanmean(off**2, axis=0)).tolist(),
        'worst': np.nanmax(np.abs(off), axis=0).tolist(),
    }  # fmt: skip


PARTS: dict[str, Callable[[int], dict[str, tuple[float, Measured]]]] = {
    'springs': of_springs, 'friction': of_friction, 'light': of_light,
}  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure, count, print."""
    parts = args.parts.split(',')
    for part in parts:
        if part not in PARTS:
            raise UsageError(f'--parts {part}: there are {", ".join(PARTS)}')
    if args.rendered is not None:
        if not 5 <= args.rendered <= 600:
            raise UsageError(f'--rendered {args.rendered:g}: 5 to 600')
        tell(of_images(args.first, args.rendered), args.json, _images)
        return 0
    if args.twins < 2:
        raise UsageError(f'--twins {args.twins}: 2 or more')
    rows = []
    for part in parts:
        rows += study(part, range(args.first, args.first + args.twins))
    if args.plot:
        draw(args.plot, args.first, rows)
    tell({'twins': args.twins, 'rows': rows}, args.json, _table)
    return 0


def study(part: str, seeds: range) -> list[dict[str, Any]]:
    """Return a row for each value that `part` measures."""
    found: dict[str, list[tuple[float, Measured]]] = {}
    refused, begun = [], time.perf_counter()
    for seed in track(seeds, part):
        try:
            for name, pair in PARTS[part](seed).items():
                found.setdefault(name, []).append(pair)
        except EolError as error:
            refused.append(str(error))
    spent_s = (time.perf_counter() - begun) / len(seeds)
    about = {'part': part, 'refused': refused, 'seconds': spent_s}
    return [row(name, pairs) | about for name, pairs in found.items()]


def row(name: str, pairs: list[tuple[float, Measured]]) -> dict[str, Any]:
    """Return how far the measured are from the true, and how often their intervals hold them."""
    scale = np.mean([truth for truth, _ in pairs]) if name == 'light_seen_s' else 0.0
    off = np.array([(e.value - truth) / (scale or truth) for truth, e in pairs])
    held = {
        level: sum(low <= truth <= high for truth, (low, high) in (
            (truth, e.interval(0.01 * level)) for truth, e in pairs
        ))
        for level in (68, 95)
    }  # fmt: skip
    return {
        'value': name, 'measured': len(pairs),
        'held_68': held[68], 'held_95': held[95],
        'rms': float(np.sqrt(np.mean(off**2))), 'bias': float(off.mean()),
        'worst': float(np.abs(off).max()),
        'sigma': float(np.median([e.sigma / (scale or truth) for truth, e in pairs])),
        'each': [(truth, e.value, e.sigma, *e.interval(0.95)) for truth, e in pairs],
    }  # fmt: skip


def draw(folder: Path, seed: int, rows: list[dict[str, Any]]) -> None:
    """Write of each part measure_PART.png, the fit of one twin, and measure_coverage_PART.png."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    from eol_ros.analysis import measured

    folder.mkdir(parents=True, exist_ok=True)
    for part in dict.fromkeys(r['part'] for r in rows):
        fit = {
            'springs': lambda: measured_springs(Hung(seed)),
            'friction': lambda: measured_friction(Pulled(seed)),
            'light': lambda: measured_light(Blinks(seed)),
        }[part]()
        measured.save(folder / f'measure_{part}.png', fit)
        mine = [r for r in rows if r['part'] == part]
        figure, axes = plt.subplots(
            len(mine), 1, figsize=(9, 1.8 * len(mine) + 0.4), layout='constrained', squeeze=False
        )
        for axis, r in zip(axes[:, 0], mine, strict=True):
            truth, _, _, low, high = np.array(r['each']).T
            holds = (low <= truth) & (truth <= high)
            scale = np.full(len(truth), truth.mean()) if part == 'light' else truth
            for which, colour in ((holds, 'C0'), (~holds, 'C3')):
                at = np.flatnonzero(which)
                span = [100 * (ends - truth)[which] / scale[which] for ends in (low, high)]
                axis.vlines(at, *span, color=colour)
            axis.axhline(0, color='0.5', linewidth=0.8)
            axis.set(ylabel=f'{r["value"]}\n95 %, off by %', xlim=(-1, len(truth)))
        axes[-1, 0].set_xlabel('twin')
        figure.savefig(folder / f'measure_coverage_{part}.png', dpi=110)
        plt.close(figure)


def _images(result: dict[str, Any]) -> str:
    lines = [f'{result["slips"]} slips in {result["seconds"]:g} s, {result["blocks"]} blocks']
    for name, rms, worst in zip(
        ('mu_static', 'mu_kinetic'), result['rms'], result['worst'], strict=True
    ):
        lines.append(
            f'{name:11} of single blocks off {100 * rms:.2f} % RMS, {100 * worst:.2f} % at most'
        )
    return '\n'.join(lines)


def _table(result: dict[str, Any]) -> str:
    lines = ['value          twins  in 68 %  in 95 %  rms off   bias  worst  median error  s each']
    for r in result['rows']:
        lines.append(
            f'{r["value"]:14} {r["measured"]:5}  {r["held_68"]:7}  {r["held_95"]:7}'
            f'  {100 * r["rms"]:5.2f} %  {100 * r["bias"]:+5.2f}  {100 * r["worst"]:5.2f}'
            f'  {100 * r["sigma"]:10.2f} %  {r["seconds"]:6.2f}'
        )
        lines += [f'  refused: {words}' for words in sorted(set(r['refused']))]
    return '\n'.join(lines)
