# SPDX-License-Identifier: Apache-2.0
"""eol speakers: the outputs of a scene by name, and noise from each in turn."""

import json
import sys

from eol_ros.cli import within
from eol_ros.errors import UsageError

HELP = 'List the loudspeakers of a scene with delay and trim; play noise from each in turn.'
EXAMPLES = [
    'eol speakers museum',
    'eol speakers museum --test',
    'eol speakers museum --test left,right --seconds 5',
    'eol speakers museum --test --output test.wav',
]
GAP_S = 0.2


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('scene', metavar='SCENE', help='a scene file, or one that ships')
    parser.add_argument(
        '--test', nargs='?', const='', metavar='NAMES', help='play these (default: all), in order'
    )
    parser.add_argument(
        '--seconds', type=within(0.01, 600), default=1.0, help='duration of noise per speaker'
    )
    parser.add_argument('-o', '--output', metavar='X.wav', help='write the noise here, play none')
    parser.add_argument('--json', action='store_true', help='for programs')


def run(args) -> int:
    """Tell, and play."""
    from eol_ros import scene
    from eol_ros.core.sound.meter import decibels
    from eol_ros.core.sound.ring import alignment, output_names, parse

    settings = scene.load(args.scene).settings('sound')
    if args.output and args.test is None:
        raise UsageError('--output takes what --test plays: add --test')
    speakers = parse(settings.speakers)
    delay, gain = alignment(speakers, settings.sample_rate)
    names = output_names(settings)
    rows: list[dict] = [{'output': k + 1, 'name': name} for k, name in enumerate(names)]
    for row, speaker, late, trim in zip(rows, speakers, delay, gain, strict=False):
        row |= {
            'azimuth': speaker.azimuth, 'distance_m': speaker.distance_m,
            'delay_ms': round(1e3 * float(late) / settings.sample_rate, 2),
            'trim_db': round(decibels(float(trim)), 2),
        }  # fmt: skip
    if args.json:
        print(json.dumps(rows))
    else:
        print('\n'.join(map(_line, rows)))
    if args.test is not None:
        wanted = args.test.split(',') if args.test else names
        for name in wanted:
            if name not in names:
                raise UsageError(f'--test {name}: there are {", ".join(names)}')
        _play(settings, {name: names.index(name) for name in wanted}, args)
    return 0


def _line(row: dict) -> str:
    line = f'{row["output"]:3}  {row["name"]:14}'
    if 'azimuth' in row:
        line += (
            f'{row["azimuth"]:7g} deg{row["distance_m"]:7g} m'
            f'{row["delay_ms"]:8.2f} ms later{row["trim_db"]:8.2f} dB'
        )
    return line.rstrip()


def _play(settings, outputs: dict[str, int], args) -> None:
    """Play noise from each of `outputs`, by name, in turn, and say which; or write it."""
    import time

    import numpy as np

    from eol_ros.core.sound.channel_test import pink_noise

    rate = settings.sample_rate
    noise = pink_noise(rate, args.seconds)
    step = len(noise) + round(GAP_S * rate)
    sound = np.zeros((step * len(outputs), settings.channels), np.float32)
    for k, output in enumerate(outputs.values()):
        sound[k * step : k * step + len(noise), output] = noise
    if args.output:
        from eol_ros.verbs.render import writer

        with writer(args.output, rate, settings.channels) as file:
            file.write(sound)
        return
    from eol_ros.devices.audio.outputs import find, portaudio

    device = 'auto' if settings.device == 'wav' else settings.device
    card = find(device, settings.channels)
    player = portaudio()
    player.play(sound, rate, device=card)
    for name in outputs:
        print(f'noise from {name}', file=sys.stderr, flush=True)
        time.sleep(step / rate)
    player.wait()
