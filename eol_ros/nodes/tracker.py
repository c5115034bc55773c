# SPDX-License-Identifier: Apache-2.0
"""Camera images in, the 25 blocks out; a JPEG for people while somebody looks."""

import sys

import numpy as np
from eol_msgs.msg import BlockTap
from sensor_msgs.msg import CompressedImage

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.calibration import Calibration
from eol_ros.core.vision.tracker import STATES, TRACKING, Tracked, Tracker
from eol_ros.devices.preview import Preview
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
        self.pictures = self.publisher('camera/image/compressed')
        self.preview = Preview(self._show)
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
        looking = self.pictures.get_subscription_count()
        if looking and self.preview.due(stamp_ns, self.settings.preview_hz):
            self.preview.take(stamp_ns, image)

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

    def _show(self, stamp_ns: int, jpeg: bytes) -> None:
        message = CompressedImage(format='mono8; jpeg compressed')
        message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'camera_optical'
        message.data.frombytes(jpeg)
        self.pictures.publish(message)

    def close(self) -> None:
        self.preview.close()


def _calibration(path: str) -> Calibration:
    if not path:
        return Calibration.ideal()
    from eol_ros.devices import calibration_file

    return calibration_file.load(path)


main = runner(TrackerNode)

if __name__ == '__main__':
    sys.exit(main())
