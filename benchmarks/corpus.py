# SPDX-License-Identifier: Apache-2.0
"""eol bench corpus: descriptors against librosa and essentia, the layout, the selection."""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import tell
from eol_ros.core.geometry import rest_lattice
from eol_ros.core.sound import descriptors, layout, segments
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.ice import ice
from eol_ros.core.sound.select import Selector
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_file
from eol_ros.errors import EolError
from eol_ros.settings import GrainsSettings
from eol_ros.verbs.progress import track

HELP = 'Measure descriptors (error, speed, peers), layout (order, time) and selection (time).'
EXAMPLES = [
    'eol bench corpus --json',
    'eol bench corpus /usr/share/sonic-pi/samples --grain 0.25',
]
HOPS = (64, 128, 256, 512, 1024)
COUNTS = (160, 400, 600, 1024, 2048)
NOISE_M = 2e-5  # of a block's position, on clean images


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('sounds', nargs='*', help='files or folders; none: the ice recording')
    parser.add_argument('--grain', type=float, default=0.25, metavar='S')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--table-seconds', type=float, default=120.0, help='of the twin, per row')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    sounds = [read for word in args.sounds for read in _read(Path(word))]
    if not sounds:
        sounds = [audio_file.Sound('ice', ice(40.0, 48000, args.seed), 48000, 1)]
    results = {
        'descriptors': measure_descriptors(sounds, args.grain),
        'hop': measure_hops(sounds, args.grain),
        'layout': [measure_layout(n, args.seed) for n in COUNTS],
        'selection': [measure_selection(n, args.seed) for n in (160, 600, 2000)],
        'slips': [measure_slips(args.table_seconds, fps, args.seed) for fps in (60.0, 120.0)],
    }
    tell(results, args.json, table)
    return 0


def _read(path: Path) -> list[audio_file.Sound]:
    found = []
    for file in corpus_file.sounds_of(path):
        try:
            found.append(audio_file.read_mono(file))
        except EolError as error:
            print(f'left out: {error}', file=sys.stderr)
    return found


def measure_descriptors(sounds: list[audio_file.Sound], grain_s: float) -> dict[str, Any]:
    """Return speed, and the difference from librosa and essentia over every sounding grain.

    Grains shorter than a frame, which the peers do not define, are not compared; nor are grains
    with an empty frame, which librosa counts and the definition skips.
    """
    rows: dict[str, list[float]] = {'centroid': [], 'flatness': [], 'rolloff': []}
    ours, theirs = [], []
    spent = {'eol': 0.0, 'librosa': 0.0, 'essentia': 0.0}
    peers = {'librosa': _imported('librosa'), 'essentia': _imported('essentia.standard')}
    for sound in track(sounds, 'descriptors'):
        cuts = segments.chop(len(sound.samples), sound.rate, grain_s)
        began = time.process_time()
        grains, silent = descriptors.analyse(sound.samples, sound.rate, cuts)
        spent['eol'] += time.process_time() - began
        for (a, b), grain, quiet in zip(cuts, grains, silent, strict=True):
            part = sound.samples[a:b]
            if quiet or len(part) < descriptors.YIN_FRAME:
                continue
            if peers['librosa']:
                began = time.process_time()
                spectrum = _librosa(peers['librosa'], part, sound.rate)
                spent['librosa'] += time.process_time() - began
                if spectrum is not None:
                    names = ('centroid_mean_hz', 'flatness', 'rolloff95_hz')
                    for row, name, value in zip(rows.values(), names, spectrum, strict=False):
                        row.append(abs(grain[name] / value - 1))
            if peers['essentia']:
                began = time.process_time()
                theirs.append(_essentia(peers['essentia'], part, sound.rate))
                spent['essentia'] += time.process_time() - began
                ours.append(grain['periodicity_mean'])
    seconds = sum(s.duration_s for s in sounds)
    result: dict[str, Any] = {'sounds': len(sounds), 'seconds': round(seconds, 1)}
    result['times_real_time'] = {k: round(seconds / v, 1) for k, v in spent.items() if v}
    for name, row in rows.items():
        if row:
            result[f'{name}_relative_difference'] = {'grains': len(row), 'worst': float(max(row))}
    if ours:
        off = np.abs(np.subtract(ours, theirs))
        result['periodicity_difference'] = {
            'grains': len(ours),
            'mean': float(off.mean()),
            'worst': float(off.max()),
            'pearson': float(np.corrcoef(ours, theirs)[0, 1]),
        }
    return result


def _imported(name: str):
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError:
        print(f'{name.split(".")[0]} is not installed: no comparison with it', file=sys.stderr)
        return None


def _librosa(librosa, part, rate):
    frame = {'n_fft': descriptors.FRAME, 'hop_length': descriptors.HOP, 'center': False}
    magnitude = np.abs(librosa.stft(part, **frame))
    if (magnitude.sum(axis=0) < descriptors.SILENT_SUM).any():
        return None
    feature = librosa.feature
    return (
        feature.spectral_centroid(S=magnitude, sr=rate).mean(),
        feature.spectral_flatness(S=magnitude).mean(),
        feature.spectral_rolloff(S=magnitude, sr=rate, roll_percent=0.95).mean(),
    )


def _essentia(essentia, part, rate):
    size, hop = descriptors.YIN_FRAME, descriptors.HOP
    pitch_yin = essentia.PitchYin(
        frameSize=size, sampleRate=rate, minFrequency=40, maxFrequency=4000, tolerance=0.15
    )
    frames = [part[i : i + size].copy() for i in range(0, len(part) - size + 1, hop)]
    return np.mean([pitch_yin(frame)[1] for frame in frames])


def measure_hops(sounds: list[audio_file.Sound], grain_s: float) -> list[dict[str, float]]:
    """Return error against run time of the step between frames; the finest is the reference."""
    some = sounds[:12]
    found, reference = [], None
    kept = descriptors.HOP
    try:
        for hop in HOPS:
            descriptors.HOP = hop
            began, rows = time.process_time(), []
            for sound in some:
                cuts = segments.chop(len(sound.samples), sound.rate, grain_s)
                grains, silent = descriptors.analyse(sound.samples, sound.rate, cuts)
                rows.append(grains[['centroid_mean_hz', 'periodicity_mean']][~silent])
            took_s = time.process_time() - began
            values = np.concatenate(rows)
            reference = values if reference is None else reference
            octaves = np.log2(values['centroid_mean_hz'] / reference['centroid_mean_hz'])
            off = values['periodicity_mean'] - reference['periodicity_mean']
            found.append(
                {
                    'hop': hop,
                    'cpu_s': round(took_s, 3),
                    'centroid_rms_octaves': float(np.sqrt(np.mean(octaves**2))),
                    'periodicity_rms': float(np.sqrt(np.mean(off**2))),
                }
            )
    finally:
        descriptors.HOP = kept
    return found


def measure_layout(n: int, seed: int) -> dict[str, float]:
    """Return time and order kept of `n` grains whose two descriptors correlate by 0.5."""
    from scipy.stats import kendalltau

    random = np.random.default_rng(seed)
    x, y = random.multivariate_normal([0, 0], [[1, 0.5], [0.5, 1]], n).T
    began = time.process_time()
    places = layout.arrange(x, y, ('flatness', 'rms_db'))
    took_s = time.process_time() - began
    side = np.diff(np.sort(np.unique(places[:, 1]))).min(initial=1.0)
    spread = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2) + 9 * np.eye(n))
    return {
        'grains': n,
        'cpu_s': round(took_s, 4),
        'kendall_tau_x': float(kendalltau(x, places[:, 0])[0]),
        'kendall_tau_y': float(kendalltau(y, places[:, 1])[0]),
        'empty_cells': int(n - len(np.unique(places, axis=0))),
        'nearest_over_spacing': float(spread.min() / side),
    }


def measure_selection(n: int, seed: int) -> dict[str, float]:
    """Return the time of one image, all blocks at rest and all moving, with `n` grains."""
    random = np.random.default_rng(seed)
    grains = np.zeros(n, GRAIN)
    grains['x'], grains['y'] = layout.lattice(n).T
    grains['duration_s'] = 0.25
    corpus = Corpus((Source('', 48000, 1.0, ''),), grains)
    result: dict[str, float] = {'grains': n}
    for name, pace in (('still', 0.0), ('moving', 0.003)):
        selector = Selector(GrainsSettings(), corpus)
        at = rest_lattice()
        times, count = [], 0
        for i in range(1200):
            at = np.clip(at + pace * random.standard_normal((25, 2)), -0.6, 0.6)
            x, y = at.T.copy()
            began = time.thread_time()
            found = selector.update(i / 60, x, y, np.ones(25, bool), np.full(25, 2e-5))
            times.append(time.thread_time() - began)
            count += len(found)
        result[f'{name}_us_p50'] = round(float(np.median(times)) * 1e6, 1)
        result[f'{name}_us_p99'] = round(float(np.percentile(times, 99)) * 1e6, 1)
        result[f'{name}_triggers_per_s'] = round(count / 20.0, 1)
    return result


def measure_slips(seconds: float, fps: float, seed: int) -> dict[str, float]:
    """Return how many slips of the twin sound, and from true onset to the stamp of the image, ms.

    Settings and grains that ship; positions carry the noise of the tracker.
    """
    from benchmarks.sound_rehearsal import Twin

    grains = np.zeros(160, GRAIN)
    grains['x'], grains['y'] = layout.lattice(160).T
    grains['duration_s'] = 0.25
    selector = Selector(GrainsSettings(), Corpus((Source('', 48000, 40.0, ''),), grains))
    twin, random = Twin(seed), np.random.default_rng(seed)
    begun, sounded = [], []
    for _ in range(round(seconds * fps)):
        begun += twin.step(1 / fps)
        xy = np.stack([twin.table.x, twin.table.y]) + random.normal(0, NOISE_M, (2, 25))
        found = selector.update(twin.play.time_s, *xy, np.ones(25, bool), np.full(25, NOISE_M))
        sounded += [(int(row['block']), twin.play.time_s) for row in found]
    waits = []
    for at_s, block in begun:
        after = [s - at_s for b, s in sounded if b == block and 0 <= s - at_s < 0.25]
        waits += [1e3 * min(after)] if after else []
    p50, p99 = np.percentile(waits, [50, 99])
    return {
        'images_per_s': fps, 'slips': len(begun), 'sounded_percent': 100 * len(waits) / len(begun),
        'wait_ms_p50': float(p50), 'wait_ms_p99': float(p99), 'wait_ms_most': max(waits),
    }  # fmt: skip


def table(results: dict[str, Any]) -> str:
    """Return the figures for people."""
    lines = ['descriptors']
    for name, value in results['descriptors'].items():
        lines.append(f'  {name:32} {_words(value)}')
    for name in ('hop', 'layout', 'selection', 'slips'):
        rows = results[name]
        lines += [name, '  ' + ''.join(f'{key:>24}' for key in rows[0])]
        lines += ['  ' + ''.join(f'{_number(v):>24}' for v in row.values()) for row in rows]
    return '\n'.join(lines)


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return ', '.join(f'{k} {_number(v)}' for k, v in value.items())
    return _number(value)


def _number(value: float) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
