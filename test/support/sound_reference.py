# SPDX-License-Identifier: Apache-2.0
"""The mixer written again, slowly and in double precision, to hold the fast one against."""

import numpy as np
from scipy.signal import bilinear, lfilter

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.offline import play
from eol_ros.core.sound.triggers import TRIGGER


def reference(triggers, sounds, grains, sample_rate, frames, gain, shift=0, dc=True):
    """Return (frames, 2) f8; `grains` is a list of (file, first sample, samples).

    `shift`: frames before the first, `dc`: with the DC block of 7 Hz.
    """
    out = np.zeros((frames + shift, 2))
    for t in triggers:
        file, first, size = grains[t['grain']]
        rate = float(t['rate'])
        source = np.concatenate([np.zeros(4), sounds[file].astype(float), np.zeros(4)])
        length = int((size - 1) / rate) + 1
        n = np.arange(length)
        p = n * rate
        i = np.floor(p).astype(int)
        f = p - i
        at = i + first + 4
        a, b, c, d = (source[at + k] for k in (-1, 0, 1, 2))
        if rate == 1:
            y = b
        else:
            y = b + f / 2 * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)))
        edges = [
            max(float(t[k]) * sample_rate, 0.002 * sample_rate) for k in ('attack_s', 'release_s')
        ]
        squeeze = min(1, (length - 1) / sum(edges))
        rise, fall = (max(1, int(e * squeeze)) for e in edges)
        y = y * (0.5 - 0.5 * np.cos(np.pi * np.minimum(n / rise, 1)))
        y = y * (0.5 - 0.5 * np.cos(np.pi * np.minimum(n[::-1] / fall, 1)))
        angle = (float(t['pan']) + 1) * np.pi / 4
        start = int(np.floor(t['time_s'] * sample_rate + 0.5)) + shift
        y = y[: max(0, len(out) - start), None] * float(t['gain']) * gain
        out[start : start + len(y)] += y * [np.cos(angle), np.sin(angle)]
    if not dc:
        return out[shift:]
    pole = 1 - 2 * np.pi * 7 / sample_rate
    return lfilter([1, -1], [1, -pole], out, axis=0)[shift:]


def filtered(x, hz, q, band, sample_rate):
    """Return `x` (n,) through the analogue filter of a grain by the bilinear transform, (n,) f8."""
    w = 2 * sample_rate * np.tan(np.pi * hz / sample_rate)
    above = [w / q, 0] if band else [w * w]
    return lfilter(*bilinear(above, [1, w / q, w * w], sample_rate), np.asarray(x, float))


def snr_db(found, wanted):
    """Return the ratio of `wanted` to the difference, dB."""
    return 10 * np.log10((wanted**2).sum() / ((found - wanted) ** 2).sum())


def rendered(mixer, rows, frames=48000, size=512):
    """Return the frames (frames, channels) of a new `mixer`, in blocks of `size`."""
    return np.concatenate(list(play(mixer, rows, frames, size)))


def noise_bank():
    """Return a bank of one grain: half a second of noise at 48 kHz."""
    noise = 0.1 * np.random.default_rng(1).standard_normal(48000)
    return Bank([noise.astype('f4')], [0], [0.0], [0.5], 48000)


def spreading(count, step_s=0.02, begin_s=10.0, columns=5):
    """Return triggers of a cascade that takes block after block along the rows, to and fro."""
    row, c = np.divmod(np.arange(count), columns)
    way = row * columns + np.where(row % 2, columns - 1 - c, c)
    t = np.zeros(count, TRIGGER)
    t['time_s'], t['block'] = begin_s + step_s * np.arange(count), way
    t['gain'], t['rate'] = 1.0, 1.0
    return t


def score(rng, count, span_s, n_grains, rate=1.0, gain=0.05):
    """Return `count` random triggers (count,) TRIGGER sorted by time."""
    t = np.zeros(count, TRIGGER)
    t['time_s'] = np.sort(rng.uniform(0, span_s, count))
    t['grain'] = rng.integers(0, n_grains, count)
    t['gain'], t['rate'] = gain, rate
    t['pan'] = rng.uniform(-1, 1, count)
    t['attack_s'] = rng.uniform(0, 0.1, count)
    t['release_s'] = rng.uniform(0, 0.1, count)
    return t
