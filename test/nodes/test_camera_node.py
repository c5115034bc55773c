# SPDX-License-Identifier: Apache-2.0
"""The camera node over real DDS, on files from real encoders."""

import subprocess
import sys

import cv2
import numpy as np
import pytest
from support.spinning import Nodes, states_of

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.nodes.camera import CameraNode
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_msg
from eol_ros.settings import CameraSettings, TrackerSettings
from eol_ros.streams.images import TYPE, Codec

CODEC = Codec(definition(TYPE))


class Reader(EolNode):
    NAME = 'tracker'

    def __init__(self):
        super().__init__(TrackerSettings())
        self.raw, self.infos = [], []
        self.subscribe('camera/image_raw', self.raw.append, raw=True)
        self.subscribe('camera/camera_info', self.infos.append)
        self.states = states_of(self, 'camera')


def film(path, fourcc, n=30, size=(640, 400)):
    rng = np.random.default_rng(5)
    images = rng.normal(20, 3, (n, size[1], size[0])).clip(0, 255).astype(np.uint8)
    for k, image in enumerate(images):
        image[60:106, 10 + 4 * k : 56 + 4 * k] = 200
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*fourcc), 60, size, False)
    for image in images:
        writer.write(image)
    writer.release()
    return images


def nothing_lost(stamps):
    """At 120 a second all are a period apart; but for a machine that was away for a second."""
    steps = np.diff(stamps)
    return set(steps[steps < 1_000_000_000]) <= {8_333_333, 8_333_334}


def settings(path, **more):
    return CameraSettings(
        **{'device': str(path), 'width': 640, 'height': 400, 'fps': 120.0, 'loop': False} | more
    )


@pytest.fixture
def graph(ros):
    reader = Reader()  # there before the first image, as the tracker is in a scene
    with Nodes() as nodes:

        def run(camera_settings, until, timeout_s=30.0):
            camera = nodes.add(CameraNode(camera_settings))
            nodes.until(lambda: until(reader, camera), timeout_s)
            return reader, camera

        nodes.add(reader)
        yield run


@pytest.mark.live
def test_a_lossless_file_arrives_bit_for_bit(graph, tmp_path):
    images = film(tmp_path / 'f.mkv', 'FFV1')
    reader, _ = graph(settings(tmp_path / 'f.mkv', loop=True), lambda r, c: len(r.raw) >= 40)

    got = [CODEC.read(raw) for raw in reader.raw]
    first = next(k for k in range(30) if np.array_equal(got[0][1], images[k]))
    for k, (_, image) in enumerate(got):
        np.testing.assert_array_equal(image, images[(first + k) % 30])
    assert nothing_lost([stamp for stamp, _ in got])


@pytest.mark.live
def test_no_image_of_a_jpeg_film_at_120_a_second_is_lost(graph, tmp_path):
    film(tmp_path / 'f.avi', 'MJPG', n=60)
    reader, camera = graph(settings(tmp_path / 'f.avi', loop=True), lambda r, c: len(r.raw) >= 240)

    assert nothing_lost([CODEC.read(raw)[0] for raw in reader.raw])
    assert camera.camera.dropped == 0


@pytest.mark.parametrize(
    ('device', 'level', 'text'),
    [('f.avi', 0, 'at its end'), ('/dev/video77', 1, 'camera /dev/video77 is not there')],
)
def test_the_state_of_the_camera_is_told(graph, tmp_path, device, level, text):
    film(tmp_path / 'f.avi', 'MJPG', n=10)
    _, camera = graph(settings(tmp_path / device), lambda r, c: any(text in s for _, s in r.states))

    assert camera.health.level == level


def test_the_calibration_goes_out_as_camera_info(graph, tmp_path):
    from eol_ros.devices.files import calibration_file

    film(tmp_path / 'f.avi', 'MJPG', n=10)
    calibration = Calibration.ideal(640, 400)
    calibration_file.save(tmp_path / 'c.yaml', calibration)
    reader, _ = graph(
        settings(tmp_path / 'f.avi', calibration=str(tmp_path / 'c.yaml')),
        lambda r, c: r.infos,
    )

    info = reader.infos[0]
    assert info.header.stamp in [to_msg(CODEC.read(raw)[0]) for raw in reader.raw]
    assert (info.width, info.height) == (640, 400)
    np.testing.assert_array_equal(info.k, calibration.camera_matrix.ravel())
    assert info.distortion_model == 'plumb_bob'
    assert info.header.frame_id == 'camera_optical'


@pytest.mark.slow
def test_run_alone_it_ends_with_one_line_and_the_right_code(tmp_path):
    command = [sys.executable, '-m', 'eol_ros.nodes', 'camera', '--ros-args', '-p']
    done = subprocess.run(
        [*command, f'device:={tmp_path}/none.avi'], capture_output=True, text=True, timeout=30
    )

    assert done.returncode == 69
    assert done.stderr.strip() == f'camera: camera.device: there is no file {tmp_path}/none.avi'
