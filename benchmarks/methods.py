# SPDX-License-Identifier: Apache-2.0
"""eol bench methods: error against run time of methods that no other benchmark draws.

Clocks, onsets, calibration, layout, pitch, power-law fits, the limiter: each against a truth made
in code or a formula, with what it costs, beside what one would else take.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter
from support.clutter import clutter_calibration
from support.paper import rest_lattice

from benchmarks import method_parts, plots
from benchmarks.machine import headed, machine, tell
from benchmarks.method_parts import Curve, milliseconds, rms
from eol_ros.core.clock_sync import ClockSync
from eol_ros.core.motion import onset
from eol_ros.core.played_clock import PlayedClock
from eol_ros.core.science import powerlaw
from eol_ros.core.sound import descriptors, layout, loudness
from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.vision.calibration import calibrate
from eol_ros.lab.science import spectra
from eol_ros.verbs.progress import track

HELP = 'Measure error against run time of clocks, onsets, layout, pitch, fits, loudness and others.'
EXAMPLES = [
    'eol bench methods',
    'eol bench methods --part onset --part calibration --json',
    'eol bench methods --markdown --plots docs/img > methods.md',
]


def board_clock(seed: int, seconds: float = 600.0) -> Curve:
    """A board's crystal, 40 ppm off and drifting, asked once a second over a USB line."""
    rng = np.random.default_rng([1, seed])
    sent = np.arange(0.0, seconds, 1.0)
    out, back = (1e-4 + rng.exponential(3e-4, len(sent)) for _ in range(2))

    def board_s(host: np.ndarray) -> np.ndarray:
        return 12.5 + host * (1 + 40e-6) + 20e-6 * 300 * np.sin(host / 300)

    read_us = np.floor(board_s(sent + out) * 1e6).astype(np.int64)
    asked = sent[60:] + 0.6
    asked_us = np.floor(board_s(asked) * 1e6).astype(np.int64)

    def ours(window: int) -> list[float]:
        clock, found = ClockSync(window), []
        for k, at in enumerate(sent):
            clock.add(at, int(read_us[k]), at + out[k] + back[k])
            if k >= 60:
                found.append(clock.to_host(int(asked_us[k - 60])).time_s - asked[k - 60])
        return found

    def newest() -> list[float]:
        middle = sent + (out + back) / 2
        return [
            middle[k] + (asked_us[k - 60] - read_us[k]) * 1e-6 - asked[k - 60]
            for k in range(60, len(sent))
        ]

    def line() -> list[float]:
        middle, found = sent + (out + back) / 2, []
        for k in range(60, len(sent)):
            fit = np.polyfit(read_us[k - 59 : k + 1] * 1e-6 - read_us[k] * 1e-6,
                             middle[k - 59 : k + 1], 1)  # fmt: skip
            at = (asked_us[k - 60] - read_us[k]) * 1e-6
            found.append(fit[0] * at + fit[1] - asked[k - 60])
        return found

    curve = Curve(
        'board clock', 'simulation: 40 ppm, drift 20 ppm, delays from 0.1 ms',
        'µs RMS', 'exchange', 'window 64',
        'half the shortest round trip: 100 µs',
        'constant asymmetry of the delays', every=True,
    )  # fmt: skip
    for window in (2, 4, 16, 64, 256):
        took = milliseconds(lambda w=window: ours(w), 2) / len(sent)
        curve.points.append((f'window {window}', took, rms(ours(window)) * 1e6))
    for name, work in (('newest exchange', newest), ('least squares of 60', line)):
        curve.peers.append((name, milliseconds(work, 2) / len(sent), rms(work()) * 1e6))
    return curve


def replay_clock(seed: int) -> Curve:
    """Recorded time on /clock, 100 a second, at a rate of 0.7, each message late by chance."""
    rng = np.random.default_rng([2, seed])
    recorded = np.arange(0, 3_000_000_000, 10_000_000)
    true_ns = recorded / 0.7
    late = rng.exponential(1.5e6, len(recorded)) + 2e7 * (rng.uniform(size=len(recorded)) < 0.02)
    heard = (true_ns + late).astype(np.int64)

    def ours() -> list[float]:
        clock, found = PlayedClock(), []
        for k, stamp in enumerate(recorded):
            clock.take(int(stamp), int(heard[k]))
            if k > 70:
                found.append(clock.wall_ns(int(stamp) + 5_000_000) - (stamp + 5e6) / 0.7)
        return found

    def newest() -> list[float]:
        return [heard[k] + 5e6 - (recorded[k] + 5e6) / 0.7 for k in range(71, len(recorded))]

    def line() -> list[float]:
        found = []
        for k in range(71, len(recorded)):
            x, y = recorded[k - 63 : k + 1] - recorded[k], heard[k - 63 : k + 1] - heard[k]
            fit = np.polyfit(x, y, 1)
            found.append(heard[k] + fit[0] * 5e6 + fit[1] - (recorded[k] + 5e6) / 0.7)
        return found

    curve = Curve(
        'replay clock', 'simulation: random delays of 1.5 ms, 2 % with 20 ms more',
        'ms RMS', 'message', '64 messages', 'smallest delay of five: 0.3 ms',
        'changes of pace below 25 ms are found late',
    )  # fmt: skip
    curve.points.append(('64 messages', milliseconds(ours, 2) / len(recorded), rms(ours()) * 1e-6))
    for name, work in (('newest message', newest), ('least squares of 64', line)):
        curve.peers.append((name, milliseconds(work, 2) / len(recorded), rms(work()) * 1e-6))
    return curve


def onsets(seed: int, count: int = 400) -> Curve:
    """Blocks that break loose at a true moment, seen 60 times a second with 20 µm of noise."""
    from scipy.optimize import curve_fit

    rng = np.random.default_rng([3, seed])
    period, sigma = 1 / 60, 20e-6
    true = rng.uniform(0.1, 0.1 + period, count)
    pull = onset.ACCELERATION_MPS2 * rng.normal(1.0, onset.ACCELERATION_SPREAD, count)

    def paths(after: int) -> tuple[np.ndarray, np.ndarray]:
        times = np.arange(6 + after) * period + 0.1 - 5 * period
        since = np.maximum(times - true[:, None], 0)
        w = 12.6  # a block of 0.25 kg on springs of 40 N/m
        path = pull[:, None] / w**2 * (1 - np.cos(np.minimum(w * since, np.pi)))
        noise = np.random.default_rng([4, seed]).normal(0, sigma, path.shape)
        return np.broadcast_to(times, path.shape).copy(), path + noise

    curve = Curve(
        'slip onset', 'simulation: 40 N/m, 20 µm noise, 60 images/s',
        'ms RMS', 'slip', '3 images',
        'threshold on images: period/sqrt(12) = 4.8 ms',
        'a rim that adds force faster than friction drops',
    )  # fmt: skip
    noise = np.full(count, sigma)
    for after in (1, 2, 3, 4, 6, 10):
        times, path = paths(after)
        found = onset.onsets(times, path, noise, period)[0]
        took = milliseconds(lambda t=times, p=path: onset.onsets(t, p, noise, period)) / count
        curve.points.append((f'{after} images', took, rms(found - true) * 1e3))
    times, path = paths(3)

    def threshold() -> np.ndarray:
        first = np.argmax(path > 5 * sigma, axis=1)
        way_s = np.sqrt(2 * 5 * sigma / onset.ACCELERATION_MPS2)  # to the threshold
        return times[np.arange(count), first] - way_s - period / 2

    def parabola() -> np.ndarray:
        def shape(t: np.ndarray, t0: float, a: float) -> np.ndarray:
            return 0.5 * a * np.maximum(t - t0, 0) ** 2

        return np.array(
            [
                curve_fit(shape, t, p, (0.1 + period / 2, 2.5), maxfev=2000)[0][0]
                for t, p in zip(times, path, strict=True)
            ]
        )

    for name, work in (('threshold', threshold), ('SciPy curve_fit, 3 images', parabola)):
        curve.peers.append((name, milliseconds(work, 1) / count, rms(work() - true) * 1e3))
    return curve


def calibration(seed: int) -> Curve:
    """Corners of covers at 0.05 px, blocks 4 mm off their lattice, a tilted camera with a lens."""
    import cv2

    truth = clutter_calibration('ordinary')
    start = calibrate.nominal(1280, 800, truth.camera_matrix[0, 0])
    ids = np.arange(25)

    def view(k: int) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng([5, seed, k])
        poses = np.column_stack(
            [rest_lattice() + rng.normal(0, calibrate.REST_SIGMA_M, (25, 2)),
             rng.normal(0, 0.05, 25)]
        )  # fmt: skip
        half = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * 0.042
        c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        x, y = half.T
        corners = np.stack(
            [poses[:, :1] + c * x - s * y, poses[:, 1:2] + s * x + c * y], axis=-1
        ).reshape(-1, 2)
        px = truth.to_pixels(corners) + rng.normal(0, 0.05, corners.shape)
        return ids, px.reshape(25, 4, 2)

    grid = np.stack(np.meshgrid(*[np.linspace(-0.6, 0.6, 9)] * 2), axis=-1).reshape(-1, 2)

    def off(found: Any) -> float:
        return rms(found.to_table(truth.to_pixels(grid)) - grid) * 1e3

    curve = Curve(
        'calibration from blocks', 'simulation: tilted camera, lens, blocks 4 mm off',
        'mm RMS', 'solution', '4 images', '4 mm/sqrt(25 n)',
        'one image; relief covers need heights',
    )  # fmt: skip
    for count in (1, 2, 4, 8):
        views = [view(k) for k in range(count)]
        begin = time.process_time()
        found = calibrate.from_blocks(views, start).calibration
        took = (time.process_time() - begin) * 1e3
        label = f'{count} image{"s" if count > 1 else ""}'
        curve.points.append((label, took, off(found)))

    def homography() -> Any:
        px = np.concatenate([view(k)[1].mean(axis=1) for k in range(4)])
        found, _ = cv2.findHomography(np.tile(rest_lattice(), (4, 1)), px)
        return dataclasses.replace(start, homography=found, distortion_coefficients=np.zeros(5))

    curve.peers.append(
        ('OpenCV findHomography, 4 images', milliseconds(homography, 2), off(homography()))
    )
    return curve


def grain_layout(seed: int, n: int = 2048) -> Curve:
    """Clustered grains onto an even lattice: how much further they move than they must."""
    rng = np.random.default_rng([6, seed])
    middles = rng.uniform(size=(12, 2))
    raw = middles[rng.integers(0, 12, n)] + rng.normal(0, 0.06, (n, 2))
    places = np.column_stack([layout.ranked(raw[:, 0]), layout.ranked(raw[:, 1])])

    def moved(to: np.ndarray) -> float:
        return float(((to - places) ** 2).sum())

    before = layout.EXACT_UP_TO
    curve = Curve(
        f'layout of {n} grains', 'exact assignment (SciPy)',
        '% excess distance', 'layout', 'parts of 2048',
        'exact assignment, n^3', 'larger corpora are halved (parts of 1024)',
    )  # fmt: skip
    try:
        exact = moved(layout.even(places))
        for most in (16, 64, 256, 1024, 2048):
            layout.EXACT_UP_TO = most
            took = milliseconds(lambda: layout.even(places), 2)
            more = 100 * (np.sqrt(moved(layout.even(places)) / exact) - 1)
            curve.points.append((f'parts of {most}', took, more))
    finally:
        layout.EXACT_UP_TO = before
    cells = layout.lattice(n)

    def sorted_rows() -> np.ndarray:
        out, rows = np.empty((n, 2)), round(np.sqrt(n))
        order = np.argsort(places[:, 1], kind='stable')
        by_row = np.lexsort((cells[:, 0], cells[:, 1]))
        for part in np.array_split(np.arange(n), rows):
            mine = order[part]
            out[mine[np.argsort(places[mine, 0])]] = cells[by_row[part]]
        return out

    more = 100 * (np.sqrt(moved(sorted_rows()) / exact) - 1)
    curve.peers.append(('sort by rows', milliseconds(sorted_rows), more))
    return curve


def pitch(seed: int) -> Curve:
    """Tones with three partials and noise, 80 to 1200 Hz, in frames of 2048 at 48 kHz."""
    rate, size, count = 48_000, 2048, 300
    rng = np.random.default_rng([7, seed])
    hz = np.exp(rng.uniform(np.log(80), np.log(1200), count))
    t = np.arange(size) / rate
    phase = 2 * np.pi * hz[:, None] * t
    frames = np.sin(phase) + 0.5 * np.sin(2 * phase + 1) + 0.25 * np.sin(3 * phase + 2)
    frames = (frames + rng.normal(0, 0.02, frames.shape)).astype(np.float32)

    def cents(found: np.ndarray) -> np.ndarray:
        return 1200 * np.log2(found / hz)

    lags = descriptors.yin(frames, rate)[1]
    curve = Curve(
        'pitch (YIN)', 'formula: synthetic tones',
        'cents, median', 'frame', 'YIN', 'Cramer-Rao, first partial: 0.05 cents',
        'two simultaneous tones; below 50 Hz',
    )  # fmt: skip
    took = milliseconds(lambda: descriptors.yin(frames, rate)) / count
    curve.points.append(('YIN', took, float(np.nanmedian(abs(cents(rate / lags))))))
    try:
        import librosa
    except ImportError:
        return curve

    def peer() -> np.ndarray:
        return np.array(
            [
                librosa.yin(f, fmin=60, fmax=1500, sr=rate, frame_length=size, center=False)[0]
                for f in frames
            ]
        )

    found = peer()
    curve.peers.append(
        ('librosa.yin', milliseconds(peer, 1) / count, float(np.median(abs(cents(found)))))
    )
    return curve


def timbre(seed: int) -> Curve:
    """Centroid, flatness and roll-off of grains of filtered noise, against librosa in doubles."""
    rate, span, count = 48_000, 12_288, 20
    rng = np.random.default_rng([10, seed])
    grains = [lfilter([1], [1, -k], rng.normal(0, 0.05, span)) for k in rng.uniform(0, 0.95, count)]
    sound = np.concatenate(grains).astype(np.float32)
    cuts = np.arange(count)[:, None] * span + [0, span]
    names = {'centroid_mean_hz': 'centroid', 'flatness': 'flatness', 'rolloff95_hz': 'roll-off'}
    curve = Curve(
        'spectral descriptors', 'librosa, in double precision', '% RMS', 'grain (ours with YIN)',
        'centroid', 'float32: 1e-5 %; doubles: 1e-14 %',
        'roll-off between two bins: one bin is 47 Hz',
    )  # fmt: skip
    try:
        import librosa
    except ImportError:
        return curve

    def peer(dtype: type) -> np.ndarray:
        rows = []
        for first, last in cuts:
            part = sound[first:last].astype(dtype)
            size = np.abs(librosa.stft(part, n_fft=1024, hop_length=256, center=False))
            rows.append(
                [librosa.feature.spectral_centroid(S=size, sr=rate).mean(),
                 librosa.feature.spectral_flatness(S=size).mean(),
                 librosa.feature.spectral_rolloff(S=size, sr=rate, roll_percent=0.95).mean()]
            )  # fmt: skip
        return np.array(rows)

    truth = peer(np.float64)
    found = descriptors.analyse(sound, rate, cuts)[0]
    took = milliseconds(lambda: descriptors.analyse(sound, rate, cuts), 3) / count
    peer_took = milliseconds(lambda: peer(np.float32), 2) / count
    single = peer(np.float32)
    for k, (column, name) in enumerate(names.items()):
        curve.points.append((name, took, 100 * rms(found[column] / truth[:, k] - 1)))
        curve.peers.append(
            (f'librosa, float32, {name}', peer_took, 100 * rms(single[:, k] / truth[:, k] - 1))
        )
    return curve


def tail(seed: int) -> Curve:
    """Sizes drawn from s^-1.6 on 1..25: how far the fitted exponent is off."""
    tau, trials = 1.6, 100
    rng = np.random.default_rng([8, seed])
    counts = (100, 300, 1000, 10_000)
    drawn = {
        n: [powerlaw.histogram(powerlaw.sample(tau, 1, 25, n, rng)) for _ in range(trials)]
        for n in counts
    }

    def line(histogram: np.ndarray) -> float:
        size = np.flatnonzero(histogram)
        return -float(np.polyfit(np.log(size), np.log(histogram[size]), 1)[0])

    curve = Curve(
        'power-law fit', 'simulation: tau 1.6, sizes 1 to 25', 'RMS of tau', 'fit',
        '1000 sizes', 'Fisher information: 0.035', 'correlated sizes need the effective n',
    )  # fmt: skip
    for n in counts:
        found = [powerlaw.fit(h, 1, 25).tau - tau for h in drawn[n]]
        took = milliseconds(lambda n=n: powerlaw.fit(drawn[n][0], 1, 25))
        curve.points.append((f'{n} sizes', took, rms(found)))
    at = drawn[1000]
    error = rms([line(h) - tau for h in at])
    curve.peers.append(('least squares, 1000 sizes', milliseconds(lambda: line(at[0])), error))
    return curve


def limiter() -> Curve:
    """A tone of 440 Hz, 6 to 18 dB above the ceiling: what is left beside the tone."""
    rate = 48_000
    tone = np.sin(2 * np.pi * 440 * np.arange(2 * rate) / rate).astype('f4')
    bank = Bank([tone], [0], [0.0], [2.0], rate)
    trigger = np.zeros(1, TRIGGER)
    trigger['rate'], trigger['attack_s'], trigger['release_s'] = 1.0, 0.05, 0.05
    ceiling = 10 ** (-1 / 20)

    def beside(out: np.ndarray) -> float:
        part = out[rate // 2 : rate // 2 + rate].astype(float)
        angle = 2 * np.pi * 440 * np.arange(rate) / rate
        basis = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        left = part - basis @ np.linalg.lstsq(basis, part, rcond=None)[0]
        return 100 * rms(left) / rms(part)

    def render(db: float) -> np.ndarray:
        trigger['gain'] = 10 ** ((db + 2) / 20)  # 3 dB by the panning law, -1 dB of ceiling
        return render_all(Mixer(rate, governor_db=0, gain_db=0), trigger, bank, 2 * rate)[:, 0]

    curve = Curve(
        'limiter', 'formula: input tone', '% distortion', 'second of stereo',
        '12 dB over', 'constant gain: 0',
        'limits samples, not true peaks between them',
    )  # fmt: skip
    for db in (6, 12, 18):
        out = render(db)
        assert np.abs(out).max() <= ceiling
        took = milliseconds(lambda d=db: render(d), 2) / 2
        curve.points.append((f'{db} dB over', took, beside(out)))

    def clip() -> np.ndarray:
        return np.clip(tone * ceiling * 10 ** (12 / 20), -ceiling, ceiling)

    curve.peers.append(('clipping, 12 dB over', milliseconds(clip) / 2, beside(clip())))
    return curve


def spectral_slope(seed: int, trials: int = 40) -> Curve:
    """1/f noise sampled at 20 Hz, of some minutes to an hour: how far the slope is off."""
    from scipy.signal import welch

    rate, low, high = 20.0, 0.05, 5.0
    noise = {
        seconds: [
            spectra.coloured_noise(1.0, round(seconds * rate), np.random.default_rng([9, seed, k]))
            for k in range(trials)
        ]
        for seconds in (160, 600, 3600)
    }

    def ours(values: np.ndarray) -> float:
        return spectra.slope(spectra.spectrum(values, rate, low, high)).beta

    def peer(values: np.ndarray) -> float:
        hz, power = welch(values, rate, nperseg=min(len(values), 2048))
        inside = (hz >= low) & (hz <= high)
        return -float(np.polyfit(np.log(hz[inside]), np.log(power[inside]), 1)[0])

    curve = Curve(
        'slope of a spectrum', 'simulation: 1/f noise', 'RMS of beta', 'series', '600 s',
        '95 % of its 95 % intervals hold',
        'spectra with a slope that are not 1/f: `eol bench spectra`',
    )  # fmt: skip
    for seconds, series in noise.items():
        error = rms([ours(values) - 1 for values in series])
        curve.points.append((f'{seconds} s', milliseconds(lambda v=series[0]: ours(v)), error))
    at = noise[600]
    error = rms([peer(values) - 1 for values in at])
    curve.peers.append(
        ('SciPy welch, least squares, 600 s', milliseconds(lambda: peer(at[0])), error)
    )
    return curve


def tone_loudness() -> Curve:
    """A tone of 997 Hz at -20 dBFS at several sample rates: -23.01 LUFS by ITU-R BS.1770."""
    from scipy.signal import sosfilt

    printed = loudness.k_weighting(48_000)  # BS.1770 prints them for 48 kHz only
    curve = Curve(
        'loudness', 'formula: ITU-R BS.1770, 997 Hz', 'LU',
        'second of sound', '44100 Hz', 'recommendation: 0.1 LU',
        'frequencies near half the sample rate: warped filter', every=True,
    )  # fmt: skip
    for rate in (8_000, 22_050, 44_100, 48_000, 96_000, 192_000):
        tone = 0.1 * np.sin(2 * np.pi * 997 * np.arange(10 * rate) / rate)

        def ours(tone: np.ndarray = tone, rate: int = rate) -> float:
            part = loudness.k_weighted(tone, rate)[0][-3 * rate :]
            return float(loudness.lufs(np.mean(part**2)))

        def peer(tone: np.ndarray = tone, rate: int = rate) -> float:
            part = sosfilt(printed, tone)[-3 * rate :]
            return float(loudness.lufs(np.mean(part**2)))

        curve.points.append((f'{rate} Hz', milliseconds(ours, 2) / 10, abs(ours() + 23.01)))
        if rate in (8_000, 44_100, 192_000):
            name = f'the 48 kHz filter at {rate} Hz'
            curve.peers.append((name, milliseconds(peer, 2) / 10, abs(peer() + 23.01)))
    return curve


RANDOM: dict[str, Callable[[int], Curve]] = {  # by seed
    'board-clock': board_clock,
    'replay-clock': replay_clock,
    'onset': onsets,
    'calibration': calibration,
    'layout': grain_layout,
    'pitch': pitch,
    'descriptors': timbre,
    'power-law': tail,
    'slope': spectral_slope,
}
FIXED: dict[str, Callable[[], Curve]] = {
    'limiter': limiter,
    'loudness': tone_loudness,
    'automaton': method_parts.automaton,
    'selection': method_parts.selection,
    'mixer': method_parts.mixer,
}
REALISATIONS = 10


def realised(name: str) -> Curve:
    """Return a curve with means and standard deviations of errors, and the least times."""
    curves = [RANDOM[name](k) for k in range(REALISATIONS)] if name in RANDOM else [FIXED[name]()]
    made = dataclasses.replace(curves[0], n=len(curves))
    for rows in ('points', 'peers'):
        merged = []
        for same in zip(*(getattr(curve, rows) for curve in curves), strict=True):
            labels, ms, errors = zip(*same, strict=True)
            deviation = float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0
            merged.append((labels[0], min(ms), float(np.mean(errors)), deviation))
        setattr(made, rows, merged)
    return made


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--part',
        choices=[*RANDOM, *FIXED],
        action='append',
        help='measure only this part; may be repeated',
    )
    parser.add_argument('--plots', metavar='FOLDER', help='draw method_*.png there')
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        '--markdown', action='store_true', help='print the table of the page on methods'
    )
    form.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, draw, print."""
    names = args.part or [*RANDOM, *FIXED]
    curves = {name: realised(name) for name in track(names, 'methods')}
    if args.plots:
        for name, curve in curves.items():
            print(f'drawn {draw(name, curve, Path(args.plots))}', file=sys.stderr)
    result: dict[str, Any] = {name: dataclasses.asdict(curve) for name, curve in curves.items()}
    result['machine'] = machine()
    tell(result, args.json, markdown if args.markdown else table)
    return 0


def draw(name: str, curve: Curve, folder: Path) -> Path:
    """Write the picture of a curve; return its path."""
    curves = {
        whose: [(ms, error, deviation, label) for label, ms, error, deviation in rows]
        for whose, rows in (('ours', curve.points), ('peers', curve.peers))
        if rows
    }
    path = folder / f'method_{name.replace("-", "_")}.png'
    return plots.draw(path, {curve.method: curves}, f'ms each {curve.per}', curve.unit)


def table(result: dict[str, Any]) -> str:
    """Return the rows for a terminal."""
    lines = []
    for curve in (curve for name, curve in result.items() if name != 'machine'):
        lines.append(
            f'{curve["method"]}, {curve["unit"]}, against {curve["reference"]}, n = {curve["n"]}'
        )
        for rows, whose in ((curve['points'], 'ours'), (curve['peers'], 'peer')):
            lines += [
                f'  {whose}  {label:32s} {error:.3g} ± {deviation:.2g}  '
                f'{ms:.3g} ms each {curve["per"]}'
                for label, ms, error, deviation in rows
            ]
    return '\n'.join(lines)


def markdown(result: dict[str, Any]) -> str:
    """Return the table of docs/explanation/numerics/README.md: what runs, best peer.

    A curve of which every point is shown has what runs in bold.
    """
    columns = 'name | reference | n | error | time | best peer | known limit | where it breaks'
    lines = headed(result['machine'], columns)
    for name, curve in result.items():
        if name == 'machine':
            continue
        default = curve['default']
        ours = next(row for row in curve['points'] if row[0] == default)
        peers = (
            [row for row in curve['peers'] if default in row[0]]
            or [row for row in curve['peers'] if default.split(', ')[-1] in row[0]]
            or curve['peers']
        )
        best = min(peers, key=lambda row: row[2], default=None)
        shown = f'{_error(ours)} {curve["unit"]} ({default})'
        if curve['every']:
            errors, labels = (
                [_error(row) for row in curve['points']],
                [r[0] for r in curve['points']],
            )
            which = labels.index(default)
            errors[which], labels[which] = f'**{errors[which]} {curve["unit"]}**', f'**{default}**'
            shown = f'{", ".join(errors)} ({", ".join(labels)})'
        picture = f'../../img/method_{name.replace("-", "_")}.png'
        lines.append(
            f'| [`{name}`]({picture}) | {curve["reference"]} | {curve["n"]} |'
            f' {shown} | {ours[1]:.2g} ms per {curve["per"]} |'
            f' {f"{best[0]}: {_error(best)}, {best[1]:.2g} ms" if best else "none"} |'
            f' {curve["limit"]} | {curve["breaks"]} |'
        )
    return '\n'.join(lines)


def _error(row: tuple) -> str:
    """Return the error of a point, with the deviation of one realisation."""
    _, _, error, deviation = row
    return f'{error:.2g}' + (f'±{deviation:.1g}' if deviation else '')
