# SPDX-License-Identifier: Apache-2.0
"""eol bench sound: voices per core, error against run time, and real time, beside other engines.

Then the sound in a running graph: from a slip's true onset to its first sample, and a card that is
pulled out and put in again. And how deep the sound of a rehearsal is.
"""

import argparse
import itertools
import sys
import tempfile
from pathlib import Path

from eol_ros.errors import UsageError

HELP = 'Voices per core, beside other engines; error; underruns; slip to sound; card lost; depth.'
EXAMPLES = [
    'eol bench sound --json',
    'eol bench sound --parts engine,peers --grains 400 --peer scsynth --seconds 3',
    'eol bench sound --parts live --seconds 600',
    'eol bench sound --parts rehearsal,loss --seconds 60',
    'eol bench sound --parts engine,peers --plot docs/img',
    'eol bench sound --parts art --seconds 600 --plot docs/img',
]
PARTS = ('engine', 'peers', 'live', 'rehearsal', 'loss', 'art')
BLOCKS = (64, 128, 256, 512)
PEER_BLOCKS = (64, 256)
OVERLAPS = (100, 400)
ERROR_S = 2.0  # of the score that errors are measured on: the reference is slow


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        '--parts', type=_parts, default=PARTS, metavar='NAMES',
        help=f'some of {",".join(PARTS)} (default: all)',
    )  # fmt: skip
    parser.add_argument(
        '--grains', type=_grains, default=OVERLAPS, metavar='NUMBERS',
        help=f'that sound at once, some of {",".join(map(str, OVERLAPS))} (default: all)',
    )  # fmt: skip
    parser.add_argument('--peer', default='', metavar='TEXT', help='only those with it in the name')
    parser.add_argument('--repeats', type=int, default=3, help='the best of so many is taken')
    parser.add_argument('--seconds', type=float, default=10.0, help='of a score or a live run')
    parser.add_argument(
        '--plot',
        metavar='DIR',
        help='draw sound_speed.png and sound_error.png, or with art sound_depth.png',
    )
    parser.add_argument('--json', action='store_true', help='figures on stdout, for a program')


def run(args) -> int:
    """Measure and tell."""
    from benchmarks.machine import tell
    from benchmarks.sound_engine import source
    from benchmarks.sound_table import lines

    engines = bool({'engine', 'peers'} & set(args.parts))
    if args.plot and not {'engine', 'peers'} <= set(args.parts) and 'art' not in args.parts:
        raise UsageError('--plot draws engine and peers: measure both, or art')
    if args.plot and engines and (args.peer or args.grains != OVERLAPS):
        raise UsageError('--plot draws all peers and numbers of grains: leave out --peer, --grains')
    result: dict = {'seconds': args.seconds}
    sound = source()
    if 'engine' in args.parts:
        result['engine'] = _engine(sound, args.seconds, args.grains, args.repeats)
        result['blocks_identical'] = _identical(sound)
    if 'peers' in args.parts:
        result['peers'] = _peers(sound, args.seconds, args.grains, args.repeats, args.peer)
        result['ratios'] = _ratios(result)
    for part in ('live', 'rehearsal', 'loss'):
        if part in args.parts:
            result[part] = list(_running(part, args.seconds))
    if 'art' in args.parts:
        from benchmarks import sound_art

        plot = Path(args.plot) if args.plot else None
        result['art'] = sound_art.measure(args.seconds, args.repeats, plot=plot)
    if args.plot and engines:
        from benchmarks.sound_plot import draw

        draw(result, Path(args.plot))
    tell(result, args.json, lambda result: '\n'.join(lines(result)))
    return 0


def _parts(text: str) -> tuple[str, ...]:
    names = tuple(text.split(','))
    for name in names:
        if name not in PARTS:
            raise argparse.ArgumentTypeError(f'{name!r} is none of {", ".join(PARTS)}')
    return names


def _grains(text: str) -> tuple[int, ...]:
    for number in text.split(','):
        if number not in map(str, OVERLAPS):
            names = ', '.join(map(str, OVERLAPS))
            raise argparse.ArgumentTypeError(f'{number!r} is none of {names}')
    return tuple(map(int, text.split(',')))


def _running(part: str, seconds: float):
    from benchmarks import sound_live, sound_loss, sound_rehearsal

    measure, cases = {
        'live': (lambda case: {**case, **sound_live.measure(case, seconds)}, sound_live.CASES),
        'rehearsal': (lambda case: sound_rehearsal.measure(seconds, case), ('jack', 'wav')),
        'loss': (sound_loss.measure, (0.5, 4.0)),
    }[part]
    for case in cases:
        print(f'{part}: {case}', file=sys.stderr)
        yield measure(case)


def _engine(sound, seconds: float, overlaps: tuple[int, ...], repeats: int) -> list[dict]:
    from benchmarks.sound_engine import FS, error_db, make_score, ours, speed, truth

    rows = []
    for varied in (False, True):
        for cubic in (True, False):
            short = make_score(100, ERROR_S, varied)
            frames = int((ERROR_S + 0.3) * FS)
            wanted = truth(sound, short, cubic, frames)
            best = truth(sound, short, True, frames)
            made = ours(sound, short, cubic, frames, 256)
            errors = {
                'error_db': -error_db(made, wanted),  # against the same reading in float64
                'error_to_cubic_db': -error_db(made, best),
            }
            for overlap in overlaps:
                score = make_score(overlap, seconds, varied)
                for block in BLOCKS:
                    print(f'mixer: {overlap} grains, block {block}', file=sys.stderr)
                    case = {'overlap': overlap, 'block': block, 'cubic': cubic, 'varied': varied}
                    rows.append({**case, **errors, **speed(sound, score, block, cubic, repeats)})
    return rows


def _peers(
    sound, seconds: float, overlaps: tuple[int, ...], repeats: int, wanted: str
) -> list[dict]:
    import soundfile

    from benchmarks.sound_engine import FS, error_db, make_score, truth
    from benchmarks.sound_peers import PEERS

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        soundfile.write(Path(folder) / 'source.wav', sound, FS, subtype='FLOAT')
        for name, (play, exact, cubic, there) in PEERS.items():
            if wanted not in name:
                continue
            if not there():
                rows.append({'name': name, 'skipped': 'not installed'})
                continue
            for varied in (False, True) if exact else (False,):
                error = None
                if exact:
                    short = make_score(100, ERROR_S, varied)
                    frames = int((ERROR_S + 0.3) * FS)
                    made = play(Path(folder), short, 64)[1][:frames, :2]
                    error = -error_db(made, truth(sound, short, cubic, frames, False), 70)
                for overlap, block in itertools.product(overlaps, PEER_BLOCKS):
                    print(f'{name}: {overlap} grains, block {block}', file=sys.stderr)
                    score = make_score(overlap, seconds, varied)
                    spent = min(play(Path(folder), score, block)[0] for _ in range(repeats))
                    rows.append(
                        {
                            'name': name, 'overlap': overlap, 'block': block, 'varied': varied,
                            'cubic': cubic, 'same_score': exact, 'error_db': error,
                            'voices_per_core': score.grain_seconds / spent,
                            'ns_per_voice_sample': spent / (score.grain_seconds * FS) * 1e9,
                        }
                    )  # fmt: skip
    return rows


def _ratios(result) -> dict[str, float]:
    """Return ours at block 256 over theirs, 400 grains, the same speed of reading."""
    ratios = {}
    for peer in result['peers']:
        if peer.get('overlap') != 400 or 'engine' not in result:
            continue
        for mine in result['engine']:
            if (mine['overlap'], mine['block'], mine['varied']) == (400, 256, peer['varied']):
                cubic = 'cubic' if mine['cubic'] else 'linear'
                speed = 'speed 0.5-2' if mine['varied'] else 'speed 1'
                name = f'{cubic} / {peer["name"]} of block {peer["block"]}, {speed}'
                ratios[name] = mine['voices_per_core'] / peer['voices_per_core']
    return ratios


def _identical(sound) -> bool:
    import numpy as np

    from benchmarks.sound_engine import FS, make_score, ours

    score = make_score(100, 1.0, True)
    outs = [ours(sound, score, True, FS, block) for block in (1, 64, 100, 256, 512, 4096)]
    return all(np.array_equal(out, outs[0]) for out in outs[1:])
