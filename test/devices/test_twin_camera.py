# SPDX-License-Identifier: Apache-2.0
"""The ideal camera of a twin shows the whole platform of any table; a file must fit the table."""

import numpy as np
import pytest

from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.files import calibration_file
from eol_ros.devices.files.twin_camera import twin_camera
from eol_ros.errors import ConfigError
from eol_ros.settings import TwinSettings

TABLES = [
    Table(), Table(rows=15, columns=15, platform_m=(3.2, 3.2)), Table(platform_m=(3.0, 1.2)),
    Table(rows=2, columns=2, block_side_m=0.03, gap_m=0.02, platform_m=(0.3, 0.3)),
]  # fmt: skip


@pytest.mark.parametrize('table', TABLES)
@pytest.mark.parametrize('size', [(1280, 800), (640, 640)])
def test_the_platform_nearly_fills_the_image(table, size):
    width, height = size
    camera = twin_camera(TwinSettings(width=width, height=height), table)
    corner = camera.to_pixels(np.array([[-0.5, 0.5], [0.5, -0.5]]) * table.platform_m)
    assert (corner >= 0).all() and (corner <= np.array(size) - 1).all()
    span = (corner[1] - corner[0]) / (width, height)
    assert span.max() > 0.9 or width == height


def test_the_camera_of_the_paper_is_as_it_was():
    for width, height in ((1280, 800), (640, 800), (320, 200)):
        camera = twin_camera(TwinSettings(width=width, height=height))
        assert camera.digest == Calibration.ideal(width, height).digest


def test_covers_of_another_table_are_refused(tmp_path):
    path = tmp_path / 'camera.yaml'
    covers = CoverOutlines(34.0, np.full((25, 4, 33), 50.0))
    ideal = Calibration.ideal()
    with_covers = Calibration(
        1280, 800, ideal.camera_matrix, ideal.distortion_coefficients, ideal.homography, 0.05,
        covers=covers,
    )  # fmt: skip
    calibration_file.save(path, with_covers)
    settings = TwinSettings(calibration=str(path))
    assert twin_camera(settings).covers is not None
    with pytest.raises(ConfigError, match='of the scene: rows 5, not 3, columns 5, not 4:'):
        twin_camera(settings, Table(rows=3, columns=4))
