# SPDX-License-Identifier: Apache-2.0
import json

import cv2
import numpy as np
import pytest

from eol_ros import cli
from eol_ros.core.geometry import rest_lattice
from eol_ros.core.vision.renderer import Renderer, RenderOptions
from eol_ros.core.vision.renderer_clutter import clutter_calibration
from eol_ros.devices import calibration_file

pytestmark = pytest.mark.slow  # the first run compiles


@pytest.fixture(scope='module')
def picture(tmp_path_factory):
    """Resting blocks under a tilted camera with a real lens."""
    rng = np.random.default_rng(0)
    renderer = Renderer(RenderOptions(), clutter_calibration('ordinary'), 1)
    xy = rest_lattice() + rng.normal(0, 0.003, (25, 2))
    path = tmp_path_factory.mktemp('still') / 'still.png'
    cv2.imwrite(str(path), renderer.render(*xy.T, rng.normal(0, 0.05, 25), 0))
    return str(path)


def test_blocks_to_yaml_and_picture(picture, tmp_path, capsys):
    out, seen = tmp_path / 'c.yaml', tmp_path / 'p.png'
    assert cli.main(['calibrate', 'blocks', picture, '--out', str(out), '--picture', str(seen),
                     '--json', '--cover-height', '0.06']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['residual_px'] < 0.1
    assert figures['refused'] == ''
    assert len(figures['each']) == 25
    camera = calibration_file.load(out)
    truth = clutter_calibration('ordinary')
    xy = rest_lattice()
    assert np.abs(camera.to_table(truth.to_pixels(xy)) - xy).max() < 4e-3
    assert camera.cover_height_m == 0.06
    assert camera.date
    drawn = cv2.imread(str(seen))
    assert drawn.shape == (800, 1280, 3)
    assert (drawn != cv2.cvtColor(drawn[..., 1], cv2.COLOR_GRAY2BGR)).any()


def test_points_need_a_size_and_four_columns(tmp_path, capsys):
    truth = clutter_calibration('clean')
    xy = np.array([[-0.7, -0.7], [0.7, -0.7], [0.7, 0.7], [-0.7, 0.7]])
    path = tmp_path / 'p.csv'
    np.savetxt(path, np.hstack([truth.to_pixels(xy), xy]), delimiter=',')
    out = str(tmp_path / 'c.yaml')
    assert cli.main(['calibrate', 'points', str(path), '--size', '1280x800', '--out', out]) == 0
    assert np.abs(calibration_file.load(out).to_table([[639.5, 399.5]])).max() < 1e-6
    assert 'four points fit any table' in capsys.readouterr().out
    assert cli.main(['calibrate', 'points', str(path)]) == 2
    assert cli.main(['calibrate', 'points', str(path), '--size', 'big']) == 2
    np.savetxt(path, xy, delimiter=',')
    assert cli.main(['calibrate', 'points', str(path), '--size', '1280x800']) == 78
    path.write_text('u,v,x,y\n')
    assert cli.main(['calibrate', 'points', str(path), '--size', '1280x800']) == 78
    errors = capsys.readouterr().err.strip().splitlines()
    assert all(line.startswith('eol calibrate: ') for line in errors if 'usage' not in line)


def test_a_mirror_is_said_and_kept(picture, tmp_path, capsys):
    image = cv2.imread(picture, cv2.IMREAD_GRAYSCALE)
    mirrored, out = str(tmp_path / 'mirrored.png'), tmp_path / 'c.yaml'
    cv2.imwrite(mirrored, cv2.flip(image, 1))
    words = ['calibrate', 'blocks', mirrored, '--mirror', '--out', str(out), '--json']
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out)['mirror'] is True
    camera = calibration_file.load(out)
    xy = rest_lattice()
    seen = clutter_calibration('ordinary').to_pixels(xy) * [-1, 1] + [1279, 0]
    assert np.abs(camera.to_table(seen) - xy).max() < 4e-3


def test_points_whose_y_runs_down_are_refused(tmp_path, capsys):
    truth = clutter_calibration('clean')
    xy = np.array([[-0.7, -0.7], [0.7, -0.7], [0.7, 0.7], [-0.7, 0.7]])
    path, out = tmp_path / 'p.csv', tmp_path / 'c.yaml'
    np.savetxt(path, np.hstack([truth.to_pixels(xy), xy * [1, -1]]), delimiter=',')
    words = ['calibrate', 'points', str(path), '--size', '1280x800', '--out', str(out)]
    assert cli.main(words) == 78
    (error,) = capsys.readouterr().err.strip().splitlines()
    assert 'add --mirror' in error
    assert 'let it point away' in error
    assert not out.exists()
    assert cli.main([*words, '--mirror']) == 0
    assert calibration_file.load(out).mirrored
    np.savetxt(path, np.hstack([truth.to_pixels(xy), xy]), delimiter=',')
    assert cli.main([*words, '--mirror']) == 78
    assert 'leave out --mirror' in capsys.readouterr().err


def test_a_printed_board_is_read_back(tmp_path, capsys):
    board = str(tmp_path / 'board.png')
    assert cli.main(['calibrate', 'print', board, '--board', '9x7']) == 0
    flat = cv2.resize(cv2.imread(board, 0), None, fx=0.8, fy=0.8, interpolation=cv2.INTER_AREA)
    cv2.imwrite(board, cv2.copyMakeBorder(flat, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=180))
    assert cli.main(['calibrate', 'board', board, '--board', '9x7', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['residual_px'] < 0.1
    mirrored = str(tmp_path / 'mirrored.png')
    cv2.imwrite(mirrored, cv2.flip(cv2.imread(board, 0), 1))
    assert cli.main(['calibrate', 'board', mirrored, '--board', '9x7']) == 78
    assert 'add --mirror' in capsys.readouterr().err
    assert cli.main(['calibrate', 'board', mirrored, '--board', '9x7', '--mirror', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['residual_px'] < 0.1


def test_user_mistakes_get_one_line(picture, tmp_path, capsys):
    black = str(tmp_path / 'black.png')
    cv2.imwrite(black, np.zeros((800, 1280), np.uint8))
    (tmp_path / 'text.png').write_text('no picture')
    lens = tmp_path / 'lens.yaml'
    calibration_file.save(lens, clutter_calibration('clean', 640, 400))
    for words, code, told in (
            (['blocks', black], 78, '0 squares seen'),
            (['blocks', str(tmp_path / 'none.png')], 69, 'no such file'),
            (['blocks', str(tmp_path / 'text.png')], 78, 'not a picture'),
            (['blocks', picture, '--lens', str(lens)], 78, 'is for images of 640x400'),
            (['blocks', picture, '--out', str(tmp_path / 'no' / 'c.yaml')], 69, 'cannot write'),
            (['board', picture], 78, 'first picture shows')):
        assert cli.main(['calibrate', *words]) == code
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert told in error
