# SPDX-License-Identifier: Apache-2.0
"""eol report: figures and numbers from a bag, without ROS."""

import itertools
import json
import sys
from pathlib import Path

from eol_ros import folders
from eol_ros.cli import within
from eol_ros.errors import DeviceMissing, UsageError, pip_install

HELP = 'Write figures, numbers and tables of a bag: one HTML page, SVG, PDF and CSV. Needs no ROS.'
EXAMPLES = [
    'eol report bags                                # the newest run in bags/',
    'eol report run_0.mcap --output analysis',
    'eol report bags --csv slips,blocks --output analysis',
    'eol report bags --all --output exhibition      # every run in bags/: days, hours, wear',
    'eol report bags --retrack --json               # recompute the results and compare',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'bag', nargs='+', help='bag folder, .mcap file, or a folder of bags: its newest run; '
        'several make one report, in which a folder stands for all its bags'
    )  # fmt: skip
    crew = parser.add_mutually_exclusive_group()
    crew.add_argument(
        '--workers',
        type=within(1, 1000, int),
        default=1,
        metavar='N',
        help='read many bags with N processes (1)',
    )
    crew.add_argument(
        '--scheduler', metavar='tcp://HOST:8786',
        help='read many bags on a Dask cluster, whose workers find them at the same paths',
    )  # fmt: skip
    parser.add_argument(
        '--all', action='store_true', help='make one report of all bags in the folder'
    )
    parser.add_argument(
        '-o', '--output', metavar='DIR', help='output folder (default: report-NAME here)'
    )
    parser.add_argument('--csv', metavar='TOPICS', help='write these topics as CSV, and no report')
    parser.add_argument(
        '--retrack',
        action='store_true',
        help='recompute blocks, slips, cascades and triggers and compare them',
    )
    parser.add_argument(
        '--measured', metavar='SCENE',
        help='scene with the stiffness, friction and mass that `eol measure` found, for seismic '
            'moments and energies (default: those of the twin, if it was recorded)',
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print the numbers as JSON')


def run(args):
    """Analyse; return 1 when --retrack finds a difference or a hole."""
    from eol_ros.analysis.bag import open_bag, topic_names
    from eol_ros.streams.graph import relative_name
    from eol_ros.verbs.progress import track

    if args.all or len(args.bag) > 1:
        return _exhibition(args)
    bag = open_bag(args.bag[0])
    for line in bag.cut_short:
        print(line, file=sys.stderr)
    out = Path(args.output or f'report-{bag.path.stem}')
    if args.csv is not None:
        names = topic_names(bag, args.csv)
        folders.made(out, '--output')
        files: dict[str, str] = {}  # topic by file: /a/b and /a_b are two
        for name in dict.fromkeys(names):
            plain = relative_name(name, bag.namespace).strip('/').replace('/', '_')
            numbered = (f'{plain}-{k}' for k in itertools.count(2))
            files[next(f for f in itertools.chain([plain], numbered) if f not in files)] = name
        for plain, name in track(files.items(), 'writing'):
            file = out / f'{plain}.csv'
            bag.table(name).to_csv(file)
            print(file)
        return 0
    measured = None
    if args.measured:
        from eol_ros import scene as scenes

        measured = scenes.load(args.measured).settings('twin')
    retracked = None
    if args.retrack:
        from eol_ros.analysis.retrack import retrack

        retracked = retrack(bag, track)
        if retracked.verdict == 'different':
            retracked.notes += _other_versions(bag)
    _want_matplotlib()
    from eol_ros.analysis.report import summary, write

    found = write(bag, out, retracked, track, measured)
    print(json.dumps(found, indent=2) if args.json else summary(found))
    print(out / 'report.html', file=sys.stderr)
    whole = retracked is None or (retracked.verdict != 'different' and not retracked.holes)
    return 0 if whole else 1


def _other_versions(bag):
    """Return a line that names the versions which recorded the bag, if others recompute it."""
    import yaml

    from eol_ros import yaml_text
    from eol_ros.ros.run_record import versions

    try:
        recorded = yaml_text.load(bag.about.get('versions', ''))
    except yaml.YAMLError:
        recorded = None
    recorded, here = recorded if isinstance(recorded, dict) else {}, versions()
    unequal = [
        n for n in ('eol_ros', 'commit', 'python', 'numpy') if recorded.get(n) != here.get(n)
    ]
    if not unequal:
        return []
    then, now = (', '.join(f'{n} {v.get(n, "?")}' for n in unequal) for v in (recorded, here))
    return [f'recorded with {then}, recomputed with {now}: another version may give other results']


def _exhibition(args):
    """Report many bags as one; what cannot be read is named and left out."""
    from eol_ros.analysis import exhibition
    from eol_ros.verbs.progress import track

    for option in ('csv', 'retrack', 'measured'):
        if getattr(args, option):
            raise UsageError(f'--{option} is for one bag: name one, without --all')
    _want_matplotlib()
    digests: list[exhibition.Digest] = []
    paths, left_out = exhibition.bags_in(args.bag)
    for one in track(_read(args, paths), 'reading', total=len(paths)):
        if isinstance(one, str):
            left_out.append(one)
        else:
            digests.append(one)
    out = Path(args.output or 'report-exhibition')
    found = exhibition.write(digests, left_out, out, track)
    print(json.dumps(found, indent=2) if args.json else '\n'.join(exhibition.sentences(found)))
    print(out / 'report.html', file=sys.stderr)
    return 0


def _read(args, paths):
    """Yield what is kept of each bag: read here, by processes, or on a cluster."""
    from eol_ros.analysis import exhibition
    from eol_ros.lab.sweeps import crews

    if not args.scheduler and args.workers == 1:
        yield from map(exhibition.digest, paths)
        return
    opened = crews.cluster(args.scheduler) if args.scheduler else crews.local(args.workers)
    with opened as crew:
        there = [path.resolve() for path in paths]  # workers find them by these
        for one, _ in crew.work_through(exhibition.digest, there, ahead=2):
            yield one


def _want_matplotlib():
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise DeviceMissing(
            f'matplotlib is not installed: {pip_install("matplotlib")}; '
            'eol report --csv works without it'
        ) from None
