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
    'eol render bags --rate 96000 --stems blocks --output studio.wav',
]
STEM_CEILING_DB = 120.0  # beyond what any stem reaches
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
    parser.add_argument(
        '--rate', type=within(8000, 192_000), help='sample rate, Hz (default: of the settings)'
    )
    parser.add_argument(
        '--stems',
        choices=('blocks', 'sounds'),
        help='also a file for each block or sound, such as X-block03.wav, without governor and '
        'limiter; their sum is the mix before both',
    )
    parser.add_argument('--seconds', type=within(1e-3, 1e6), help='duration (default: to the end)')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args) -> int:
    """Read, render, write, tell."""
    import dataclasses

    from eol_ros import scene
    from eol_ros.analysis.sound import REFUSALS
    from eol_ros.core.sound.voicing import new_mixer
    from eol_ros.settings import SoundSettings
    from eol_ros.verbs.progress import Progress

    if args.stems and not _subtype(args.output):
        raise UsageError(f'--stems: {args.output} would clip them; give a file that ends in .wav')
    loaded = scene.load(args.scene) if args.scene else None
    settings = loaded.settings('sound') if loaded else SoundSettings()
    if args.rate:
        settings = dataclasses.replace(settings, sample_rate=round(args.rate))
    with Progress('reading triggers and sounds'):
        voices, table = _voices(args, settings, loaded)
    rows, grains = voices.rows, max(map(len, voices.banks))
    told = ~(voices.times_s >= (args.seconds or math.inf))  # one without a time is refused
    count = int(told.sum())
    rate = settings.sample_rate
    end_s = float((rows['time_s'] + rows['length'] / rate).max()) if len(rows) else 0.0
    frames = math.ceil((args.seconds or end_s + TAIL_S + settings.room_s) * rate)
    mixer = new_mixer(settings, table=table)
    channels = settings.channels
    peak, energy = _write(args.output, mixer, rows, frames)
    plain = dataclasses.replace(settings, governor_db=0.0, ceiling_db=STEM_CEILING_DB)
    stems = _stems(args.output, args.stems, voices)
    for path, mine in stems.items():
        _write(path, new_mixer(plain, table=table), rows[mine], frames)
    state = mixer.state[0]
    why = {name: int(((voices.refused == k) & told).sum()) for k, name in enumerate(REFUSALS) if k}
    del voices  # the rows read its banks to the end
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
        'stems': list(stems),
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


def _write(path, mixer, rows, frames) -> tuple[float, float]:
    """Render voices (n,) VOICE to a file; return the peak and the sum of squares."""
    import numpy as np

    from eol_ros.analysis.sound import BLOCK
    from eol_ros.core.sound.offline import play
    from eol_ros.verbs.progress import track

    peak, energy = 0.0, 0.0
    with writer(path, int(mixer.sample_rate), mixer.channels) as file:
        blocks = play(mixer, rows, frames, BLOCK)
        for block in track(blocks, f'rendering {Path(path).name}', math.ceil(frames / BLOCK)):
            file.write(block)
            peak = max(peak, float(np.abs(block).max()))
            energy += float(np.square(block, dtype=np.float64).sum())
    return peak, energy


def _stems(output: str, by: str | None, voices) -> dict:
    """Return the path of each stem with a mask (n,) of its voices."""
    if by == 'blocks':
        numbers = sorted(set(voices.blocks.tolist()))
        found = {f'block{k:02d}' if k >= 0 else 'other': voices.blocks == k for k in numbers}
    else:
        paths = sorted(set(voices.sounds.tolist())) if by else []
        found = {
            f'sound{k:02d}-{Path(path).stem}': voices.sounds == path for k, path in enumerate(paths)
        }
    whole = Path(output)
    return {str(whole.with_stem(f'{whole.stem}-{name}')): mine for name, mine in found.items()}


def _remedy(why: str, corpus: str | None, grains: int) -> str:
    """Return what is wrong with triggers that were dropped, and what to do."""
    from eol_ros.core.sound.triggers import MAX_GAIN, MAX_RATE, MIN_RATE

    return {
        'no_such_grain': f'name no grain of {corpus or "the corpus of the bag"}, which has 0 to '
        f'{grains - 1}: give the corpus that they were made with',
        'bad_number': f'have a number out of range: gain 0 to {MAX_GAIN:g}, rate {MIN_RATE:g} to '
        f'{MAX_RATE:g}, pan -1 to 1, attack and release from 0 s on',
        'too_short': 'are of grains shorter than 4 samples: cut longer ones with `eol corpus`',
        'too_many': 'came with thousands of others at once: spread them over time',
    }[why]


def _decibels(amplitude: float) -> float:
    return round(20 * math.log10(max(amplitude, 1e-6)), 2)


def _voices(args, settings, loaded):
    """Return the `analysis.sound.Voices` of what is to be played, and the table."""
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
            return sound.voices(bag, settings), table
        triggers, _ = sound.bag_triggers(bag, settings)
    bank, files, file = _bank(args.corpus, settings.sample_rate)
    rows, blocks, sounds, refused = sound.voiced(
        Voicing(settings, table), triggers, bank, files, file
    )
    found = sound.Voices(rows, blocks, sounds, triggers['time_s'], refused, [bank])
    return found, table


def _bank(path: str, sample_rate: int):
    from eol_ros.devices.audio.bank import load_bank
    from eol_ros.devices.corpus.corpus_file import load
    from eol_ros.settings import DESCRIPTORS

    corpus = load(Path(path))
    grains = corpus.grains
    files = [source.path for source in corpus.sources]
    told = {name: grains[name].astype('f4') for name in DESCRIPTORS}  # as nodes do
    file, start, duration = (grains[name] for name in ('file', 'start_s', 'duration_s'))
    bank = load_bank(files, file, start, duration, sample_rate, descriptors=told)
    return bank, list(map(str, files)), file


def _subtype(path: str) -> str | None:
    """Return FLOAT where the format of the file has it; raise UsageError for an unknown format."""
    import soundfile

    kind = Path(path).suffix.lstrip('.').upper()
    if kind not in soundfile.available_formats():
        raise UsageError(f'{path}: the ending names the format; give .wav, .flac or .ogg')
    return 'FLOAT' if soundfile.check_format(kind, 'FLOAT') else None


@contextlib.contextmanager
def writer(path: str, sample_rate: int, channels: int):
    """Open the file to write; 32-bit float where the format has it, so that no bit is lost.

    Raises ConfigError where it cannot be opened, or a block not be written; what else the caller
    meets meanwhile is not its fault.
    """
    import soundfile

    from eol_ros.devices.audio.audio_file import without_time

    subtype = _subtype(path)
    folders.check_writable(path, '--output')
    try:
        file = soundfile.SoundFile(os.fsencode(path), 'w', sample_rate, channels, subtype=subtype)
        with without_time(file):
            yield file
    except soundfile.LibsndfileError as error:  # it names no reason: any is a system error
        raise ConfigError(f'{path}: cannot be written ({error}); is its disk full?') from None
