# SPDX-License-Identifier: Apache-2.0
"""Two ears against Woodworth's formula and the analogue shadow of Brown and Duda."""

import math

import numpy as np
import pytest

from eol_ros.core.sound.binaural import HEAD_M, Binaural
from eol_ros.core.sound.ring import SOUND_MPS, Speaker

FS = 48000


def ears(azimuth, n=4096):
    click = np.zeros((n, 1), np.float32)
    click[100] = 1.0
    return Binaural([Speaker('a', azimuth)], FS)(click).astype(float)


@pytest.mark.parametrize('azimuth', [0, 15, 45, 80, 100, 150, 180, -45])
def test_the_ears_hear_it_apart_as_woodworth_says(azimuth):
    lateral = math.asin(math.sin(math.radians(azimuth)))
    wanted = HEAD_M / SOUND_MPS * (lateral + math.sin(lateral)) * FS
    first = [int(np.flatnonzero(ear)[0]) for ear in ears(azimuth).T]
    assert first[1] - first[0] == pytest.approx(wanted, abs=1.01)


@pytest.mark.parametrize('azimuth', [0, 30, 90, -90, 160])
def test_the_shadow_is_that_of_the_sphere(azimuth):
    hz = np.fft.rfftfreq(4096, 1 / FS)
    for ear, axis in zip(ears(azimuth).T, (90, -90), strict=True):
        theta = abs((azimuth - axis + 180) % 360 - 180)
        alpha = 1.05 + 0.95 * math.cos(math.radians(theta / 150 * 180))
        omega = 1j * hz / (2 * SOUND_MPS / HEAD_M / 2 / math.pi)
        wanted = np.abs((1 + alpha * omega) / (1 + omega))
        found = np.abs(np.fft.rfft(ear))
        band = (hz > 20) & (hz < 6000)
        assert np.abs(20 * np.log10(found / wanted)[band]).max() < 1.0


def test_blocks_make_no_difference_and_the_sub_is_in_the_middle():
    rng = np.random.default_rng(1)
    sound = rng.standard_normal((3000, 4)).astype('f4')
    speakers = [Speaker('a', 30.0), Speaker('b', -110.0), Speaker('c', 180.0)]
    whole, parts = Binaural(speakers, FS)(sound), Binaural(speakers, FS)
    split = np.concatenate([parts(sound[:7]), parts(sound[7:1000]), parts(sound[1000:])])
    assert np.abs(split - whole).max() < 1e-6
    sub = sound.copy()
    sub[:, :3] = 0
    assert np.allclose(Binaural(speakers, FS)(sub), sound[:, 3:])


def test_silence_ends_in_exact_zeros():
    binaural = Binaural([Speaker('a', 30.0), Speaker('b', -110.0)], FS)
    binaural(np.ones((64, 2), np.float32))
    for _ in range(200):
        out = binaural(np.zeros((256, 2), np.float32))
    assert not out.any() and not any(state.any() for state in binaural._states)
