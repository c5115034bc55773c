# SPDX-License-Identifier: Apache-2.0
"""Finds the 25 blocks in camera images; makes a JPEG for people while somebody looks.

What people ask for counts from a stamp that is said on `control`, so that a bag can be proved.
"""

import sys

from eol_msgs.msg import BlockTap, Control
from sensor_msgs.msg import CompressedImage

from eol_ros.core.vision.requests import CALIBRATE, CLUTTER, DARK, SOON_NS, THRESHOLD
from eol_ros.core.vision.states import STATES
from eol_ros.core.vision.tracker import Tracked, Tracker
from eol_ros.devices.bag.selection import StampGaps
from eol_ros.devices.camera.preview import Preview
from eol_ros.devices.files.tracker_files import TrackerFiles
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.run import runner
from eol_ros.ros.stamps import to_msg, to_ns
from eol_ros.streams import blocks, images, taps


class TrackerNode(EolNode):
    NAME = 'tracker'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        self.files = TrackerFiles(self.settings, keep=not self.sim_time)
        self.restart()
        self.blocks = self.publisher('blocks')  # to be known by the time that there are any
        self.tracker.warm_up()
        self.gaps = StampGaps(self.scene.image_rate)
        self.threshold = self.settings.threshold
        self.asked: list[tuple[int, str, str]] = []  # said, and not yet heard from `control`
        self.reader = images.Codec(definition(images.TYPE))
        self.writer = blocks.Codec(definition(blocks.TYPE))
        self.pictures = self.publisher('camera/image/compressed')
        self.said = self.publisher('control')
        self.preview = Preview(self._show)
        self.health.expects('images')
        self.health.values['threshold'] = self.threshold
        self.subscribe('block_taps', self.on_tap)
        self.subscribe('control', self.on_control)
        self.subscribe('camera/image_raw', self.on_image, raw=True)

    def restart(self) -> None:
        self.tracker = Tracker(self.settings, self.files.calibration)
        self.images, self.stamp_ns = 0, 0
        self.lamps = self.files.lamps  # to begin with

    def time_jumped(self, jump_ns: int) -> None:
        """Begin as a run does: the bag that begins here can then be proved from its images."""
        stamp_ns = self.stamp_ns
        self.restart()
        self.stamp_ns, self.gaps = stamp_ns, StampGaps(self.scene.image_rate)

    def on_tap(self, tap: BlockTap) -> None:
        self.tracker.tap(*taps.to_core(taps.RECORD.take(tap)))

    def on_settings(self, new) -> None:
        if new.threshold != self.threshold:
            self.threshold = self.health.values['threshold'] = new.threshold
            self.ask(THRESHOLD, repr(float(new.threshold)))

    def on_control(self, control: Control) -> None:
        if control.target != self.NAME:
            return
        if control.source == self.NAME:
            self.on_own(to_ns(control.header.stamp), control.key, control.value)
        elif control.command == 'calibrate':
            self.ask(CALIBRATE)
        elif control.command == 'set' and control.key == DARK:
            self.ask(DARK, control.value, to_ns(control.header.stamp))

    def on_own(self, *request) -> None:
        """Heed what a tracker said in the run that is replayed; what this one said it does."""
        if request in self.asked:
            self.asked.remove(request)
        elif self.sim_time:
            if request[1] == CLUTTER:  # the lamps of that day, and not of today
                self.lamps = ''
            self.tracker.requests.add(*request)

    def ask(self, key: str, text: str = '', from_ns: int = 0) -> None:
        """Let a request count from `from_ns` or from the next image, and say so."""
        from_ns = max(from_ns, self.stamp_ns + SOON_NS) if self.images else from_ns
        self.tracker.requests.add(from_ns, key, text)
        self.asked = [*self.asked[-99:], (from_ns, key, text)]
        said = Control(source=self.NAME, command='set', target=self.NAME, key=key, value=text)
        said.header.stamp = to_msg(from_ns)
        self.said.publish(said)

    def on_image(self, raw: bytes) -> None:
        try:
            self.stamp_ns, image = self.reader.read(raw)
        except ValueError as error:
            return self.health.error(str(error))
        self.stamped(self.stamp_ns)
        if not self.images and self.lamps:
            self.ask(CLUTTER, self.lamps, self.stamp_ns)
        self.gaps.take(self.stamp_ns)
        tracked = self.tracker.update(self.stamp_ns * 1e-9, image)
        self.blocks.publish(self._packed(tracked))
        self.images += 1
        self.health.tick()
        self._tell(tracked)
        looking = self.pictures.get_subscription_count()
        if looking and self.preview.due(self.stamp_ns, self.settings.preview_hz):
            self.preview.take(self.stamp_ns, image)

    def _packed(self, t: Tracked) -> bytes:
        rows = blocks.rows_of(t, self.writer.rows)
        return self.writer.pack(self.stamp_ns, t.state, t.symmetry_ambiguous, self.images, rows)

    def _tell(self, tracked: Tracked) -> None:
        self.health.values.update(
            seen=int(tracked.seen.sum()), state=STATES[tracked.state], missing=self.gaps.missing
        )
        good, text = self.files.words(self.tracker, tracked)
        (self.health.ok if good else self.health.warn)(text)

    def _show(self, stamp_ns: int, jpeg: bytes) -> None:
        message = CompressedImage(format='mono8; jpeg compressed')
        message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'camera_optical'
        message.data.frombytes(jpeg)
        self.pictures.publish(message)

    def close(self) -> None:
        self.preview.close()


main = runner(TrackerNode)
if __name__ == '__main__':
    sys.exit(main())
