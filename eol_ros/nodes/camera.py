# SPDX-License-Identifier: Apache-2.0
"""Reads a camera or a video file and publishes stamped mono8 images."""

from eol_ros.devices.camera.camera import Camera, State
from eol_ros.devices.camera.sources import source_of
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.said import said

DEVICE_S, DEVICE_HUNG_S = 15.0, 60.0  # time limits to open a camera and to get an image
LATE_IMAGES = 5  # periods


class CameraNode(EolNode):
    NAME = 'camera'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        calibration = None
        if self.settings.calibration:
            from eol_ros.devices.files import calibration_file

            calibration = calibration_file.load(self.settings.calibration)
        self.images = ImagePublisher(self, 'camera/image_raw', 'camera/camera_info', calibration)
        source = source_of(self.settings)
        self.camera = Camera(source, self.on_image, self.on_state, self.settings.loop)
        self.health.watches('reader', self.camera.reading, DEVICE_S, DEVICE_HUNG_S)
        self.health.watches('hand-over', self.camera.handing_over)
        self.create_timer(1.0, self.tell)
        self.camera.start()

    def on_image(self, stamp_ns: int, image) -> None:
        self.images.publish(stamp_ns, image)
        self.health.tick()

    def on_state(self, state: State) -> None:
        late_s = max(2.0, LATE_IMAGES / (self.camera.source.fps or 60.0))
        self.health.expects(said('images') if state.kind == 'streaming' else '', late_s)
        report = {
            'streaming': self.health.ok,
            'ended': self.health.ok,
            'wrong': self.health.error,
        }
        report.get(state.kind, self.health.warn)(state.text)

    def tell(self) -> None:
        camera, values = self.camera, self.health.values
        values.update(
            images=camera.delivered,
            dropped=camera.dropped,
            stalls=camera.stalls,
            opened=camera.opened,
        )
        if camera.source.live:
            values.update(camera.source.values)
        else:
            values['late_ms'] = round(camera.late_ms, 1)

    def close(self) -> None:
        self.camera.close()
