# SPDX-License-Identifier: Apache-2.0
import json
import types

import cv2
import numpy as np
import pytest
from support.fake_camera import FakeCamera, fake_source

from eol_ros.cli import main
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.settings import CameraSettings
from eol_ros.verbs import camera as verb


def lines(capsys):
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def film(folder, *images, n=40):
    path = folder / 'film.mkv'
    size = images[0].shape[::-1]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'FFV1'), 60, size, False)
    for k in range(n):
        writer.write(images[k % len(images)])
    writer.release()
    return ['--device', str(path), '--size', 'x'.join(map(str, size))]


@pytest.fixture(scope='module')
def rendered(tmp_path_factory):
    """The words for a film of resting blocks."""
    renderer = Renderer(RenderOptions(), Calibration.ideal(640, 400), 1)
    x, y = Table().rest.T
    images = [renderer.render(x, y, np.zeros(len(x)), k).copy() for k in range(8)]
    return film(tmp_path_factory.mktemp('film'), *images)


def test_the_renderers_lens_is_as_it_says(rendered, capsys):
    """Its point spread function is a Gaussian of 1.2 px."""
    assert main(['camera', 'focus', '--seconds', '0.3', '--json', *rendered]) == 0

    found = lines(capsys)[-1]
    assert found['blur_px'] == pytest.approx(1.2, abs=0.08)
    np.testing.assert_allclose(found['tiles_px'], 1.2, atol=0.1)


def test_exposure_of_the_renderer_is_good(rendered, capsys):
    assert main(['camera', 'expose', '--seconds', '0.3', '--json', *rendered]) == 0

    found = lines(capsys)[-1]
    assert found['block_level'] == pytest.approx(184, abs=8)  # as RenderOptions has it
    assert found['saturated'] == 0 and found['advice'] == ''
    assert found['verdict']['grade'] == 'good'


def test_latency_counts_what_did_not_arrive():
    """Stamps of 100 Hz with two holes, arrivals 5 ms later, one of them 9 ms."""
    stamps = np.delete(np.arange(100) * 10_000_000, [40, 41, 70])
    arrivals = stamps + 5_000_000
    arrivals[10] += 4_000_000
    found = verb.Latency(None)._figures(list(zip(stamps, arrivals, strict=True)))

    assert found['images'] == 97 and found['not_arrived'] == 3
    assert found['p50_ms'] == 5 and found['worst_ms'] == 9
    assert found['rate_hz'] == 100 and found['jitter_ms'] == 0


@pytest.mark.parametrize(
    ('late_ms', 'lost', 'grade'),
    [(5, 0, 'good'), (12, 0, 'usable'), (40, 0, 'poor'), (5, 2, 'usable'), (5, 30, 'poor')],
)
def test_latency_is_judged_by_what_the_sound_can_wait_for(late_ms, lost, grade):
    source = types.SimpleNamespace(name='camera', values={})
    meter = verb.Latency(source)
    stamps = np.arange(100) * 10_000_000
    meter.take([(int(s), int(s) + late_ms * 1_000_000) for s in stamps], [])
    found = meter.summary(types.SimpleNamespace(dropped=lost))
    assert found['verdict']['grade'] == grade


def test_latency_of_a_v4l2_camera(monkeypatch, capsys):
    """The fake's driver stamps half a millisecond before an image can be had."""
    settings = CameraSettings(device='fake', width=320, height=200, fps=200.0, exposure_us=4000)
    source = fake_source(FakeCamera(), settings)
    monkeypatch.setattr(verb, '_source', lambda args: source)
    assert main(['camera', 'latency', '--seconds', '0.3', '--json']) == 0

    [found] = lines(capsys)
    assert found['p50_ms'] >= 2.5  # half the exposure, and that half millisecond
    assert found['images'] > 0 and found['odd_stamps'] == 0


@pytest.mark.parametrize(
    ('level', 'words'), [(0, 'image is black: check lens cap'), (255, 'image is white')]
)
def test_a_black_and_a_white_image_are_one_line(tmp_path, capsys, level, words):
    device = film(tmp_path, np.full((200, 320), level, np.uint8))
    assert main(['camera', 'focus', '--seconds', '0.2', *device]) == 0

    told = capsys.readouterr()
    assert sum(words in line for line in told.err.splitlines()) == 1
    assert 'no edge at rest in sight' in told.out


def test_a_saturated_image_says_what_to_do(tmp_path, capsys):
    image = np.full((200, 320), 20, np.uint8)
    image[50:100, 50:200] = 255
    device = film(tmp_path, image)
    assert main(['camera', 'expose', '--seconds', '0.2', *device]) == 0

    assert 'poor: 0.5 times the exposure' in (told := capsys.readouterr().out)
    assert told.splitlines()[-1].endswith(
        '(100% of what is bright is saturated, good up to 5%: edges of saturated blocks are not'
        ' where they seem)'
    )


@pytest.mark.parametrize(
    ('words', 'code', 'told'),
    [
        ('focus --device /dev/video77', 69, 'camera /dev/video77 is not there'),
        ('focus --device none.avi', 69, 'there is no file none.avi'),
        ('focus --size 3', 2, '--size 3: give width and height, such as 1280x800'),
        ('focus --size 1x1', 2, '--size: 1 is out of range (160 to 4096 px)'),
        ('focus --seconds 0', 2, '--seconds: 0 is outside 0.01 to 86400'),
        ('latency --device film.avi', 2, 'film.avi is a video; name a camera'),
        ('focus --scene playback', 78, 'playback: has no camera'),
    ],
)
def test_a_mistake_is_one_line(capsys, words, code, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if 'film' in words:
        (tmp_path / 'film.avi').touch()
    assert main(['camera', *words.split()]) == code

    assert told in capsys.readouterr().err.strip()
