# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.motion.onset import onsets


@pytest.mark.parametrize('fps', [60, 120])
def test_beats_the_crossing_image_several_times(fps):
    random = np.random.default_rng(fps)
    begin = random.uniform(0, 1 / fps, (400, 1))
    times = np.tile(np.arange(-2, 5) / fps, (400, 1))
    since = np.maximum(times - begin, 0)
    path = random.uniform(1.5, 4.0, (400, 1)) / 320 * (1 - np.cos(320**0.5 * since))
    path += random.normal(0, 5e-6, path.shape)
    found, sigmas = onsets(times, path, np.full(400, 5e-6), 1 / fps)
    errors = found - begin[:, 0]
    assert np.sqrt(np.mean(errors**2)) < 0.3 / fps / np.sqrt(12)
    assert np.mean(np.abs(errors) < 3 * sigmas) > 0.97


def test_noise_alone_is_told_as_uncertain():
    path = np.array([[0, 1e-6, -1e-6, 2e-6]])
    _, sigma = onsets(np.arange(-3, 1)[None] / 60, path, np.array([1e-4]), 1 / 60)
    assert sigma[0] > 0.003
