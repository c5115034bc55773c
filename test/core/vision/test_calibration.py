# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import cv2
import numpy as np
import pytest

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError

IDEAL = Calibration.ideal()
LENS = replace(IDEAL, distortion_coefficients=np.array([-0.15, 0.03, 1e-3, -5e-4, 0.0]))


def tilted(angle):
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    columns = np.column_stack([turn @ [1, 0, 0], turn @ [0, -1, 0], [0, 0, 1000 / 545]])
    return replace(LENS, homography=LENS.camera_matrix @ columns)


def pose_of(camera, mirror):
    """Return rotation and shift of the table before the lens, from the homography (Zhang 2000)."""
    columns = np.linalg.inv(camera.camera_matrix) @ camera.homography
    if mirror:
        columns = columns @ np.diag([-1, 1, 1])
    right, away, shift = (columns / np.linalg.norm(columns[:, 0])).T
    return np.column_stack([right, away, np.cross(right, away)]), shift


@pytest.mark.parametrize('mirror', [False, True])
@pytest.mark.parametrize('angle', [0.0, 0.1, -0.3])
def test_opencv_sees_the_same_table(angle, mirror):
    """Oracles: cv2.projectPoints from the table, cv2.undistortPoints back to it."""
    camera = tilted(angle).in_mirror() if mirror else tilted(angle)
    rotation, shift = pose_of(camera, mirror)
    assert np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-9)
    table = np.random.default_rng(4).uniform(-0.7, 0.7, (200, 2))
    place = np.column_stack([-table[:, 0] if mirror else table[:, 0], table[:, 1], np.zeros(200)])
    lens = camera.camera_matrix, camera.distortion_coefficients
    seen = cv2.projectPoints(place, cv2.Rodrigues(rotation)[0], shift, *lens)[0][:, 0]
    assert np.abs(camera.to_pixels(table) - seen).max() < 1e-9
    rounds = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12
    rays = cv2.undistortPoints(seen[:, None], *lens, criteria=rounds)[:, 0]
    # where each ray meets the table: rotation^T (depth * ray - shift) has z = 0
    rays = np.column_stack([rays, np.ones(200)])
    depth = (rotation[:, 2] @ shift) / (rays @ rotation[:, 2])
    met = (depth[:, None] * rays - shift) @ rotation
    met[:, 0] *= -1 if mirror else 1
    assert np.abs(met[:, :2] - table).max() < 1e-9
    assert np.abs(camera.to_table(seen) - met[:, :2]).max() < 1e-9


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'camera_matrix': np.eye(2)}, 'camera_matrix has shape'),
        ({'homography': np.zeros((3, 3))}, 'no inverse'),
        ({'homography': np.full((3, 3), np.nan)}, 'homography'),
        ({'distortion_coefficients': np.zeros(4)}, 'distortion_coefficients'),
        ({'camera_matrix': -np.eye(3)}, 'focal length'),
        ({'image_width': 0}, 'image size'),
    ],
)
def test_impossible_calibrations_are_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        replace(IDEAL, **change)


@pytest.mark.parametrize(
    'image',
    [
        np.zeros((400, 640), np.uint8),
        np.zeros((800, 1280, 3), np.uint8),
        np.zeros((800, 1280), np.uint16),
    ],
)
def test_images_of_another_camera_are_refused(image):
    IDEAL.check_image(np.zeros((800, 1280), np.uint8))
    with pytest.raises(ConfigError, match='1280x800'):
        IDEAL.check_image(image)
