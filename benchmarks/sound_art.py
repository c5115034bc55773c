# SPDX-License-Identifier: Apache-2.0
"""How deep the sound of a rehearsal is: loudness by area, lows, range, latency; before and after.

The twin's table is played by its visitors, its places get the tracker's noise, and the nodes' own
classes make slips, cascades and triggers of them, which `eol render`'s mixer plays: with the
settings of the shipped rehearsal, and with all that hangs on the size of a rupture off. A cascade's
loudness is the greatest momentary loudness (0.4 s) of its grains rendered alone, so that no tail of
the one before is in it.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.twin_slips import NOISE_M, Rehearsal
from eol_ros import scene as scenes
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.motion.cascades import CascadeEvent
from eol_ros.core.motion.motion import Motion
from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.corpus import Corpus
from eol_ros.core.sound.loudness import integrated_lufs, loudness_range, windows_lufs
from eol_ros.core.sound.offline import play
from eol_ros.core.sound.select import Selector
from eol_ros.core.sound.voicing import OFF_DB, Voicing, new_mixer
from eol_ros.settings import GrainsSettings, MotionSettings, SoundSettings

FPS = 60.0
CLASSES = ((1, 1), (2, 4), (5, 8), (9, 15), (16, 25))  # areas
OF_A_CLASS = 40  # cascades rendered alone, evenly through the run
LOW_HZ = 120.0
AFTER_S = 1.0
FIRST_S = 0.05
LATENCY_DB = -60.0
COST_S = 1.5
PARTS: dict[str, dict[str, Any]] = {  # what switches each part off
    'slower': {'rate_scaling': 0.0},
    'darker': {'corner_hz': 0.0},
    'thinner': {'low_corner_hz': 0.0},
    'dynamics': {'dynamics_db': 0.0, 'onset_duck_db': 0.0},
    'sub': {'sub_db': OFF_DB},
    'room': {'room_s': 0.0},
}
FILTER = {'filter': 'low-pass', 'filter_by': 'area', 'filter_octaves': -2.0}  # off as shipped
RATE = 48000
FILTERS = tuple(
    (hz, q, band)
    for hz in (20, 100, 500, 2000, 9000, 21600)
    for q in (0.5, 0.7071, 20)
    for band in (False, True)
)
OFF: dict[str, Any] = {key: value for part in PARTS.values() for key, value in part.items()}


@dataclass(frozen=True)
class Played:
    """A rehearsal: triggers (n,) TRIGGER, cascades, and which grains were reached and sounded."""

    seconds: float
    triggers: np.ndarray
    cascades: list[CascadeEvent]
    reached: np.ndarray
    sounded: np.ndarray


def rehearse(seconds: float, corpus: Corpus, settings: GrainsSettings, seed: int) -> Played:
    """Play the twin for `seconds` of its time."""
    rehearsal = Rehearsal(seed, FPS)
    random = np.random.default_rng([seed, 17])
    motion, selector = Motion(MotionSettings()), Selector(settings)
    selector.load(corpus)
    seen, sigma = np.ones(N_BLOCKS, bool), np.full(N_BLOCKS, NOISE_M)
    triggers, cascades = [], []
    reached = np.zeros(len(corpus), bool)
    left, low, right, high = selector.bounds
    x = left + corpus.grains['x'] * (right - left)
    y = low + corpus.grains['y'] * (high - low)
    for stamp_s in rehearsal.images(round(seconds * FPS)):
        xy = np.stack([rehearsal.table.x, rehearsal.table.y], 1)
        xy = xy + random.normal(0, NOISE_M, xy.shape)
        cascades += motion.update(stamp_s, *xy.T, seen, sigma)[1]
        triggers.append(selector.update(stamp_s, *xy.T, seen, sigma))
        for block in np.flatnonzero(selector.moving):
            reached |= np.hypot(x - xy[block, 0], y - xy[block, 1]) <= settings.radius
    made = np.concatenate(triggers)
    sounded = np.zeros(len(corpus), bool)
    sounded[made['grain'][made['block'] >= 0]] = True
    return Played(seconds, made, cascades, reached, sounded)


def render(triggers: np.ndarray, bank: Bank, settings: SoundSettings, seconds: float) -> np.ndarray:
    """Return `seconds` of what the node sound makes of triggers, (n, channels) f4."""
    voicing, mixer = Voicing(settings), new_mixer(settings)
    rows, _ = voicing.rows(triggers, bank)
    rows['time_s'] += settings.latency_s
    frames = round(seconds * settings.sample_rate)
    return np.concatenate(list(play(mixer, rows, frames, 4096)))


def grains_of(played: Played, cascade: CascadeEvent) -> np.ndarray:
    """Return the triggers of a cascade, their times from its onset on."""
    t = played.triggers
    since_s = t['time_s'] - cascade.onset_s
    mine = (since_s > -2 / FPS) & (since_s <= cascade.duration_s)
    mine &= np.isin(t['block'], cascade.blocks)
    found = t[mine]
    found['time_s'] -= cascade.onset_s - 2 / FPS
    return found


def of_area(
    played: Played, bank: Bank, settings: SoundSettings, least: int, most: int
) -> dict[str, Any]:
    """Return the medians over cascades of these areas."""
    rate = settings.sample_rate
    of_class = [c for c in played.cascades if least <= c.area <= most]
    every = max(1, len(of_class) // OF_A_CLASS)
    loud, lows, firsts = [], [], []
    for cascade in of_class[::every][:OF_A_CLASS]:
        grains = grains_of(played, cascade)
        if not len(grains):
            continue
        out = render(grains, bank, settings, cascade.duration_s + AFTER_S)
        if not out.any():
            continue
        loud.append(float(windows_lufs(out, rate, 0.4).max()))
        lows.append(low_share(out, rate))
        begin = np.flatnonzero(np.abs(out).max(axis=1) > 0)[0]
        size = round(FIRST_S * rate)
        energy = np.square(out[begin:].astype(float)).sum(axis=1)
        energy = np.concatenate([energy, np.zeros(-len(energy) % size)]).reshape(-1, size).sum(1)
        firsts.append(10 * np.log10(energy[0] / energy.max()))
    middle = [float(np.median(v)) if v else float('nan') for v in (loud, lows, firsts)]
    return {
        'areas': [least, most], 'cascades': len(of_class), 'momentary_lufs': middle[0],
        'below_120_hz': middle[1], 'first_50_ms_db': middle[2],
    }  # fmt: skip


def low_share(out: np.ndarray, rate: float) -> float:
    """Return the share of the energy below LOW_HZ."""
    from scipy.signal import butter, sosfilt

    sos = butter(6, LOW_HZ / (rate / 2), output='sos')
    low = sum(float(np.square(sosfilt(sos, c)).sum()) for c in out.T)
    return low / float(np.square(out.astype(float)).sum())


def onset_frame(played: Played, bank: Bank, settings: SoundSettings) -> int:
    """Return the frame at which the first grain of a block is LATENCY_DB below its own peak."""
    first = played.triggers[played.triggers['block'] >= 0][:1].copy()
    first['time_s'] = 0.1
    out = np.abs(render(first, bank, replace(settings, room_s=0.0), 1.0)).max(axis=1)
    return int(np.flatnonzero(out > 10 ** (LATENCY_DB / 20) * out.max())[0])


def figures(played: Played, bank: Bank, settings: SoundSettings) -> tuple[dict, np.ndarray]:
    """Return the figures of the whole run and of each class of areas; and the sound."""
    rate = settings.sample_rate
    out = render(played.triggers, bank, settings, played.seconds)
    classes = [of_area(played, bank, settings, *areas) for areas in CLASSES]
    momentary = windows_lufs(out, rate, 0.4)
    return {
        'lra_lu': loudness_range(windows_lufs(out, rate, 3.0)),
        'integrated_lufs': integrated_lufs(momentary),
        'peak_dbfs': 20 * float(np.log10(max(np.abs(out).max(), 1e-9))),
        'single_to_rupture_lu': classes[-1]['momentary_lufs'] - classes[0]['momentary_lufs'],
        'areas': classes, 'onset_frame': onset_frame(played, bank, settings),
    }, out  # fmt: skip


def through_filter(x: np.ndarray, hz: float, q: float, band: bool) -> np.ndarray:
    """Return `x` (n,) f4 through the mixer's filter of a grain."""
    from eol_ros.core.sound.grain_filter import TABLE, design, run, tuned
    from eol_ros.core.sound.lanes import WIDTH

    table, out = np.empty(TABLE, np.float32), np.empty(len(x) + WIDTH, np.float32)
    padded = np.concatenate([x, np.zeros(WIDTH, np.float32)])
    design(table, float(tuned(np.array([hz]), RATE)[0]), 1 / q, int(band))
    run(out.ctypes.data, padded.ctypes.data, len(x), table)
    return out[: len(x)]


def filter_error_db(hz: float, q: float, band: bool) -> float:
    """Return the error of the filter on noise against SciPy in double precision."""
    from benchmarks.sound_reference import filtered, snr_db

    x = np.random.default_rng(1).standard_normal(8000).astype(np.float32) * np.float32(0.1)
    return -float(snr_db(through_filter(x, hz, q, band), filtered(x, hz, q, band, RATE)))


def cost(sound: SoundSettings, seconds: float, repeats: int) -> list[dict[str, Any]]:
    """Return what the mixer can sound at once without any part, with each alone, and with all.

    Grains of all areas alike, 400 at once and cubic; the ring has 8 loudspeakers at various
    distances. GrainBuf plays grains of the same density in the same run.
    """
    import tempfile

    import soundfile

    from benchmarks.sound_engine import FS, make_score, source, speed
    from benchmarks.sound_peers import PEERS

    ring = tuple(f'{k} {45 * k} {2 + 0.1 * k}' for k in range(8))
    parts: dict[str, dict[str, Any]] = {
        name: {key: getattr(sound, key) for key in part} for name, part in PARTS.items()
    }
    on = {key: value for part in parts.values() for key, value in part.items()}
    plain = replace(sound, **OFF, speakers=(), channels=2, sub_output=False)
    cases = {
        'none': {},
        **parts,
        'filter of each grain': FILTER,
        'ring of 8': {'speakers': ring, 'channels': 8},
        'all but filter, ring': on,
        'all but ring': on | FILTER,
    }
    source_sound, score = source(), make_score(400, seconds, False)
    areas = np.random.default_rng(3).integers(1, N_BLOCKS + 1, len(score.triggers))
    best: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        soundfile.write(Path(folder) / 'source.wav', source_sound, FS, subtype='FLOAT')
        grain_buf, _, _, there = PEERS['scsynth GrainBuf']
        for _ in range(repeats):  # in turn, so that all see the machine alike
            for name, changes in cases.items():
                settings = replace(plain, **changes)
                row = speed(source_sound, score, 256, True, 1, settings, areas)
                best[name] = max(best.get(name, 0.0), row['voices_per_core'])
            for block in (64, 256) if there() else ():
                voices = score.grain_seconds / grain_buf(Path(folder), score, block)[0]
                best['GrainBuf'] = max(best.get('GrainBuf', 0.0), voices)
    peer = best.pop('GrainBuf', None)
    rows = [
        {
            'part': name, 'voices_per_core': voices, 'ns_per_voice_sample': 1e9 / FS / voices,
            'share': best['none'] / voices - 1, 'to_grain_buf': peer and voices / peer,
        }
        for name, voices in best.items()
    ]  # fmt: skip
    return [*rows, {'part': 'scsynth GrainBuf', 'voices_per_core': peer}] if peer else rows


def measure(
    seconds: float, repeats: int = 3, seed: int = 1, plot: Path | None = None
) -> dict[str, Any]:
    """Return the figures of the shipped rehearsal, of the same with everything off, and costs."""
    from eol_ros.devices.audio.bank import load_bank
    from eol_ros.devices.corpus.corpus_build import apart
    from eol_ros.devices.corpus.loader import corpus_spec

    scene = scenes.load('rehearsal')
    grains, sound = scene.settings('grains'), scene.settings('sound')
    corpus = apart(*corpus_spec(grains))
    g = corpus.grains
    files = [source.path for source in corpus.sources]
    bank = load_bank(files, g['file'], g['start_s'], g['duration_s'], sound.sample_rate)
    played = rehearse(seconds, corpus, grains, seed)
    plain = replace(played, triggers=played.triggers[played.triggers['block'] >= 0])
    before, old = figures(plain, bank, replace(sound, **OFF))
    after, new = figures(played, bank, sound)
    if plot:
        from benchmarks.sound_plot import draw_art

        draw_art({'everything off': old, 'as shipped': new}, sound.sample_rate, plot)
    return {
        'seconds': seconds, 'seed': seed, 'grains_reached': int(played.reached.sum()),
        'grains_sounded': int((played.reached & played.sounded).sum()),
        'creaks': int((played.triggers['block'] < 0).sum()), 'off': before, 'on': after,
        'filter_error_db': {
            str(hz): max(filter_error_db(*f) for f in FILTERS if f[0] == hz)
            for hz in sorted({f[0] for f in FILTERS})
        },
        'cost': cost(sound, min(seconds, COST_S), repeats),
    }  # fmt: skip
