# SPDX-License-Identifier: Apache-2.0
"""eol corpus: cut sounds into grains, describe and lay them out; move one."""

import dataclasses
import hashlib
import json
import re
import sys
import time
from pathlib import Path

from eol_ros.cli import within
from eol_ros.errors import UsageError
from eol_ros.settings import DESCRIPTORS, FORMS
from eol_ros.verbs.progress import Progress

HELP = 'Cut sounds into grains, compute their descriptors and lay them out in the space.'
EXAMPLES = [
    'eol corpus iceberg.wav --output iceberg.json',
    'eol corpus field/*.flac --grain 0.1 --overlap 0.5 --x pitch_hz --y loudness_lufs -o f.json',
    'eol corpus ice.wav harbour.flac --region "ice left" --region "harbour right" -o two.json',
    'eol corpus door.ogg --segment onset --csv door.csv --labels-out door.labels.txt',
    'eol corpus door.ogg --segment labels --labels door.labels.txt --output door.json',
    'eol corpus                               (the ice recording)',
    'eol corpus move iceberg.json 17 0.5 0.25',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'words',
        nargs='*',
        metavar='AUDIO',
        help='sound files or folders; or move CORPUS GRAIN X Y',
    )
    add = parser.add_argument
    add(
        '--segment',
        choices=('chop', 'onset', 'gate', 'none', 'labels'),
        default='chop',
        help='cut into equal lengths (default), at onsets, above a level, at labels, or not at all',
    )
    add(
        '--grain',
        type=within(0.02, 60),
        default=0.25,
        metavar='S',
        help='grain length; with onset the greatest length',
    )
    add('--overlap', type=within(0, 0.9), nargs='?', const=0.5, default=0.0, metavar='SHARE',
        help='share of a grain that the next repeats (0.5 if no number is given)')  # fmt: skip
    add('--labels', metavar='FILE', default='', help='Audacity label track to cut at')
    add('--onset', type=within(0.1, 60), default=4.0, metavar='DB',
        help='rise in level that begins a grain')  # fmt: skip
    add(
        '--gate-on',
        type=within(-120, 0),
        default=-40.0,
        metavar='DB',
        help='level above which a grain begins',
    )
    add(
        '--gate-off',
        type=within(-120, 0),
        default=-50.0,
        metavar='DB',
        help='level below which a grain ends',
    )
    add(
        '--silence',
        type=within(-200, 0),
        default=-70.0,
        metavar='DB',
        help='grains below this level get no place',
    )
    add('--x', choices=DESCRIPTORS, default=DESCRIPTORS[0], metavar='NAME',
        help=f'descriptor from left to right: {_NAMES}')  # fmt: skip
    add('--y', choices=DESCRIPTORS, default=DESCRIPTORS[1], metavar='NAME',
        help='descriptor from near to far; names as for --x')  # fmt: skip
    where = 'where the grains of a sound lie: left, right, near, far, or X,Y,X,Y in 0..1'
    add('--region', action='append', default=[], metavar='"NAME REGION"', help=where)
    add(
        '--layout',
        choices=('raw', 'rank', 'even'),
        default='even',
        help='place by value, by rank, or evenly spread (default)',
    )
    add(
        '--blend',
        type=within(0, 1),
        default=1.0,
        metavar='0..1',
        help='0: measured places, 1: the layout',
    )
    add('-o', '--output', metavar='FILE', help='corpus file (JSON)')
    add('--csv', metavar='FILE', help='table with one line for each grain')
    add('--labels-out', metavar='FILE', help='Audacity label track of the grains')
    add('--json', action='store_true', help='print the corpus as JSON')


_NAMES = ', '.join(DESCRIPTORS)


def run(args):
    """Make or change a corpus."""
    return (_move if args.words[:1] == ['move'] else _make)(args)


def _make(args):
    from eol_ros.devices.corpus import corpus_build, corpus_file

    options = _options(args)
    if args.words:
        sounds = [s for word in args.words for s in corpus_file.sounds_of(Path(word))]
    else:
        sounds = [corpus_build.make_ice()]
    if args.labels and len(sounds) > 1:
        raise UsageError('--labels is for one sound; with several, put NAME.labels.txt beside each')
    if args.labels_out and len(sounds) > 1:
        raise UsageError('--labels-out is for one sound; take them one by one')
    began = time.perf_counter()
    with Progress('describing the grains') as progress:
        corpus = corpus_build.build_cached(sounds, options, progress)
    took_s = time.perf_counter() - began
    for note in corpus.notes:
        print(f'eol corpus: {note}', file=sys.stderr)
    if args.output:
        corpus_file.save(corpus, Path(args.output))
    if args.csv:
        corpus_file.save_csv(corpus, Path(args.csv))
    if args.labels_out:
        corpus_file.save_labels(corpus, Path(args.labels_out))
    if args.json:
        print(corpus_file.as_json(corpus), end='')
    else:
        _summary(corpus)
    length_s = sum(s.duration_s for s in corpus.sources)
    print(f'{length_s:.1f} s of sound in {took_s:.2f} s', file=sys.stderr)
    if not (args.output or args.json or args.csv or args.labels_out):
        print('nothing written; --output FILE keeps the corpus', file=sys.stderr)
    return 0


def _options(args):
    from eol_ros.devices.corpus.corpus_file import Options

    if args.gate_off > args.gate_on:
        raise UsageError(f'--gate-off {args.gate_off:g}: must not lie above {args.gate_on:g}')
    for line in args.region:
        if not re.fullmatch(FORMS['NAME REGION'], line):
            raise UsageError(f'--region {line!r} is not NAME REGION')
    if args.labels and args.segment != 'labels':
        raise UsageError('--labels is read only with --segment labels')
    return Options(
        segment=args.segment,
        grain_s=args.grain,
        overlap=args.overlap,
        x_axis=args.x,
        y_axis=args.y,
        layout=args.layout,
        blend=args.blend,
        onset_db=args.onset,
        gate_on_db=args.gate_on,
        gate_off_db=args.gate_off,
        silence_db=args.silence,
        labels=args.labels,
        regions=tuple(args.region),
    )


def _summary(corpus):
    import numpy as np

    placed = corpus.placed
    print(f'{len(corpus)} grains, {int(placed.sum())} placed, {int((~placed).sum())} silent')
    print(f'{"":18}{"least":>12}{"10 %":>12}{"middle":>12}{"90 %":>12}{"most":>12}')
    for name in DESCRIPTORS:
        values = corpus.grains[name][placed]
        values = values[np.isfinite(values)]
        cells = np.percentile(values, [0, 10, 50, 90, 100]) if len(values) else []
        print(f'{name:18}' + ''.join(f'{v:12.4g}' for v in cells))


def _move(args):
    from eol_ros.devices.corpus import corpus_file

    try:
        path, grain, x, y = args.words[1:]
        grain, x, y = int(grain), float(x), float(y)
    except ValueError:
        raise UsageError('move takes: CORPUS.json GRAIN X Y') from None
    corpus = corpus_file.load(Path(path))
    kept = corpus_file.move(corpus, grain, x, y)
    corpus.grains['x'][grain], corpus.grains['y'][grain] = x, y
    key = hashlib.sha256(f'{corpus.digest} {grain} {x!r} {y!r}'.encode()).hexdigest()
    corpus_file.save(dataclasses.replace(corpus, digest=key), Path(path))
    print(json.dumps({'grain': grain, 'x': x, 'y': y, 'kept_in': str(kept)}))
    return 0
