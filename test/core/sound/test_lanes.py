# SPDX-License-Identifier: Apache-2.0
"""The vector code of the mixer: against plain NumPy, and the same on narrower processors."""

import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from llvmlite import binding

from eol_ros.core.sound.envelope import add_edge, add_flat, fade_out
from eol_ros.core.sound.lanes import WIDTH
from eol_ros.core.sound.taps import read

SAMPLES = 4000
GIVEN = """
import hashlib
import numpy as np
from benchmarks.sound_reference import score
from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import play, render_all

rng = np.random.default_rng(3)
bank = Bank([rng.standard_normal(48000).astype('f4') * 0.1], [0] * 20, np.linspace(0, 0.7, 20),
            np.full(20, 0.25), 48000)
triggers = score(rng, 400, 1.8, len(bank), rate=rng.uniform(0.3, 3, 400), gain=4.0)
triggers['rate'][::3] = 1
digest = hashlib.sha256()
for cubic in (True, False):
    mixer = Mixer(48000, max_voices=20, loudness_lufs=-40, cubic=cubic)
    digest.update(render_all(mixer, triggers, bank, 2 * 48000).tobytes())
    assert mixer.state['stolen'][0] and mixer.state['limiter_least'][0] < 0.9
mixer = Mixer(48000, gain_db=-12, buses=2, room_s=1.0, room_high_s=0.5, latest=100)
mixer.set_corners(np.array([0.0, 5000.0, 900.0]))
mixer.set_wets(np.array([0.2, 0.5, 1.0]))
rows = voice_rows(triggers, bank, 2, 2 * (np.arange(400) % 3))
rows['tuning'], rows['damping'] = np.arange(400) % 4 / 8, 0.2
rows['band'] = np.arange(400) % 2
digest.update(b''.join(b.tobytes() for b in play(mixer, rows, 2 * 48000)))
"""


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


@pytest.mark.slow
@pytest.mark.timeout(400)  # the mixer is compiled twice
@pytest.mark.skipif(
    platform.machine() != 'x86_64' or not binding.get_host_cpu_features().get('fma'),
    reason='needs a processor with AVX2 and FMA',
)
def test_the_same_bits_with_vectors_of_eight_and_as_wide_as_here():
    """Compiled for Haswell (AVX2, 2013), and for this processor."""
    narrow = subprocess.Popen(  # it compiles while this process does
        [sys.executable, '-c', GIVEN + 'print(digest.hexdigest())'],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'NUMBA_CPU_NAME': 'haswell', 'NUMBA_CPU_FEATURES': ''},
    )  # fmt: skip
    here: dict = {}
    try:
        exec(GIVEN, here)
    finally:
        out, errors = narrow.communicate()
    assert out.strip() == here['digest'].hexdigest(), errors
