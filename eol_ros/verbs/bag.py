# SPDX-License-Identifier: Apache-2.0
"""eol bag: what is in a bag, whether it is whole, and bags out of bags. No ROS needed."""

import json
import shlex
import sys
import warnings
from pathlib import Path

from eol_ros.cli import within
from eol_ros.errors import BagDamaged, UsageError, printable, writing

HELP = 'Inspect, verify, repair and cut bags. Needs no ROS.'
EXAMPLES = [
    'eol bag info bags                              # the newest run in bags/',
    'eol bag verify bags/rehearsal_2026-11-21_10-00-00',
    'eol bag recover bags/rehearsal_2026-11-21_10-00-00',
    'eol bag recover run_0.mcap --output whole.mcap',
    'eol bag cut bags --start 60 --end 120 --topics blocks,slips --output a-minute.mcap',
    'eol bag keep bags/museum_2026-11-21_10-00-00',
]
LONG_BYTES = 1 << 28  # read in a second or two
ALIASES = {'verify': ['doctor'], 'cut': ['filter']}  # as the program `mcap` calls them


def add_arguments(parser):
    """Declare the command line."""
    verbs = parser.add_subparsers(dest='what', metavar='COMMAND', required=True)

    def command(name, text):
        sub = verbs.add_parser(name, help=text, description=text, aliases=ALIASES.get(name, []))
        sub.set_defaults(does=COMMANDS[name])
        return sub

    source = 'bag folder, .mcap file, or a folder of bags: its newest run'
    out = 'new bag folder, or new file if it ends in .mcap'
    info = command('info', 'Print the topics, times and losses of a bag.')
    info.add_argument('bag', help=source)
    info.add_argument('--json', action='store_true', help='print one JSON object')
    info.add_argument(
        '--index', action='store_true',
        help='trust the index: fast for many GB, but blind to damage elsewhere',
    )  # fmt: skip
    check = command(
        'verify', 'Verify every checksum, index and count; exit code 1 if one is wrong.'
    )
    check.add_argument('bag', help=source)
    check.add_argument('--json', action='store_true', help='print one JSON object')
    recover = command(
        'recover',
        'Repair a truncated bag, or with --output write what can be read as a new one. A bag that '
        'is damaged elsewhere needs --output.',
    )
    recover.add_argument('bag', help=source)
    recover.add_argument('-o', '--output', metavar='OUT', help=out)
    cut = command('cut', 'Write a stretch of a bag, or some of its topics, as a new bag.')
    cut.add_argument('bag', help=source)
    cut.add_argument('-o', '--output', metavar='OUT', required=True, help=out)
    cut.add_argument(
        '--start',
        type=within(0, 1e9),
        default=0.0,
        metavar='S',
        help='begin S seconds after the start of the bag',
    )
    cut.add_argument(
        '--end', type=within(0, 1e9), metavar='S', help='end S seconds after the start of the bag'
    )
    cut.add_argument(
        '--topics', metavar='TOPICS', help='topics, separated by commas (default: all)'
    )
    keep = command('keep', 'Mark a bag: the recorder never removes it (recorder.keep_gb).')
    keep.add_argument('bag', help='bag folder, or a folder of bags: its newest run')
    keep.add_argument('--off', action='store_true', help='remove the mark')


def run(args):
    """Do it; return 1 where something of a bag could not be read."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', BagDamaged)  # told here, when all has been read
        return args.does(args)


def _info(args) -> int:
    from eol_ros.devices.bag.reader import BagReader, Unreadable
    from eol_ros.verbs.progress import track

    bag = BagReader(args.bag)
    size = sum(f.path.stat().st_size for f in bag.files)
    through = (lambda files: track(files, 'reading')) if size > LONG_BYTES else iter
    lost = Unreadable(0, 0.0) if args.index else bag.prove(through)
    rows = {}
    for key, topic in bag.topics.items():
        rows[key] = {'type': topic.type, 'messages': bag.counts[key]}
        rows[key] |= {'encoding': topic.foreign} if topic.foreign else {}
    if args.json:
        answer = {
            'bag': str(bag.path), 'start_ns': bag.start_ns, 'duration_s': bag.duration_s,
            'bytes': size, 'files': [f.path.name for f in bag.files], 'topics': rows,
            'about': bag.about, 'gaps': bag.gaps, 'cut_short': bag.cut_short, 'damage': bag.damage,
            'unreadable': lost._asdict(),
        }  # fmt: skip
        print(json.dumps(answer, indent=2))
    else:
        print(f'{bag.path}  {bag.duration_s:.1f} s  {size / 1e6:.1f} MB  {len(bag.files)} files')
        for name, row in rows.items():
            kind = f'{row["type"]} {row.get("encoding", "")}'.rstrip()
            print(f'{row["messages"]:10}  {name:32} {printable(kind)}')
        for name, value in bag.gaps.items():
            print(f'{name}: {value}')
    code = _tell(bag)
    if advice := _advice(bag, lost):
        print(advice, file=sys.stderr)
    return code


def _advice(bag, lost) -> str:
    """Return in one line what a damaged or cut bag has lost, and which command makes it whole."""
    from eol_ros.devices.bag.recover import in_use

    command = f'`eol bag recover {shlex.quote(str(bag.path))}'
    if bag.damage:
        counted = all(file.indexed for file in bag.files if file.damage)
        total, places = sum(bag.counts.values()), len(bag.damage)
        if any(d.end_ns for file in bag.files for d in file.damage):
            count = f'{lost.messages} of {total}' if counted else 'an unknown number of'
            what = f'{count} messages are lost'
            what += f', within {lost.seconds:.1f} s' if lost.seconds else ''
        else:
            what = 'no message is lost'
        place = 'one place' if places == 1 else f'{places} places'
        if any(file.indexed for file in bag.files if file.damage):
            command += ' --output NEW` writes what is left as a new bag'
        else:
            command += '` makes it whole without that'
        return f'{bag.path}: damaged in {place}: {what}; {command}'
    if all(file.cut_at is None for file in bag.files):
        return ''
    if any(in_use(file.path) for file in bag.files if file.cut_at is not None):
        return f'{bag.path}: is being recorded'
    return f'{bag.path}: {command}` makes it whole'


def _verify(args) -> int:
    from eol_ros.devices.bag.verify import verify
    from eol_ros.verbs.progress import track

    bag, wrong = verify(args.bag, lambda files: track(files, 'reading'))
    for line in bag.notes:
        print(line, file=sys.stderr)
    if args.json:
        print(json.dumps({'bag': str(bag.path), 'whole': not wrong, 'wrong': wrong}, indent=2))
    elif wrong:
        print('\n'.join(wrong))
    else:
        print(f'{bag.path}: whole, {sum(bag.counts.values())} messages')
    return 1 if wrong else 0


def _recover(args) -> int:
    from eol_ros.devices.bag import edit
    from eol_ros.devices.bag.reader import BagReader
    from eol_ros.devices.bag.recover import repair, rewrite_metadata
    from eol_ros.devices.bag.verify import metadata_faults, verify

    bag = BagReader(args.bag, any_span=True)
    if args.output:
        about, gaps = {**bag.about, edit.FROM: str(bag.path)}, dict(bag.gaps)
        gaps['recovered'] = f'from {bag.path.name}'
        topics, out = list(bag.topics.values()), Path(args.output)
        messages = _told(bag.messages(), bag)
        count = edit.copy(out, topics, messages, about, gaps, lambda: bag.damage)
        print(f'{args.output}: {count} messages', file=sys.stderr)
        return _tell(bag)
    for line in bag.notes:
        print(line, file=sys.stderr)
    cut = [file for file in bag.files if not file.indexed]
    lost = 0
    for file in cut:
        try:
            done = repair(file.path)
        except BlockingIOError:
            raise UsageError(
                f'{file.path}: is being recorded; --output OUT writes what there is of it so far'
            ) from None
        lost += len(done.damage) or done.file is None
        print(done.words, file=sys.stderr)
    if cut:
        return 1 if lost else 0
    metadata, count = bag.path / 'metadata.yaml', sum(bag.counts.values())
    if bag.path.is_dir() and (not metadata.exists() or metadata_faults(bag)):
        rewrite_metadata(bag.path)
        print(f'{metadata}: written again', file=sys.stderr)
    if verify(bag.path)[1]:
        raise UsageError(
            f'{bag.path}: is damaged, not cut: --output OUT writes what can be read as a new bag'
        )
    print(f'{bag.path}: whole, {count} messages: nothing is left to recover', file=sys.stderr)
    return 0


def _cut(args) -> int:
    from eol_ros.analysis.bag import topic_names
    from eol_ros.devices.bag import edit
    from eol_ros.devices.bag.reader import BagReader

    bag = BagReader(args.bag)
    end_s = bag.duration_s if args.end is None else args.end
    if not 0 <= args.start <= bag.duration_s:
        raise UsageError(f'--start {args.start:g}: the bag has {bag.duration_s:.1f} s')
    if not args.start < max(end_s, 1e-9):
        raise UsageError(f'--start {args.start:g} --end {end_s:g}: it ends before it begins')
    names = None if args.topics is None else topic_names(bag, args.topics)
    topics = [t for t in bag.topics.values() if names is None or t.key in names]
    start_ns = bag.start_ns + round(args.start * 1e9)
    end_ns = None if args.end is None else bag.start_ns + round(args.end * 1e9)
    about = {**bag.about, edit.FROM: f'{bag.path} from {args.start:g} to {end_s:g} s'}
    messages = _told(edit.stretch(bag, names, start_ns, end_ns), bag)
    count = edit.copy(Path(args.output), topics, messages, about, bag.gaps, lambda: bag.damage)
    print(f'{args.output}: {count} messages', file=sys.stderr)
    return _tell(bag)


def _told(messages, bag):
    """Return messages, and show how far they are where there are many."""
    from eol_ros.verbs.progress import track

    size = sum(file.size for file in bag.files)
    count = sum(bag.counts.values())
    return track(messages, 'writing', total=count) if size > LONG_BYTES else messages


def _keep(args) -> int:
    from eol_ros.devices.bag.reader import BagReader
    from eol_ros.devices.bag.retention import mark

    path = BagReader(args.bag, any_span=True).path
    if not path.is_dir():
        raise UsageError(f'{path}: is a file; the folder of a bag is marked')
    with writing(path):
        mark(path, not args.off)
    print(f'{path}: {"not marked any more" if args.off else "kept"}', file=sys.stderr)
    return 0


def _tell(bag) -> int:
    """Say on stderr what could not be read; return the exit code."""
    for line in [*bag.cut_short, *bag.damage]:
        print(line, file=sys.stderr)
    return 1 if bag.damage else 0


COMMANDS = {
    'info': _info, 'verify': _verify, 'recover': _recover, 'cut': _cut, 'keep': _keep,
}  # fmt: skip
