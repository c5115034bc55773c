# SPDX-License-Identifier: Apache-2.0
"""Lenses in the forms in which other programs write them."""

import cv2
import numpy as np
import pytest

from eol_ros import cli
from eol_ros.devices.files.calibration_file import load_lens
from eol_ros.errors import ConfigError

K = [1000.0, 0.0, 640.0, 0.0, 1000.0, 400.0, 0.0, 0.0, 1.0]
D = [-0.2, 0.05, 0.001, -0.001, 0.0]


def camera_info(size=('1280', '800'), k=K, d=D, model='plumb_bob', shape=None, more=''):
    rows, cols = shape or (1, len(d))
    return (
        f'image_width: {size[0]}\nimage_height: {size[1]}\ncamera_name: x\n'
        f'camera_matrix: {{rows: 3, cols: 3, data: {k}}}\ndistortion_model: {model}\n'
        f'distortion_coefficients: {{rows: {rows}, cols: {cols}, data: {d}}}\n{more}'
    )


def opencv(path, d):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write('image_width', 1280)
    file.write('image_height', 800)
    file.write('camera_matrix', np.reshape(K, (3, 3)))
    file.write('distortion_coefficients', np.array(d))
    file.release()
    return path.read_bytes()


def echo(keys='dk', d=D, model='plumb_bob'):
    numbers = ''.join(f'- {v}\n' for v in d)
    matrix = ''.join(f'- {v}\n' for v in K)
    return (
        'header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: camera\nheight: 800\n'
        f'width: 1280\ndistortion_model: {model}\n{keys[0]}:\n{numbers}{keys[1]}:\n{matrix}---\n'
        'header:\n  stamp:\n    sec: 1\n'
    )


@pytest.mark.parametrize(
    'text',
    [
        camera_info(),
        camera_info(d=D[:4]),
        camera_info(shape=(5, 1)),
        camera_info(size=('1280.0', '800.')),
        camera_info().replace('distortion_model: plumb_bob\n', ''),
        camera_info(d=[*D, 0.0, 0.0, 0.0], model='rational_polynomial'),
        echo(),
        echo('DK'),
        echo('DK', [*D, 0.0, 0.0, 0.0], 'rational_polynomial'),
        camera_info().replace('\n', '\r\n'),
    ],
)
@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16'])
def test_usual_forms(tmp_path, text, encoding):
    (tmp_path / 'c.yaml').write_bytes(text.encode(encoding))
    width, height, camera, lens = load_lens(tmp_path / 'c.yaml')
    assert (width, height, camera.ravel().tolist(), lens.tolist()) == (1280, 800, K, D)


@pytest.mark.parametrize('d', [[D[:4]], [D], np.transpose([D]).tolist()])
def test_the_yaml_of_opencv(tmp_path, d):
    opencv(tmp_path / 'c.yaml', d)
    *_, camera, lens = load_lens(tmp_path / 'c.yaml')
    assert (camera.ravel().tolist(), lens.tolist()) == (K, D)


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        (camera_info(model='equidistant', d=D[:4]), "distortion_model is 'equidistant'"),
        (camera_info(model='thin_prism', d=D), "distortion_model is 'thin_prism'"),
        (camera_info(d=[*D, *D, 0, 0], model='rational_polynomial'), 'has 12 values'),
        (camera_info(d=D[:3]), 'has 3 values'),
        (camera_info(d=[0.1, 0, 0, 0, 0, 30.0, 0, 0], model='rational_polynomial'), 'k4 to k6'),
        (camera_info(k=[1e30, *K[1:]]), 'focal lengths of 1e+30'),
        (camera_info(k=[1.0, *K[1:]]), 'focal lengths of 1 '),
        (camera_info(k=[*K[:2], 1e6, *K[3:]]), 'far outside the image'),
        (camera_info(k=[K[0], 30.0, *K[2:]]), 'skew'),
        (camera_info(k=[*K[:8], 2.0]), 'another scale'),
        (camera_info(d=[1e30, 0, 0, 0, 0]), 'up to 1e+30'),
        (camera_info(d=['.nan', 0, 0, 0, 0]), 'not a number'),
        (camera_info(size=('01280', '0800')), 'octal'),
        (camera_info(size=('1280.5', '800')), 'image_width is 1280.5'),
        (camera_info(size=('1e9', '800')), 'image_width is'),
        ('- 1\n', 'holds list'),
        ('\0' * 64, 'not a YAML file'),
        ('', 'holds NoneType'),
        ('a: [1\n', ':2:1: not a YAML file'),
    ],
)
def test_the_rest_is_refused_by_name(tmp_path, capsys, text, told):
    (tmp_path / 'c.yaml').write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_lens(tmp_path / 'c.yaml')
    assert told in str(caught.value) and '\n' not in str(caught.value)
    cv2.imwrite(str(tmp_path / 'i.png'), np.zeros((800, 1280), np.uint8))
    args = ['blocks', str(tmp_path / 'i.png'), '--lens', str(tmp_path / 'c.yaml')]
    assert cli.main(['calibrate', *args]) == 78
    assert capsys.readouterr().err.count('\n') == 1
