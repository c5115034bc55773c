# SPDX-License-Identifier: Apache-2.0
import sys

import cv2
import numpy as np
import pytest

from benchmarks import vision_videos
from benchmarks.vision_scenes import RATE_HZ, Film
from eol_ros import cli

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def film():
    return Film('clean', 'L2', 5)


def write(path, images, spoil=lambda image: image):
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter_fourcc(*'FFV1'), RATE_HZ, images[0].shape[::-1], False
    )
    for image in images:
        writer.write(spoil(image))
    writer.release()


def test_a_lossless_video_is_at_the_bound_and_a_coarse_one_is_not(film, tmp_path):
    drawn = [film.image(k) for k in range(20)]
    images = [image.copy() for image, _, _ in drawn]
    poses = np.array([pose for _, pose, _ in drawn])
    write(tmp_path / 'film.mkv', [i.copy() for i in images])
    fine = vision_videos._figures(tmp_path / 'film.mkv', film, poses)
    write(tmp_path / 'coarse.mkv', images, lambda i: (i // 64 * 64 + 32).astype(np.uint8))
    coarse = vision_videos._figures(tmp_path / 'coarse.mkv', film, poses)

    assert fine['coverage'] == 1 and fine['rms_px'] < 0.0075  # 0.0046 px is the bound at rest
    assert coarse['rms_px'] > 2 * fine['rms_px']
    assert fine['mb_per_s'] > coarse['mb_per_s']


def test_a_shift_in_time_is_an_error_of_what_moves(film, tmp_path):
    drawn = [film.image(k) for k in range(21)]
    write(tmp_path / 'film.mkv', [image.copy() for image, _, _ in drawn[1:]])
    poses = np.array([pose for _, pose, _ in drawn])
    late = vision_videos._figures(tmp_path / 'film.mkv', film, poses[:-1])
    px = np.linalg.norm(np.diff(poses[:, :, :2], axis=0), axis=2) * film.calibration.px_per_m()

    assert late['worst_px'] == pytest.approx(px[10:].max(), abs=0.1)


def test_without_its_encoder_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'av', None)
    assert cli.main(['bench', 'vision', '--videos', '--seconds', '0.1']) == 69

    error = capsys.readouterr().err
    assert 'the videos are made by PyAV: ' in error and '-m pip install av' in error
