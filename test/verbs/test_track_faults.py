# SPDX-License-Identifier: Apache-2.0
"""Images and calibrations that do not fit each other are told by `eol track`, in one line each."""

import dataclasses

import numpy as np
import pytest
from support.paper import rest_lattice
from support.relief import films

from eol_ros import cli
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.files import calibration_file

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def relief():
    return films.one('tilted')


@pytest.fixture(scope='module')
def relief_stack(relief, tmp_path_factory):
    path = tmp_path_factory.mktemp('relief') / 'images.npy'
    np.save(path, [films.sensed(relief.light, k) for k in range(28)])
    return path


def told(capsys, stack, calibration, code=0):
    table = stack.with_name('table.yaml')
    calibration_file.save(table, calibration)
    assert cli.main(['track', str(stack), '--calibration', str(table)]) == code
    lines = capsys.readouterr().err.splitlines()
    return [line for line in lines if not line.startswith('tracking')]


def resting(count, size=(640, 400), **options):
    calibration = Calibration.ideal(*size)
    renderer = Renderer(RenderOptions(**options), calibration, 3)
    x, y = rest_lattice().T
    return calibration, [renderer.render(x, y, np.zeros(25), k).copy() for k in range(count)]


def test_the_right_covers_are_no_news(capsys, relief, relief_stack):
    assert told(capsys, relief_stack, films.calibration(relief, known=True)) == []


def test_another_set_of_covers_is_one_line(capsys, relief, relief_stack):
    right = films.calibration(relief, known=True)
    others = CoverOutlines(right.covers.lower_mm, np.roll(right.covers.land_mm, 7, axis=0))
    lines = told(capsys, relief_stack, dataclasses.replace(right, covers=others))

    assert len(lines) == 1
    assert 'the calibration is of others; `eol calibrate blocks --covers FOLDER`' in lines[0]


def test_covers_that_are_not_flat_are_one_line(capsys, relief, relief_stack):
    lines = told(capsys, relief_stack, films.calibration(relief, known=False))

    assert len(lines) == 1 and 'the calibration is of flat ones' in lines[0]


def test_flat_covers_are_no_news_and_saturated_ones_are_one_line(capsys, tmp_path):
    calibration, images = resting(28)
    np.save(tmp_path / 'good.npy', images)
    assert told(capsys, tmp_path / 'good.npy', calibration) == []

    calibration, images = resting(28, block_level=400.0)
    np.save(tmp_path / 'full.npy', images)
    lines = told(capsys, tmp_path / 'full.npy', calibration)
    assert ['saturated' in line for line in lines].count(True) == 1
    assert len(lines) == len({line.partition(' s: ')[2][:9] for line in lines})


def test_images_of_another_size_are_refused(capsys, tmp_path):
    _, images = resting(2)
    np.save(tmp_path / 'small.npy', images)
    [line] = told(capsys, tmp_path / 'small.npy', Calibration.ideal(1280, 800), code=78)

    assert line.startswith(f'eol track: {tmp_path}/small.npy: image is 640x400 ')
    assert 'the calibration is for 1280x800' in line


@pytest.mark.parametrize(
    ('level', 'words'), [(0, 'image is black: check lens cap'), (255, 'image is white: check')]
)
def test_black_and_white_images_are_one_line(capsys, tmp_path, level, words):
    np.save(tmp_path / 'blank.npy', np.full((20, 400, 640), level, np.uint8))
    lines = told(capsys, tmp_path / 'blank.npy', Calibration.ideal(640, 400))

    assert len(lines) == 1 and words in lines[0]


def test_covers_that_are_others_than_before_are_told_once(
    relief, relief_stack, capsys, monkeypatch
):
    update, images = Tracker.update, []

    def found_other(self, stamp_s, image):
        tracked = update(self, stamp_s, image)
        images.append(stamp_s)
        changed = (3,) * (len(images) > 100) + (8,) * (len(images) > 110)
        return tracked._replace(changed=changed)

    monkeypatch.setattr(Tracker, 'warm_up', lambda self: None)
    monkeypatch.setattr(Tracker, 'update', found_other)
    images += [0.0] * 95  # of a video that begins earlier
    lines = told(capsys, relief_stack, films.calibration(relief, True))
    assert [line.split(': ', 1)[1].split(':')[0] for line in lines] == [
        'other covers than before on blocks 3',
        'other covers than before on blocks 8',
    ]
