# SPDX-License-Identifier: Apache-2.0
"""eol render: triggers to a sound file, the samples that a live run gives for them."""

import contextlib
import json
import math
import os
import sys
from pathlib import Path

from eol_ros import folders
from eol_ros.cli import within
from eol_ros.disk import readable
from eol_ros.errors import ConfigError, UsageError

HELP = 'Play the grain triggers of a bag or a CSV into a sound file, faster than real time.'
EXAMPLES = [
    'eol render bags/2026-11-21 --output afternoon.wav',
    'eol render triggers.csv --corpus corpus.json --output x.flac --json',
    'eol render bags --corpus other.json --output other.wav --scene config/museum.yaml',
]
TAIL_S = 0.5  # after the last grain: the DC block and the limiter come to rest


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('source', metavar='BAG|TRIGGERS.csv', help='bag, or CSV file of triggers')
    parser.add_argument(
        '--corpus', metavar='C.json', help='corpus of the grains (default: that of the bag)'
    )
    parser.add_argument(
        '-o', '--output', metavar='X.wav', required=True, help='sound file: wav, flac, ogg ...'
    )
    parser.add_argument('--scene', metavar='FILE', help='scene with the settings of node sound')
    parser.add_argument('--seconds', type=within(1e-3, 1e6), help='duration (default: to the end)')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args) -> int:
    """Read, render, write, tell."""
    import numpy as np

    from eol_ros import scene
    from eol_ros.analysis.sound import BLOCK, REFUSALS
    from eol_ros.core.sound.offline import play
    from eol_ros.core.sound.voicing import new_mixer
    from eol_ros.settings import SoundSettings
    from eol_ros.verbs.progress import Progress, track

    loaded = scene.load(args.scene) if args.scene else None
    settings = loaded.settings('sound') if loaded else SoundSettings()
    with Progress('reading triggers and sounds'):
        rows, times_s, refused, banks, table = _voices(args, settings, loaded)
    grains = max(map(len, banks))
    told = ~(times_s >= (args.seconds or math.inf))  # one without a time is refused
    count = int(told.sum())
    rate = settings.sample_rate
    end_s = float((rows['time_s'] + rows['length'] / rate).max()) if len(rows) else 0.0
    frames = math.ceil((args.seconds or end_s + TAIL_S + settings.room_s) * rate)
    mixer = new_mixer(settings, table=table)
    peak, energy = 0.0, 0.0
    channels = settings.channels
    with writer(args.output, settings.sample_rate, channels) as file:
        blocks = play(mixer, rows, frames, BLOCK)
        for block in track(blocks, 'rendering', total=math.ceil(frames / BLOCK)):
            file.write(block)
            peak = max(peak, float(np.abs(block).max()))
            energy += float(np.square(block, dtype=np.float64).sum())
    del banks  # the voices read them to the end
    state = mixer.state[0]
    why = {name: int(((refused == k) & told).sum()) for k, name in enumerate(REFUSALS) if k}
    why['too_many'] = int(state['dropped'])
    figures = {
        'output': args.output,
        'seconds': frames / rate,
        'sample_rate': rate,
        'channels': channels,
        'triggers': count,
        'dropped': sum(why.values()),
        'dropped_why': why,
        'stolen': int(state['stolen']),
        'peak_dbfs': _decibels(peak),
        'rms_dbfs': _decibels(math.sqrt(energy / max(1, frames * channels))),
        'limiter_least_db': _decibels(float(state['limiter_least'])),
    }
    if args.json:
        print(json.dumps(figures))
    else:
        print(f'{args.output}: {figures["seconds"]:.1f} s, {count} grains')
        print(
            f'peak {figures["peak_dbfs"]:.1f} dBFS, {figures["dropped"]} dropped, '
            f'{figures["stolen"]} faded early',
            file=sys.stderr,
        )
        for name, number in why.items():
            if number:
                print(f'dropped: {number} {_remedy(name, args.corpus, grains)}', file=sys.stderr)
    return 0


def _remedy(why: str, corpus: str | None, grains: int) -> str:
    """Return what is wrong with triggers that were dropped, and what to do."""
    from eol_ros.core.sound.triggers import MAX_GAIN, MAX_RATE, MIN_RATE

    return {
        'no_such_grain': f'name no grain of {corpus or "the corpus of the bag"}, which has 0 to '
        f'{grains - 1}: give the corpus that they were made with',
        'bad_number': f'have a number out of range: gain 0 to {MAX_GAIN:g}, rate {MIN_RATE:g} to '
        f'{MAX_RATE:g} or backwards, pan -1 to 1, attack and release from 0 s on',
        'too_short': 'are of grains shorter than 4 samples: cut longer ones with `eol corpus`',
        'too_many': 'came with thousands of others at once: spread them over time',
    }[why]


def _decibels(amplitude: float) -> float:
    return round(20 * math.log10(max(amplitude, 1e-6)), 2)


def _voices(args, settings, loaded):
    """Return the voices, the times of their triggers, why they were refused, banks and table."""
    from eol_ros.analysis import sound
    from eol_ros.core.sound.voicing import Voicing
    from eol_ros.core.table import Table

    piped = readable(args.source) and not Path(args.source).is_file()
    if (piped and args.corpus) or Path(args.source).suffix.lower() == '.csv':
        from eol_ros.devices.files.trigger_file import load_triggers

        if not args.corpus:
            raise UsageError(f'{args.source}: a CSV names no sound; add --corpus C.json')
        triggers = load_triggers(args.source)
        table = Table.of(loaded.table) if loaded else Table()
    else:
        from eol_ros.analysis.bag import open_bag
        from eol_ros.analysis.recorded_settings import recorded_table

        bag = open_bag(args.source)
        table = recorded_table(bag)
        if not args.corpus:
            return *sound.voices(bag, settings), table
        triggers, _ = sound.bag_triggers(bag, settings)
    bank = _bank(args.corpus, settings.sample_rate)
    rows, mask = Voicing(settings, table).rows(triggers, bank)
    return rows, triggers['time_s'], sound.why_refused(triggers, mask, bank), [bank], table


def _bank(path: str, sample_rate: int):
    from eol_ros.devices.audio.bank import load_bank
    from eol_ros.devices.corpus.corpus_file import load
    from eol_ros.settings import DESCRIPTORS

    corpus = load(Path(path))
    grains = corpus.grains
    files = [source.path for source in corpus.sources]
    told = {name: grains[name].astype('f4') for name in DESCRIPTORS}  # as nodes do
    file, start, duration = (grains[name] for name in ('file', 'start_s', 'duration_s'))
    return load_bank(files, file, start, duration, sample_rate, descriptors=told)


@contextlib.contextmanager
def writer(path: str, sample_rate: int, channels: int):
    """Open the file to write; 32-bit float where the format has it, so that no bit is lost.

    Raises ConfigError where it cannot be opened, or a block not be written; what else the caller
    meets meanwhile is not its fault.
    """
    import soundfile

    from eol_ros.devices.audio.audio_file import without_time

    kind = Path(path).suffix.lstrip('.').upper()
    if kind not in soundfile.available_formats():
        raise UsageError(f'{path}: the ending names the format; give .wav, .flac or .ogg')
    folders.check_writable(path, '--output')
    subtype = 'FLOAT' if soundfile.check_format(kind, 'FLOAT') else None
    try:
        file = soundfile.SoundFile(os.fsencode(path), 'w', sample_rate, channels, subtype=subtype)
        with without_time(file):
            yield file
    except soundfile.LibsndfileError as error:  # it names no reason: any is a system error
        raise ConfigError(f'{path}: cannot be written ({error}); is its disk full?') from None
