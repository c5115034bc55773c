# SPDX-License-Identifier: Apache-2.0
"""Camera images in, the 25 blocks out; a JPEG for people while somebody looks."""

import queue
import sys
import threading

import cv2
import numpy as np
from eol_msgs.msg import BlockTap
from sensor_msgs.msg import CompressedImage

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.calibration import Calibration
from eol_ros.core.vision.tracker import STATES, TRACKING, Tracked, Tracker
from eol_ros.ros.blocks import RECORD, pack_blocks
from eol_ros.ros.images import image_from_cdr
from eol_ros.ros.node import EolNode
from eol_ros.ros.run import runner
from eol_ros.ros.stamps import to_msg, to_ns


class TrackerNode(EolNode):
    NAME = 'tracker'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        self.tracker = Tracker(self.settings, _calibration(self.settings.calibration))
        self.tracker.warm_up()
        self.images = 0
        self.record = np.zeros(N_BLOCKS, RECORD)
        self.blocks = self.publisher('blocks')
        self.preview = self.publisher('camera/image/compressed')
        self.next_preview_ns = 0
        self.pictures: queue.Queue = queue.Queue(maxsize=1)  # a picture late is a picture dropped
        self.painter = threading.Thread(target=self._paint, daemon=True)
        self.painter.start()
        self.health.expects('images')
        self.subscribe('block_taps', self.on_tap)
        self.subscribe('camera/image_raw', self.on_image, raw=True)

    def on_tap(self, tap: BlockTap) -> None:
        self.tracker.tap(to_ns(tap.header.stamp) * 1e-9, tap.block, tap.sigma)

    def on_image(self, raw: bytes) -> None:
        try:
            stamp_ns, image = image_from_cdr(raw)
        except ValueError as error:
            return self.health.error(str(error))
        tracked = self.tracker.update(stamp_ns * 1e-9, image)
        self.blocks.publish(self._packed(stamp_ns, tracked))
        self.images += 1
        self.health.tick()
        self._tell(tracked)
        if stamp_ns >= self.next_preview_ns or self.next_preview_ns - stamp_ns > 60e9:
            self.next_preview_ns = stamp_ns + int(0.95e9 / self.settings.preview_hz)
            if self.preview.get_subscription_count() and not self.pictures.full():
                self.pictures.put_nowait((stamp_ns, image))

    def _packed(self, stamp_ns: int, tracked: Tracked) -> bytes:
        record = self.record
        record['x'], record['y'] = tracked.world[:, 0], tracked.world[:, 1]
        record['yaw'], record['sigma'] = tracked.yaw, tracked.sigma_m
        record['u'], record['v'] = tracked.px[:, 0], tracked.px[:, 1]
        record['visibility'], record['seen'] = tracked.visibility, tracked.seen
        return pack_blocks(stamp_ns, tracked.state, tracked.symmetry_ambiguous, self.images, record)

    def _tell(self, tracked: Tracked) -> None:
        seen = int(tracked.seen.sum())
        self.health.values.update(seen=seen, state=STATES[tracked.state])
        if tracked.state == TRACKING and not tracked.symmetry_ambiguous:
            self.health.ok(f'{seen} of 25 blocks seen')
        elif tracked.state == TRACKING:
            self.health.warn(
                'which way round the lattice lies is open: ids may be turned by 90 deg'
            )
        else:
            self.health.warn(f'{STATES[tracked.state]}: {tracked.why}')

    def _paint(self) -> None:
        while (item := self.pictures.get()) is not None:
            stamp_ns, image = item
            message = CompressedImage(format='mono8; jpeg compressed')
            message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'camera_optical'
            done, jpeg = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 80])
            if done:
                message.data.frombytes(jpeg.tobytes())
                self.preview.publish(message)

    def close(self) -> None:
        self.pictures.put(None)
        self.painter.join(timeout=2.0)


def _calibration(path: str) -> Calibration:
    if not path:
        return Calibration.ideal()
    from eol_ros.devices import calibration_file

    return calibration_file.load(path)


main = runner(TrackerNode)

if __name__ == '__main__':
    sys.exit(main())
