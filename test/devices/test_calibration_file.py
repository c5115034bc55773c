# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.relief.land import outlines

from assets.covers.mesh import CoverShape
from eol_ros.core.terrain import landscape
from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.files import background_file, calibration_file, camera_info
from eol_ros.errors import ConfigError, DeviceMissing


@pytest.fixture
def camera():
    return replace(
        Calibration.ideal(),
        distortion_coefficients=np.array([-0.1, 0.01, 1e-3, 2e-3, 0]),
        cover_height_m=0.05,
        date='2026-11-21',
        residual_px=0.04,
        residual_mm=0.07,
    )


def test_what_is_saved_is_loaded_to_the_bit(tmp_path, camera):
    calibration_file.save(tmp_path / 'c.yaml', camera)
    back = calibration_file.load(tmp_path / 'c.yaml')
    for name in ('camera_matrix', 'distortion_coefficients', 'homography'):
        assert np.array_equal(getattr(back, name), getattr(camera, name))
    assert (back.date, back.cover_height_m, back.residual_px, back.residual_mm) == (
        '2026-11-21',
        0.05,
        0.04,
        0.07,
    )
    assert [p.name for p in tmp_path.iterdir()] == ['c.yaml']


def test_covers_are_kept_to_the_bit(tmp_path, camera):
    land = landscape(1, cells=8)
    camera = replace(camera, covers=outlines(land, CoverShape(), 1.0, 8))
    calibration_file.save(tmp_path / 'c.yaml', camera)
    back = calibration_file.load(tmp_path / 'c.yaml')

    assert np.array_equal(back.covers.land_mm, camera.covers.land_mm)
    assert back.digest == camera.digest != replace(camera, covers=None).digest
    in_a_bag = f'{(tmp_path / "c.yaml").read_text()}digest: {camera.digest}\n'  # up to version 0.2
    assert calibration_file.loads(in_a_bag, 'topic').digest == camera.digest


def test_a_digest_is_no_octal_number():
    """It may begin with 0 and decimal digits."""
    text = 'digest: 079ecfa8cb8d0f15\n'
    assert camera_info.read(text, 'x') == {'digest': '079ecfa8cb8d0f15'}


def test_the_form_is_that_of_camera_info(tmp_path, camera):
    calibration_file.save(tmp_path / 'c.yaml', camera)
    content = yaml.safe_load((tmp_path / 'c.yaml').read_text())
    assert content['distortion_model'] == 'plumb_bob'
    assert content['image_width'] == 1280
    assert {k: content['camera_matrix'][k] for k in ('rows', 'cols')} == {'rows': 3, 'cols': 3}
    assert len(content['distortion_coefficients']['data']) == 5
    width, height, matrix, lens = calibration_file.load_lens(tmp_path / 'c.yaml')
    assert (width, height) == (1280, 800)
    assert np.array_equal(matrix, camera.camera_matrix)
    assert np.array_equal(lens, camera.distortion_coefficients)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'homography': None}, 'homography is absent'),
        ({'image_width': 'wide'}, "image_width is 'wide'"),
        ({'distortion_model': 'equidistant'}, 'only plumb_bob'),
        ({'camera_matrix': {'rows': 2, 'cols': 2, 'data': [1, 0, 0, 1]}}, '2 rows, 2 cols'),
        ({'camera_matrix': {'rows': 3, 'cols': 3, 'data': list('abcdefghi')}}, 'not a number'),
        ({'residual_px': 'good'}, "residual_px is 'good'"),
        ({'mirror': 'yes, one'}, "mirror is 'yes, one'"),
        ({'homography': {'rows': 3, 'cols': 3, 'data': [0.0] * 9}}, 'no inverse'),
        ({'covers': 26}, 'covers must have lower_mm'),
        ({'covers': {'lower_mm': 1, 'land_mm': ['12 13'] * 99}}, 'has 99 sides, not 100'),
        ({'covers': {'lower_mm': 1, 'land_mm': ['12 13'] * 99 + ['9']}}, 'as many heights each'),
        ({'covers': {'lower_mm': 30, 'land_mm': ['12 13'] * 100}}, 'below the lower rim'),
    ],
)
def test_what_is_wrong_is_named(tmp_path, camera, change, words):
    path = tmp_path / 'c.yaml'
    calibration_file.save(path, camera)
    content = yaml.safe_load(path.read_text()) | change
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))
    with pytest.raises(ConfigError, match=words) as error:
        calibration_file.load(path)
    assert str(path) in str(error.value)


def test_a_mirror_is_kept(tmp_path, camera):
    path = tmp_path / 'c.yaml'
    calibration_file.save(path, camera.in_mirror())
    assert yaml.safe_load(path.read_text())['mirror'] is True
    assert np.array_equal(calibration_file.load(path).homography, camera.in_mirror().homography)
    assert calibration_file.load(path, mirror=True).mirrored
    old = ''.join(line for line in path.read_text().splitlines(True) if 'mirror' not in line)
    path.write_text(old)
    with pytest.raises(ConfigError):
        calibration_file.load(path)


@pytest.mark.parametrize(
    ('mirrored', 'said', 'asked', 'ways_out'),
    [
        (True, False, False, ('add `mirror: true` to this file', 'y pointing away')),
        (True, False, True, ('add `mirror: true` to this file', 'y pointing away')),
        (False, True, False, ('take that line out', 'calibrate with --mirror')),
        (False, False, True, ('leave it out', 'calibrate with --mirror')),
    ],
)
def test_handedness_that_nobody_meant_is_refused(tmp_path, camera, mirrored, said, asked, ways_out):
    """A homography whose y points down would give blocks each other's names."""
    path = tmp_path / 'c.yaml'
    calibration_file.save(path, camera.in_mirror() if mirrored else camera)
    content = yaml.safe_load(path.read_text()) | {'mirror': said}
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError) as error:
        calibration_file.load(path, asked)
    assert '\n' not in str(error.value)
    assert all(words in str(error.value) for words in (str(path), *ways_out))


def test_all_faults_come_in_one_line(tmp_path):
    (tmp_path / 'c.yaml').write_text('image_width: 1280\n')
    with pytest.raises(ConfigError, match='image_height.*camera_matrix.*homography'):
        calibration_file.load(tmp_path / 'c.yaml')


@pytest.mark.parametrize('text', ['image_width: [1', '- 1\n- 2\n', ''])
def test_what_is_no_calibration_at_all(tmp_path, text):
    (tmp_path / 'c.yaml').write_text(text)
    with pytest.raises(ConfigError, match='c.yaml'):
        calibration_file.load(tmp_path / 'c.yaml')


def test_files_and_folders_that_are_not_there(tmp_path, camera):
    with pytest.raises(DeviceMissing, match='eol calibrate'):
        calibration_file.load(tmp_path / 'none.yaml')
    with pytest.raises(ConfigError, match='cannot write'):
        calibration_file.save(tmp_path / 'no' / 'c.yaml', camera)


def test_clutter_maps_are_pictures(tmp_path):
    light = np.random.default_rng(0).integers(0, 255, (40, 60)).astype(np.uint8)
    background_file.save(tmp_path / 'm.png', BackgroundModel(light))
    assert np.array_equal(background_file.load(tmp_path / 'm.png').light, light)
    with pytest.raises(DeviceMissing):
        background_file.load(tmp_path / 'none.png')
    with pytest.raises(ConfigError, match='cannot be written'):
        background_file.save(tmp_path / 'no' / 'm.png', BackgroundModel(light))
    (tmp_path / 'bad.png').write_text('no image')
    with pytest.raises(ConfigError):
        background_file.load(tmp_path / 'bad.png')
