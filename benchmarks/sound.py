# SPDX-License-Identifier: Apache-2.0
"""eol bench sound: voices per core, error against float64, and real time.

Then the sound in a running graph: from a slip's true onset to its first sample.
"""

import argparse
import sys
from collections.abc import Callable, Iterator

HELP = 'Measure voices per core, errors, underruns and the delay from a slip to its sound.'
EXAMPLES = [
    'eol bench sound --json',
    'eol bench sound --parts engine --grains 400 --seconds 3',
    'eol bench sound --parts live --seconds 600',
    'eol bench sound --parts rehearsal --seconds 60',
]
PARTS = ('engine', 'live', 'rehearsal', 'instrument')
BLOCKS = (64, 128, 256, 512)
OVERLAPS = (100, 400)
ERROR_S = 2.0  # of the score that errors are measured on: the reference is slow


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        '--parts', type=_some(PARTS), default=PARTS, metavar='NAMES',
        help=f'parts, separated by commas: {",".join(PARTS)} (default: all)',
    )  # fmt: skip
    parser.add_argument(
        '--grains', type=_some(OVERLAPS), default=OVERLAPS, metavar='NUMBERS',
        help=f'numbers of simultaneous grains: {",".join(map(str, OVERLAPS))} (default: all)',
    )  # fmt: skip
    parser.add_argument('--repeats', type=int, default=3, help='number of runs; the fastest counts')
    parser.add_argument(
        '--seconds', type=float, default=10.0, help='duration of a score or live run'
    )
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args) -> int:
    """Measure and tell."""
    from benchmarks.machine import tell
    from benchmarks.sound_engine import source

    result: dict = {'seconds': args.seconds}
    if 'engine' in args.parts:
        sound = source()
        result['engine'] = _engine(sound, args.seconds, args.grains, args.repeats)
        result['blocks_identical'] = _identical(sound)
    for part in PARTS[1:]:
        if part in args.parts:
            result[part] = list(_running(part, args.seconds))
    tell(result, args.json, _lines)
    return 0


def _some(known: tuple) -> Callable[[str], tuple]:
    """Return a parser of comma-separated items of `known`."""
    named = {str(one): one for one in known}

    def read(text: str) -> tuple:
        for name in text.split(','):
            if name not in named:
                raise argparse.ArgumentTypeError(f'{name!r} is none of {", ".join(named)}')
        return tuple(named[name] for name in text.split(','))

    return read


def _running(part: str, seconds: float):
    from benchmarks import sound_live, sound_rehearsal

    cases = sound_live.CASES if part == 'live' else ('jack', 'wav')
    for case in cases:
        print(f'{part}: {case}', file=sys.stderr)
        if part == 'live':
            yield {**case, **sound_live.measure(case, seconds)}
        else:
            yield sound_rehearsal.measure(seconds, case, part)


def _lines(result: dict) -> str:
    found = _engines(result)
    if 'blocks_identical' in result:
        found.append(f'the same bits at any block size: {result["blocks_identical"]}')
    for part in PARTS[1:]:
        found += [f'{part}: {", ".join(_figures(row))}' for row in result.get(part, ())]
    return '\n'.join(found)


def _engines(result: dict) -> list[str]:
    rows = []
    for r in result.get('engine', ()):
        name = f'speed {"0.5-2" if r["varied"] else "1"}'
        rows.append(
            f'mixer {name:22}{r["overlap"]:8}{r["block"]:7}{r["voices_per_core"]:13.0f}'
            f'{r["ns_per_voice_sample"]:7.2f}{r["error_db"]:10.1f}'
        )
    head = f'{"":28}{"grains":>8}{"block":>7}{"voices/core":>13}{"ns":>7}{"error dB":>10}'
    return [head, *rows] if rows else []


def _figures(row: dict, of: str = '') -> Iterator[str]:
    """Yield the figures of a row for a terminal, nested ones by both names."""
    for name, value in row.items():
        if isinstance(value, dict):
            yield from _figures(value, f'{of}{name} ')
        elif value not in (None, [], ''):
            yield f'{of}{name} {value:.4g}' if isinstance(value, float) else f'{of}{name} {value}'


def _engine(sound, seconds: float, overlaps: tuple[int, ...], repeats: int) -> list[dict]:
    from support.sound_reference import snr_db

    from benchmarks.sound_engine import FS, make_score, ours, speed, truth

    rows = []
    for varied in (False, True):
        short = make_score(100, ERROR_S, varied)
        frames = int((ERROR_S + 0.3) * FS)
        wanted = truth(sound, short, frames)  # the same reading in float64
        error_db = -float(snr_db(ours(sound, short, frames, 256), wanted))
        for overlap in overlaps:
            score = make_score(overlap, seconds, varied)
            for block in BLOCKS:
                print(f'mixer: {overlap} grains, block {block}', file=sys.stderr)
                case = {'overlap': overlap, 'block': block, 'varied': varied, 'error_db': error_db}
                rows.append({**case, **speed(sound, score, block, repeats)})
    return rows


def _identical(sound) -> bool:
    import numpy as np

    from benchmarks.sound_engine import FS, make_score, ours

    score = make_score(100, 1.0, True)
    outs = [ours(sound, score, FS, block) for block in (1, 64, 100, 256, 512, 4096)]
    return all(np.array_equal(out, outs[0]) for out in outs[1:])
