# SPDX-License-Identifier: Apache-2.0
"""eol bench mapping: does the map from slips to sound make or destroy 1/f?

Slips of known kind go through the classes that play live: `Selector.felt` with the settings of the
shipped rehearsal (reach, refractory time, cap of a block), `Voicing`, and the mixer, whose sound is
asked as `eol report` asks it. Beside the map as it is: one that holds nothing back, short and long
grains. `model` is the slope that `core/science/sounding.py`, which knows no corpus, gives instead.

Slips: at random times with a rate that is itself 1/f (300/s; the first start whose slips the
verdict calls 1/f); by chance; and the paper's table under the gestures of the twin's visitors.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import picture
from benchmarks.machine import tell
from eol_ros.errors import UsageError

HELP = 'Whether the map from slips to sound makes or destroys 1/f: spectra of slips and of sound.'
EXAMPLES = ['eol bench mapping --plot docs/img', 'eol bench mapping --seconds 600 --json']
CHANCE_HZ = 8.0
KNOCK_MPS2 = 2.9  # of every slip: the map's own gains are not asked
MAPS: dict[str, dict[str, Any]] = {
    'as shipped': {},
    'nothing held back': {'refractory_s': 0.0, 'block_cap': 1000, 'total_cap': 10_000},
    'grains of 0.05 s': {'grain_s': 0.05},
    'grains of 2 s': {'grain_s': 2.0, 'release_s': 1.5},
}
SEED, TRIES = 1, 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=300.0, help='of each series (300)')
    parser.add_argument('--plot', metavar='DIR', help='draw mapping.png there')
    parser.add_argument('--json', action='store_true')


def slips_of(kind: str, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return when slips begin, (n,) s, and their blocks."""
    from benchmarks import known_series
    from eol_ros.core.geometry import N_BLOCKS
    from eol_ros.core.science import surrogates, sweep

    rng = np.random.default_rng([SEED, 3])
    if kind == 'hands on the table':
        return sweep.slips_under_hands(seconds, SEED)
    if kind == '1/f rate':
        name = 'events of 1/f rate'
        seeds = range(SEED, SEED + TRIES)
        seed = next((s for s in seeds if known_series.ask(name, seconds, s).answer == 'yes'), SEED)
        drawn = np.random.default_rng([seed, 1])  # as `known_series.ask` draws it
        times_s = known_series.SERIES[name][1](seconds, drawn).times_s
    else:
        times_s = surrogates.poisson_times(round(CHANCE_HZ * seconds), seconds, rng)
    return times_s, rng.integers(0, N_BLOCKS, len(times_s))


KINDS = ('1/f rate', 'by chance', 'hands on the table')


def run(args: argparse.Namespace) -> int:
    """Map, ask, print, draw."""
    from eol_ros.verbs.progress import track

    if not args.seconds >= 160:
        raise UsageError(f'--seconds {args.seconds:g}: 160 at least, for two decades up to 5 Hz')
    work = [(kind, name) for kind in KINDS for name in MAPS]
    rows = [_row(kind, name, args.seconds) for kind, name in track(work, 'maps')]
    if args.plot:
        draw(rows, args.seconds, Path(args.plot))
    told = [{k: v for k, v in row.items() if k != 'answers'} for row in rows]
    tell({'seconds': args.seconds, 'seed': SEED, 'rows': told}, args.json, table)
    return 0


def _row(kind: str, name: str, seconds: float) -> dict[str, Any]:
    """Ask slips, triggers and sound of one map."""
    from eol_ros import scene as scenes
    from eol_ros.analysis import series
    from eol_ros.core.science import one_over_f, sounding, surrogates

    scene = scenes.load('rehearsal')
    rule = replace(scene.settings('grains'), **MAPS[name])
    times_s, block = slips_of(kind, seconds)
    begins_s, loud = sound(times_s, block, rule, scene.settings('sound'), seconds)
    heard_s = times_s[sounding.heard(times_s, block, rule)]

    def ask(what: str, values: np.ndarray, **more: Any) -> Any:
        rng = np.random.default_rng(SEED)
        return one_over_f.ask(what, values, series.RATE_HZ, series.HIGH_HZ, rng, **more)

    def counted(what: str, at_s: np.ndarray) -> Any:
        counts = surrogates.event_counts(at_s, seconds, series.RATE_HZ)
        return ask(what, counts, times_s=at_s)

    modelled = sounding.power(heard_s, seconds, series.RATE_HZ, rule)
    answers = {
        'slips': counted('slips', times_s), 'triggers': counted('triggers', begins_s),
        'sound': ask('sound', loud, rest=QUIET), 'model': ask('model', modelled, rest=0.0),
    }  # fmt: skip
    found: dict[str, Any] = {
        'slips_from': kind, 'map': name, 'slips': len(times_s), 'sounding': len(begins_s),
        'answers': answers,
    }  # fmt: skip
    for what, answer in answers.items():
        found[f'{what}_is'] = answer.answer
        if answer.slope is not None:
            found[f'{what}_slope'] = answer.slope.beta
            found[f'{what}_interval'] = [answer.slope.low, answer.slope.high]
            found[f'{what}_says'] = answer.sentence
    return found


QUIET = 10 ** ((-70.0 + 0.691) / 10)  # mean square of the absolute gate of BS.1770


def sound(
    times_s: np.ndarray, block: np.ndarray, rule: Any, settings: Any, seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return when grains begin, s, and the K-weighted power of their sound, (n,) at 20/s."""
    from eol_ros.analysis import series
    from eol_ros.core.geometry import rest_lattice
    from eol_ros.core.sound.offline import play
    from eol_ros.core.sound.select import Selector
    from eol_ros.core.sound.voicing import Voicing, new_mixer
    from eol_ros.devices.audio.bank import load_bank
    from eol_ros.devices.corpus.corpus_build import apart
    from eol_ros.devices.corpus.loader import corpus_spec

    corpus = apart(*corpus_spec(rule))
    grains = corpus.grains
    files = [source.path for source in corpus.sources]
    bank = load_bank(
        files, grains['file'], grains['start_s'], grains['duration_s'], settings.sample_rate
    )
    selector, (x, y) = Selector(rule, corpus), rest_lattice().T
    made = [
        selector.felt(time_s, one, x[one], y[one], KNOCK_MPS2)
        for time_s, one in zip(times_s.tolist(), block.tolist(), strict=True)
    ]
    triggers = np.concatenate(made)
    triggers = triggers[np.argsort(triggers['time_s'], kind='stable')]
    rows, _ = Voicing(settings).rows(triggers, bank)
    frames = round(seconds * settings.sample_rate)
    blocks = play(new_mixer(settings), rows, frames, 1 << 16)
    return triggers['time_s'].copy(), series.mean_squares(blocks, settings.sample_rate)


def table(result: dict[str, Any]) -> str:
    """Return the table of docs/science.md."""
    lines = [
        f'{result["seconds"]:g} s each, seed {result["seed"]}; slope, and whether it is 1/f',
        '| slips | map | slips a second | slips | triggers | sound | model of the sound |',
        '| --- ' * 7 + '|',
    ]
    for r in result['rows']:
        cells = [
            f'{r[f"{what}_slope"]:.2f} ({r[f"{what}_is"]})'
            if f'{what}_slope' in r else r[f'{what}_is']
            for what in ('slips', 'triggers', 'sound', 'model')
        ]  # fmt: skip
        lines.append(
            f'| {r["slips_from"]} | {r["map"]} | {r["slips"] / result["seconds"]:.1f} | '
            f'{" | ".join(cells)} |'
        )
    return '\n'.join(lines)


def draw(rows: list[dict[str, Any]], seconds: float, folder: Path) -> None:
    """Write mapping.png: spectra of slips and of the sound of each map, by kind of slips."""
    figure, axes = picture.axes(1, len(KINDS), (11, 3.9))
    for axis, kind in zip(axes[0], KINDS, strict=True):
        mine = [r for r in rows if r['slips_from'] == kind]
        curves = [('slips', mine[0]['answers']['slips'], 'k')]
        curves += [(r['map'], r['answers']['sound'], f'C{k}') for k, r in enumerate(mine)]
        for words, answer, colour in curves:
            if answer.spectrum is None or answer.slope is None:
                continue
            f, power = answer.spectrum.frequency_hz, answer.spectrum.power
            label = f'{words}: {answer.slope.beta:.2f}, {answer.answer}'
            axis.loglog(f, power / power[:4].mean(), color=colour, label=label, linewidth=1.2)
        axis.plot(f, f[0] / f, ':', color='#777777', linewidth=0.8)
        axis.set(xlabel='frequency (Hz)', title=f'slips: {kind}')
        axis.set_ylim(bottom=axis.get_ylim()[0] / 30)  # room for the legend
        axis.legend(fontsize=7, title='slope, 1/f?', title_fontsize=7, loc='lower left')
    axes[0, 0].set_ylabel('power of the sound, or slips (lowest bins: 1)')
    said = f'eol bench mapping --seconds {seconds:g}: seed {SEED}; dotted: 1/f'
    picture.save(figure, folder, 'mapping', said)
