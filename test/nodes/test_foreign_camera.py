# SPDX-License-Identifier: Apache-2.0
"""A camera driver that is not ours: a process of stock rclpy, in front of our tracker.

The driver imports nothing of the project. Its images come from a file.
"""

import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
import yaml
from sensor_msgs.msg import CameraInfo
from support.paper import rest_lattice
from support.spinning import Nodes
from support.waiting import wait_until

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.devices.camera.preview import Preview
from eol_ros.devices.files import calibration_file
from eol_ros.errors import ConfigError
from eol_ros.nodes.tracker import TrackerNode
from eol_ros.ros.node import EolNode
from eol_ros.scene import Scene, load
from eol_ros.settings import TrackerSettings

DRIVER = """\
import sys

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

path, encoding, width, height, k, d = sys.argv[1:7]
data = np.load(path)
rclpy.init(args=sys.argv)
node = Node('usb_cam', namespace='eol')
kind = CompressedImage if encoding == 'jpeg' else Image
topic = 'camera/image_raw/compressed' if encoding == 'jpeg' else 'camera/image_raw'
images = node.create_publisher(kind, topic, qos_profile_sensor_data)
infos = node.create_publisher(CameraInfo, 'camera/camera_info', qos_profile_sensor_data)
if encoding == 'jpeg':
    image = CompressedImage(format='jpeg', data=data.tobytes())
else:
    image = Image(encoding=encoding, width=int(width), height=int(height), step=data.shape[1])
    image.data = data.tobytes()
info = CameraInfo(width=int(width), height=int(height), distortion_model='plumb_bob')
info.k, info.d = (np.array(text.split(','), float).tolist() for text in (k, d))

def publish():
    image.header.stamp = info.header.stamp = node.get_clock().now().to_msg()
    images.publish(image)
    infos.publish(info)

node.create_timer(0.05, publish)
rclpy.spin(node)
"""
LENS = np.array([-0.05, 0.01, 0.0, 0.0, 0.0])


class Listener(EolNode):
    NAME = 'probe'

    def __init__(self):
        super().__init__(TrackerSettings(), scene=Scene('probe', {}))
        self.blocks = []
        self.subscribe('blocks', self.blocks.append)


@pytest.fixture
def calibrated(tmp_path):
    ideal = Calibration.ideal()
    camera = Calibration(1280, 800, ideal.camera_matrix, LENS, ideal.homography, date='2026-01-01')
    path = tmp_path / 'calibration.yaml'
    calibration_file.save(path, camera)
    return path, camera


def drive(tmp_path, camera, encoding, focal=1.0):
    """Start the driver with an image of blocks at rest."""
    rest = rest_lattice()
    image = Renderer(RenderOptions(), camera, 3).render(rest[:, 0], rest[:, 1], np.zeros(25), 0)
    data = {
        'rgb8': lambda: np.pad(np.repeat(image, 3, axis=1), ((0, 0), (0, 32))),
        'mono8': lambda: image,
        'jpeg': lambda: cv2.imencode('.jpg', image)[1],
    }[encoding]()
    np.save(tmp_path / 'image.npy', data)
    matrix = camera.camera_matrix * [[focal], [focal], [1]]
    matrix[:2, 2] = camera.camera_matrix[:2, 2]
    numbers = (','.join(map(repr, a.ravel().tolist())) for a in (matrix, LENS))
    command = [sys.executable, '-c', DRIVER, str(tmp_path / 'image.npy'), encoding, '1280', '800']
    return subprocess.Popen([*command, *numbers], env={**os.environ, 'PYTHONPATH': ''})


@pytest.mark.slow
@pytest.mark.parametrize('encoding', ['rgb8', 'jpeg'])
def test_blocks_come_of_images_of_a_stock_driver(ros, tmp_path, calibrated, encoding, capfd):
    path, camera = calibrated
    transport = 'compressed' if encoding == 'jpeg' else 'raw'
    settings = TrackerSettings(calibration=str(path), image_transport=transport)
    node, listener = TrackerNode(settings), Listener()
    driver = drive(tmp_path, camera, encoding)
    try:
        with Nodes(node, listener) as nodes:
            nodes.until(lambda: len(listener.blocks) > 25 and node.lens)
            assert listener.blocks[-1].rows['seen'].all()
            found = np.stack([listener.blocks[-1].rows[axis] for axis in 'xy'], axis=1)
            assert np.abs(found - rest_lattice()).max() < 5e-4
            assert node.health.level == 0 and not node.lens_differs
    finally:
        driver.kill()
        driver.wait()
    assert f'images are {encoding}: converted to mono8, ' in capfd.readouterr().err


@pytest.mark.slow
def test_a_lens_unlike_the_calibration_raises_a_warning(ros, tmp_path, calibrated):
    path, camera = calibrated
    node = TrackerNode(TrackerSettings(calibration=str(path)))
    driver = drive(tmp_path, camera, 'mono8', focal=1.02)
    try:
        with Nodes(node) as nodes:
            nodes.until(lambda: node.lens_differs)
            nodes.until(lambda: node.health.level == 1)
            assert 'camera_info of the driver differs from the calibration by' in node.health.text
    finally:
        driver.kill()
        driver.wait()


@pytest.mark.parametrize(
    ('change', 'differs'),
    [
        ({}, True), ({'d': [0.0] * 4}, True), ({'d': []}, True), ({'k': [0.0] * 9}, False),
        ({'k': [0.0, 0.0, 640.0, 0.0, 0.0, 400.0, 0.0, 0.0, 1.0]}, False),
        ({'k': [np.nan] * 9}, False),
        ({'width': 640}, False), ({'binning_x': 2}, False), ({'distortion_model': 'fish'}, False),
    ],
)  # fmt: skip
def test_only_a_lens_for_these_images_is_compared(ros, calibrated, change, differs):
    path, camera = calibrated
    node = TrackerNode(TrackerSettings(calibration=str(path)))
    try:
        matrix = camera.camera_matrix * [[1.02, 1, 1], [1, 1.02, 1], [1, 1, 1]]
        info = {'width': camera.image_width, 'height': camera.image_height,
                'd': camera.distortion_coefficients.tolist(),
                'distortion_model': 'plumb_bob', 'k': matrix.ravel().tolist()}  # fmt: skip
        node.on_lens(CameraInfo(**{**info, 'k': camera.camera_matrix.ravel().tolist()}))
        node.compare_lens()
        assert not node.lens_differs
        node.on_lens(CameraInfo(**{**info, **change}))
        node.compare_lens()
        assert bool(node.lens_differs) == differs
    finally:
        node.close()
        node.destroy_node()


def test_a_stamp_of_the_start_of_exposure_is_moved_to_its_middle(ros):
    from eol_ros.streams.images import Grey

    node = TrackerNode(TrackerSettings(stamp_offset_s=0.0015))
    try:
        wait_until(lambda: node.stamp_ns == 0)
        node.on_image(Grey(1_700_000_000_000_000_000, np.zeros((800, 1280), np.uint8)))
        assert node.stamp_ns == 1_700_000_000_001_500_000
    finally:
        node.close()
        node.destroy_node()


def test_an_image_of_one_line_has_a_preview():
    given = []
    preview = Preview(lambda _stamp_ns, jpeg: given.append(np.frombuffer(jpeg, np.uint8)))
    preview.take(1, np.zeros((1, 9), np.uint8))
    wait_until(lambda: given)
    preview.close()
    assert cv2.imdecode(given[0], cv2.IMREAD_GRAYSCALE).shape == (1, 4)


def test_jpeg_images_are_for_other_drivers_only(tmp_path):
    path = tmp_path / 'scene.yaml'
    nodes = {'twin': {}, 'tracker': {'image_transport': 'compressed'}, 'recorder': 'off'}
    path.write_text(yaml.safe_dump({'nodes': nodes}))
    with pytest.raises(ConfigError, match='image_transport: must be raw: twin publishes no JPEG'):
        load(path)
    del nodes['twin']
    path.write_text(yaml.safe_dump({'nodes': nodes, 'elsewhere': ['camera']}))
    assert load(path).nodes['tracker'].image_transport == 'compressed'


def test_the_lens_difference_is_the_largest_distance_of_points():
    ideal = Calibration.ideal()
    same = ideal.lens_difference_px(ideal.camera_matrix, np.zeros(5))
    moved = ideal.camera_matrix + [[0, 0, 3], [0, 0, 0], [0, 0, 0]]
    assert same < 1e-9 and ideal.lens_difference_px(moved, np.zeros(5)) == pytest.approx(3)
    # the corner is 640 px from the middle: k1 moves it by f * x * k1 * r2
    x, y = 640 / 1000, 400 / 1000
    wanted = 1000 * x * 0.1 * (x * x + y * y)
    found = ideal.lens_difference_px(ideal.camera_matrix, [0.1, 0, 0, 0, 0])
    assert found == pytest.approx(wanted, rel=0.01)
