# SPDX-License-Identifier: Apache-2.0
"""eol listen: record a microphone or contact pickup, sound by sound, into a folder of grains."""

import sys
import time
from pathlib import Path

from eol_ros import interrupts
from eol_ros.cli import within
from eol_ros.errors import UsageError, writing

HELP = 'Record a microphone or contact pickup, sound by sound, into a folder that grains are of.'
EXAMPLES = [
    'eol listen --into voices                    # a scene says: grains: {more_sounds: [voices]}',
    'eol listen --into table --device Scarlett --on -30 --keep 20',
    'eol listen --into voices --from walk.wav    # a recording in place of the microphone',
    'eol listen --list',
]
TAKE = 'take-*.wav'


def add_arguments(parser):
    """Declare the command line."""
    add = parser.add_argument
    add('--into', metavar='DIR', help='folder for the sounds; made if it is not there')
    add('--device', default='auto', metavar='NAME', help='input by name or part of it')
    add('--from', dest='source', metavar='FILE', help='cut this recording instead, and end')
    add('--on', type=within(-120, 0), default=-40.0, metavar='DB', help='sounds begin above')
    add('--off', type=within(-120, 0), default=-50.0, metavar='DB', help='sounds end below')
    add(
        '--keep',
        type=within(1, 10000, int),
        default=50,
        metavar='N',
        help='number of sounds to keep; older ones are removed',
    )
    add(
        '--for',
        dest='seconds',
        type=within(0, 1e9),
        default=0.0,
        metavar='S',
        help='stop after S seconds; 0: Ctrl-C',
    )
    add('--list', action='store_true', help='the inputs that there are')


def run(args):
    """Record until told to stop; exit code 69 where there is no such input."""
    if args.list:
        from eol_ros.devices.audio.microphone import inputs

        names = inputs()
        print(''.join(f'{name}\n' for name in names), end='')
        if not names:
            print('no sound inputs', file=sys.stderr)
        return 0
    if not args.into:
        raise UsageError('--into: name the folder for the sounds')
    if args.off > args.on:
        raise UsageError(f'--off {args.off:g}: must not lie above --on, {args.on:g}')
    folder = Path(args.into)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    if args.source:
        from eol_ros.devices.audio.audio_file import read_mono

        heard = read_mono(args.source)
        return _record([heard.samples], heard.rate, folder, args)
    from eol_ros.devices.audio.microphone import Microphone

    with Microphone(args.device) as microphone:
        print(f'listening at {microphone.rate} Hz', file=sys.stderr, flush=True)
        return _record(microphone.blocks(), microphone.rate, folder, args)


def _record(blocks, rate, folder, args):
    from eol_ros.core.sound.takes import Takes

    takes = Takes(rate, args.on, args.off)
    with interrupts.until_stopped(args.seconds) as goes_on:
        for block in blocks:
            for take in takes.feed(block):
                _keep(take, rate, folder, args.keep)
            if not goes_on():
                break
    for take in takes.end():
        _keep(take, rate, folder, args.keep)
    return 0


def _keep(take, rate, folder, most):
    """Write a take whole or not at all, for the corpus is read meanwhile; forget the oldest."""
    from eol_ros.devices.audio import audio_file
    from eol_ros.disk import DISK

    path = folder / time.strftime(f'take-%Y%m%d-%H%M%S-{time.time_ns() % 10**9:09d}.wav')
    with writing(path), DISK.replacing(path) as part:
        audio_file.write(part, take, rate, 'PCM_16')
    print(f'{path} {len(take) / rate:.2f} s', flush=True)
    for old in sorted(folder.glob(TAKE))[:-most]:
        old.unlink(missing_ok=True)
