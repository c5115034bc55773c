# SPDX-License-Identifier: Apache-2.0
import itertools
import json

import cv2
import numpy as np
import pytest
from support.clutter import clutter_calibration
from support.paper import rest_lattice

from assets.covers import __main__ as covers
from eol_ros import cli
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.devices.files import calibration_file

pytestmark = pytest.mark.slow  # the first run compiles
TRUTH = clutter_calibration('clean')
AROUND = np.array([[-0.7, -0.7], [0.7, -0.7], [0.7, 0.7], [-0.7, 0.7]])


def pointed(path, xy=AROUND, off=0.0, says=None):
    """Write points xy (n, 2) m as a camera sees them; `says` is what the file says in place."""
    px = TRUTH.to_pixels(xy) + off
    np.savetxt(path, np.hstack([px, xy if says is None else says]), delimiter=',')
    return ['calibrate', 'points', str(path), '--size', '1280x800']


@pytest.fixture(scope='module')
def picture(tmp_path_factory):
    """Resting blocks under a tilted camera with a real lens."""
    rng = np.random.default_rng(0)
    renderer = Renderer(RenderOptions(), clutter_calibration('ordinary'), 1)
    xy = rest_lattice() + rng.normal(0, 0.003, (25, 2))
    path = tmp_path_factory.mktemp('still') / 'still.png'
    cv2.imwrite(str(path), renderer.render(*xy.T, rng.normal(0, 0.05, 25), 0))
    return str(path)


def test_blocks_to_yaml(picture, tmp_path, capsys):
    out = tmp_path / 'c.yaml'
    words = ['blocks', picture, '--output', str(out)]
    assert cli.main(['calibrate', *words, '--json', '--cover-height', '0.06']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['residual_px'] < 0.1
    assert figures['refused'] == '' and figures['verdict']['grade'] in ('good', 'usable')
    assert len(figures['each']) == 25
    camera = calibration_file.load(out)
    truth = clutter_calibration('ordinary')
    xy = rest_lattice()
    assert np.abs(camera.to_table(truth.to_pixels(xy)) - xy).max() < 4e-3
    assert camera.cover_height_m == 0.06
    assert camera.date


def test_printed_covers_are_kept_with_the_calibration(tmp_path, capsys):
    path, out, stl = tmp_path / 'p.csv', tmp_path / 'c.yaml', tmp_path / 'covers'
    way = [*pointed(path), '--output', str(out)]
    stl.mkdir()

    assert cli.main([*way, '--covers', str(stl)]) == 78
    told = capsys.readouterr().err
    assert 'has 0 files cover-*.stl, not 25' in told and '`python -m assets.covers' in told
    words = ['--output', str(stl), '--cells', '12', '--relief', '30']
    assert cli.run_verb(covers, 'assets.covers', words) == 0
    assert cli.main([*way, '--covers', str(stl), '--cover-gap', '0.002']) == 0
    kept = calibration_file.load(out).covers
    assert kept.lower_mm == 2.0
    assert 14.0 <= kept.land_mm.min() < 16 and 30 < kept.land_mm.max() <= 44.0


def test_points_need_a_size_and_four_columns(tmp_path, capsys):
    path, out = tmp_path / 'p.csv', str(tmp_path / 'c.yaml')
    words = pointed(path)
    assert cli.main([*words, '--output', out]) == 0
    assert np.abs(calibration_file.load(out).to_table([[639.5, 399.5]])).max() < 1e-6
    assert 'four points fit any table' in capsys.readouterr().out
    assert cli.main(['calibrate', 'points', str(path)]) == 2
    assert cli.main(['calibrate', 'points', str(path), '--size', 'big']) == 2
    np.savetxt(path, AROUND, delimiter=',')
    assert cli.main(words) == 78
    path.write_text('u,v,x,y\n')
    assert cli.main(words) == 78
    errors = capsys.readouterr().err.strip().splitlines()
    assert all(line.startswith('eol calibrate: ') for line in errors if 'usage' not in line)


@pytest.mark.parametrize('side', [0.4, 0.6])
def test_what_is_no_lattice_of_blocks_is_refused_in_a_line(tmp_path, capsys, side):
    """25 squares on a lattice that are as wide as no table's."""
    image = np.full((800, 1280), 20, np.uint8)
    half = round(70 * side)
    for u, v in itertools.product(range(360, 921, 140), range(120, 681, 140)):
        image[v - half : v + half, u - half : u + half] = 180
    path = tmp_path / 'squares.png'
    cv2.imwrite(str(path), cv2.GaussianBlur(image, (0, 0), 1.2))
    out = tmp_path / 'c.yaml'
    assert cli.main(['calibrate', 'blocks', str(path), '--output', str(out)]) == 78
    told = capsys.readouterr().err.splitlines()[-1]
    assert 'no image shows all blocks at rest: ' in told and 'squares seen, not 25' in told
    assert not out.exists()


def test_points_are_judged(tmp_path, capsys):
    """Four fit any table; more tell how good they are, and where they are not what they should."""
    xy = np.vstack([AROUND, 0.5 * AROUND, 0.9 * AROUND[:, ::-1]])
    for points, off_px, grade in ((xy[:4], 0, 'usable'), (xy, 0.05, 'good'), (xy, 0.6, 'usable')):
        off = off_px * np.random.default_rng(1).normal(size=(len(points), 2))
        assert cli.main(pointed(tmp_path / 'p.csv', points, off)) == 0
        assert capsys.readouterr().out.splitlines()[-1].startswith(f'{grade}: '), off_px


def test_a_mirror_is_said_and_kept(picture, tmp_path, capsys):
    image = cv2.imread(picture, cv2.IMREAD_GRAYSCALE)
    mirrored, out = str(tmp_path / 'mirrored.png'), tmp_path / 'c.yaml'
    cv2.imwrite(mirrored, cv2.flip(image, 1))
    words = ['calibrate', 'blocks', mirrored, '--mirror', '--output', str(out), '--json']
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out)['mirror'] is True
    camera = calibration_file.load(out)
    xy = rest_lattice()
    seen = clutter_calibration('ordinary').to_pixels(xy) * [-1, 1] + [1279, 0]
    assert np.abs(camera.to_table(seen) - xy).max() < 4e-3


def test_points_whose_y_runs_down_are_refused(tmp_path, capsys):
    path, out = tmp_path / 'p.csv', tmp_path / 'c.yaml'
    words = [*pointed(path, says=AROUND * [1, -1]), '--output', str(out)]
    assert cli.main(words) == 78
    (error,) = capsys.readouterr().err.strip().splitlines()
    assert 'add --mirror' in error
    assert 'let it point away' in error
    assert not out.exists()
    assert cli.main([*words, '--mirror']) == 0
    assert calibration_file.load(out).mirrored
    pointed(path)
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


def test_saturated_and_frozen_images_are_told_in_one_line_each(picture, tmp_path, capsys):
    image = cv2.imread(picture, cv2.IMREAD_GRAYSCALE)
    bright = str(tmp_path / 'bright.png')
    cv2.imwrite(bright, np.clip(image.astype(float) * 3, 0, 255).astype(np.uint8))
    cli.main(['calibrate', 'blocks', picture])
    told = capsys.readouterr().err
    assert 'saturated' not in told and 'the same' not in told
    cli.main(['calibrate', 'blocks', picture, bright, picture])
    told = capsys.readouterr().err.splitlines()
    assert sum('1 of 3 images are the same as another' in line for line in told) == 1
    assert sum('1 of 2 images are saturated' in line and '% of' in line for line in told) == 1


def test_user_mistakes_get_one_line(picture, tmp_path, capsys):
    black = str(tmp_path / 'black.png')
    cv2.imwrite(black, np.zeros((800, 1280), np.uint8))
    lens = tmp_path / 'lens.yaml'
    calibration_file.save(lens, clutter_calibration('clean', 640, 400))
    for words, code, told in (
        (['blocks', black], 78, 'image is black: check lens cap'),
        (['blocks', picture, '--lens', str(lens)], 78, 'is for images of 640x400'),
        (['blocks', picture, '--output', str(tmp_path / 'no' / 'c.yaml')], 78, 'cannot write'),
        (['board', picture], 78, 'first image shows'),
    ):
        assert cli.main(['calibrate', *words]) == code
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert told in error


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        (['b.pdf'], 2, 'a board is written as .png'),
        (['no/b.png'], 78, 'cannot be written'),
    ],
)
def test_a_board_that_cannot_be_printed(tmp_path, monkeypatch, capsys, words, code, said):
    monkeypatch.chdir(tmp_path)
    assert cli.main(['calibrate', 'print', *words]) == code
    err = capsys.readouterr().err
    assert said in err and err.count('\n') == 1
    assert not list(tmp_path.iterdir())
