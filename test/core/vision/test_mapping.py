# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.geometry import BLOCK_SIDE_M, rest_lattice
from eol_ros.core.vision import mapping
from eol_ros.core.vision.blobs import BLOB
from eol_ros.core.vision.calibration import Calibration
from eol_ros.core.vision.renderer_clutter import clutter_calibration


@pytest.mark.parametrize('calibration', [Calibration.ideal(), clutter_calibration('brutal')])
def test_compiled_and_plain_formulas_agree(calibration):
    random = np.random.default_rng(5)
    xy = rest_lattice() + random.normal(0, 0.01, (25, 2))
    velocity, yaw, contrast = random.normal(0, 0.2, (25, 2)), random.normal(0, 1, 25), np.ones(25)
    ahead = np.zeros((25, 4))
    mapping.expected(calibration.packed(), xy, velocity, yaw, contrast, 0.02, ahead)
    assert np.allclose(ahead[:, :2], calibration.to_pixels(xy + 0.02 * velocity), atol=1e-9)
    assert (ahead[:, 2] == yaw).all()

    blobs = np.zeros(25, BLOB)
    blobs['u'], blobs['v'] = calibration.to_pixels(xy).T
    blobs['theta'], blobs['side_px'], blobs['sigma_px'] = yaw, 45.8, 0.01
    pose, sigma = mapping.poses(calibration.packed(), blobs, BLOCK_SIDE_M)
    px = np.column_stack([blobs['u'], blobs['v']])
    assert np.allclose(pose, calibration.poses_to_table(px, yaw, 45.8), atol=1e-9)
    assert np.allclose(sigma, 0.01 * BLOCK_SIDE_M / 45.8)


def test_an_answer_is_the_square_where_seen_and_the_lattice_where_not():
    calibration = clutter_calibration('hard')
    xy, seen = rest_lattice(), np.arange(25) % 3 > 0
    index = np.where(seen, np.arange(25)[::-1], -1)
    blobs = np.zeros(25, BLOB)
    blobs['u'], blobs['v'] = np.arange(25) * 1.5, np.arange(25) * 2.5
    px, world = np.zeros((25, 2)), np.zeros((25, 2))
    steps = np.array([2.0**-20, 2.0**-10])
    mapping.answer(calibration.packed(), xy, seen, index, blobs, steps, px, world)
    assert np.allclose(px[~seen], calibration.to_pixels(xy[~seen]), atol=2.0**-11)
    assert (px[seen, 0] == 1.5 * index[seen]).all()
    assert np.allclose(world, xy, atol=2.0**-21)
    assert (world / steps[0] == np.rint(world / steps[0])).all()
