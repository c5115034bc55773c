# SPDX-License-Identifier: Apache-2.0
"""The vector code of the mixer against plain NumPy."""

import numpy as np
import pytest

from eol_ros.core.sound.envelope import add_edge, add_flat, fade_out
from eol_ros.core.sound.lanes import WIDTH
from eol_ros.core.sound.taps import read

SAMPLES = 4000


def padded(n, seed=1):
    return np.random.default_rng(seed).standard_normal(n + 2 * WIDTH).astype('f4')


@pytest.mark.parametrize('rate', [1 / 16, 0.37, 0.9999999, 1.0, 1.7, 16.0])
@pytest.mark.parametrize('cubic', [True, False])
def test_reads_between_samples(rate, cubic):
    rate = float(np.float32(rate))
    sound = padded(SAMPLES)
    count, first = 150, 37
    out = np.empty(count + WIDTH, 'f4')
    read(out.ctypes.data, sound.ctypes.data + 4 * WIDTH, rate, first, count, cubic)
    place = rate * (first + np.arange(count))
    i = np.floor(place).astype(int)
    a, b, c, d = (sound.astype(float)[i + k + WIDTH] for k in (-1, 0, 1, 2))
    f = place - i
    wanted = b + f / 2 * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)))
    if not cubic:
        wanted = b + f * (c - b)
    assert np.abs(out[:count] - wanted).max() < 2e-6


@pytest.mark.parametrize('count', [1, WIDTH - 1, WIDTH, WIDTH + 1, 300])
def test_adds_under_an_edge_and_touches_nothing_behind_it(count):
    row, mix = padded(count), np.stack([padded(count, 2), padded(count, 3)])
    before = mix.copy()
    a, b = (m.ctypes.data for m in mix)
    gains = np.float32(0.7), np.float32(-0.2)
    add_edge(a, b, row.ctypes.data, count, 5, np.float32(1 / 400), *gains)
    edge = 0.5 - 0.5 * np.cos(np.pi * (5 + np.arange(count)) / 400)
    wanted = before[:, :count] + np.outer(gains, row[:count] * edge)
    assert np.abs(mix[:, :count] - wanted).max() < 1e-6
    assert np.array_equal(mix[:, count:], before[:, count:])
    before = mix.copy()
    add_flat(a, b, row.ctypes.data, count, *gains)
    assert np.abs(mix[:, :count] - before[:, :count] - np.outer(gains, row[:count])).max() < 1e-6
    assert np.array_equal(mix[:, count:], before[:, count:])


def test_a_fade_out_leaves_what_comes_before_it_as_it_is():
    row, out = padded(300), np.zeros(300 + WIDTH, 'f4')
    fade_out(out.ctypes.data, row.ctypes.data, 250, 280, 96)
    assert np.array_equal(out[: 280 - 96 + 1], row[: 280 - 96 + 1])  # bit for bit
    gain = 0.5 - 0.5 * np.cos(np.pi * (280 - np.arange(184, 250)) / 96)
    assert np.abs(out[184:250] - row[184:250] * gain).max() < 1e-6
