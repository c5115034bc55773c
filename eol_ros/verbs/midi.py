# SPDX-License-Identifier: Apache-2.0
"""eol midi: the inputs that there are, what comes from one, and lines for `midi_map` learnt."""

import contextlib
import sys
import time
from pathlib import Path

from eol_ros import interrupts
from eol_ros.cli import within
from eol_ros.errors import DeviceMissing, UsageError

HELP = (
    'List MIDI inputs, print incoming messages, and assign controllers to settings of grains and\n'
    'sound (docs/guides/play.md).'
)
EXAMPLES = [
    'eol midi list',
    'eol midi watch --input nanoKONTROL',
    'eol midi learn "sound.filter_hz 200 8000" my/museum.yaml   # turn a controller: it is written',
    'eol midi learn "recall storm"',
    'eol midi watch --input jack:virtual --for 60',
]
PERIOD_S = 0.01


def add_arguments(parser):
    """Declare the command line."""
    add = parser.add_argument
    parser.add_argument(
        'action',
        choices=('list', 'watch', 'learn'),
        help='list inputs, print messages, or wait for a controller and assign it',
    )
    parser.add_argument(
        'what', nargs='?', help='learn: target of the controller, such as a setting and its range'
    )
    parser.add_argument(
        'scene', nargs='?', metavar='SCENE', help='learn: scene file to write the line into'
    )
    add(
        '--input',
        default='auto',
        metavar='NAME',
        help='input by name or part of it, auto or virtual',
    )
    add('--jack', action='store_true', help='list: show the inputs of JACK')
    add(
        '--for',
        dest='seconds',
        type=within(0, 1e9),
        default=0.0,
        metavar='S',
        help='end after S seconds; 0: at Ctrl-C',
    )


def run(args):
    """Do it; exit code 69 where there is no such input, or nothing came."""
    if args.action == 'list':
        from eol_ros.devices.audio.midi import inputs

        names = inputs(args.jack)
        print(''.join(f'{name}\n' for name in names), end='')
        if not names:
            print('no MIDI inputs; `midi: virtual` makes one', file=sys.stderr)
        return 0
    if args.action == 'learn' and not args.what:
        raise UsageError('learn: say what it does, such as sound.filter_hz')
    if args.action == 'watch':
        for event in _events(args):
            print(event.words, event.value, flush=True)
        return 0
    from eol_ros import scene_text
    from eol_ros.ros.presets import midi_mapping

    midi_mapping((f'cc 0 {args.what}',) if 'program' not in args.what else ())  # refused at once
    before: tuple[str, ...] = ()
    if args.scene:
        before = scene_text.to_write(Path(args.scene), 'sound').nodes['sound'].midi_map
    for event in _events(args):
        if not event.value:
            continue  # a key let go
        line = f'{event.words} {args.what}'
        midi_mapping((line,))
        print(line)
        if args.scene:
            same = event.words + ' '
            lines = [*(old for old in before if not old.startswith(same)), line]
            scene_text.write(Path(args.scene), 'sound', {'midi_map': lines})
        return 0
    raise DeviceMissing('no controller, key or program came')


def _events(args):
    """Yield what comes until it is told to stop."""
    from eol_ros.core.sound.midi import event_of
    from eol_ros.devices.audio.midi import MidiIn

    with (
        contextlib.closing(MidiIn(args.input)) as port,
        interrupts.until_stopped(args.seconds) as goes_on,
    ):
        while goes_on():
            for message in port.take():
                event = event_of(message)
                if event is not None:
                    yield event
            time.sleep(PERIOD_S)
