# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.motion.onset import onset


@pytest.mark.parametrize('fps', [60, 120])
def test_beats_the_crossing_image_several_times(fps):
    random = np.random.default_rng(fps)
    errors, sigmas = [], []
    for _ in range(400):
        begin = random.uniform(0, 1 / fps)
        times = np.arange(-2, 5) / fps
        since = np.maximum(times - begin, 0)
        path = random.uniform(1.5, 4.0) / 320 * (1 - np.cos(320**0.5 * since))
        found, sigma = onset(times, path + random.normal(0, 5e-6, 7), 5e-6, 1 / fps)
        errors.append(found - begin)
        sigmas.append(sigma)
    rms = np.sqrt(np.mean(np.square(errors)))
    assert rms < 0.3 / fps / np.sqrt(12)
    assert np.mean(np.abs(errors) < 3 * np.array(sigmas)) > 0.97


def test_noise_alone_is_told_as_uncertain():
    _, sigma = onset(np.arange(-3, 1) / 60, np.array([0, 1e-6, -1e-6, 2e-6]), 1e-4, 1 / 60)
    assert sigma > 0.003
