# SPDX-License-Identifier: Apache-2.0
"""Finds the blocks in camera images; publishes a JPEG preview on demand.

What people ask for counts from a stamp that the answer names, so that a bag can be proved.
"""

import base64
import time
from typing import NamedTuple

import numpy as np
from eol_msgs.msg import BlockTap
from eol_msgs.msg import Calibration as CalibrationMessage
from eol_msgs.msg import Table as TableMessage
from sensor_msgs.msg import CameraInfo, CompressedImage

from eol_ros.core.vision.appearance import learnt
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.requests import BACKGROUND, COVERS
from eol_ros.core.vision.states import STATES
from eol_ros.core.vision.tracker import Tracked, Tracker
from eol_ros.devices.bag.selection import StampGaps
from eol_ros.devices.camera.preview import Preview
from eol_ros.devices.files.tracker_files import TrackerFiles
from eol_ros.errors import ConfigError, EolError
from eol_ros.ros.definitions import definition
from eol_ros.ros.intake import ConversionCost
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import LATER
from eol_ros.ros.stamps import NS, to_msg
from eol_ros.said import clauses, said
from eol_ros.streams import blocks, calibrations, images, tables, taps
from eol_ros.streams.graph import IMAGE_SOURCES
from eol_ros.streams.requests import Asked, for_tracker

LEARNT_EVERY_S = 60.0  # between two looks at what was learnt of the blocks
LENS_APART_PX = 1.0  # chosen: a lens difference that raises a warning; 1.8 mm at 545 px/m


class Lens(NamedTuple):
    """What a driver states of its lens: model, image size, whether of the whole image, k, d."""

    model: str
    size: tuple[int, int]
    whole: bool
    k: tuple[float, ...]
    d: tuple[float, ...]


class TrackerNode(EolNode):
    NAME = 'tracker'
    HOLDS = False  # the tracker itself knows from which image on

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        self.files = TrackerFiles(self.settings, self.table, keep=not self.sim_time)
        self.pending: dict[str, Asked] = {}  # by kind: what is not answered yet
        self.covers = self._covers_before()  # as they were learned
        self.learnt_s = 0.0  # stamp
        self.told: Calibration | None = None
        self.restart()
        self.blocks = self.publisher('blocks')  # to be known by the time that there are any
        self.tracker.warm_up()
        self.gaps = StampGaps(self.scene.image_rate)
        self.writer = blocks.Codec(definition(blocks.TYPE), self.frame_prefix, self.table.cells)
        self.calibrations = self.publisher('calibration')
        now_ns = self.get_clock().now().nanoseconds
        self.publisher('table').publish(
            tables.RECORD.fill(TableMessage(), tables.of(now_ns, self.table), self.frame_prefix)
        )
        self.tell_calibration()
        self.offset_ns = round(self.settings.stamp_offset_s * NS)
        self.jpeg = self.settings.image_transport == 'compressed'
        if not self.jpeg:
            self.pictures = self.publisher('camera/image_raw/compressed')
            self.preview = Preview(self._show)
            self.health.watches('preview', self.preview.rounds)
        self.health.expects(said('images'))
        self.subscribe('block_taps', self.on_tap)
        self.requests.serve(
            calibrate=self.pend, darkness=self.pend, background=self.on_background,
            covers=self.on_covers,
        )  # fmt: skip
        if self.jpeg:
            self.cost = ConversionCost(self)
            self.subscribe(
                'camera/image_raw/compressed', self.on_image, read=self.read_jpeg, slow=True
            )
        else:
            self.subscribe('camera/image_raw', self.on_image, slow=True)
        self.lens: Lens | None = None  # of a driver that is not ours
        self.lens_compared: Calibration | None = None
        self.lens_differs = ''
        if self.settings.calibration and not set(self.scene.nodes) & set(IMAGE_SOURCES):
            self.subscribe('camera/camera_info', self.on_lens)

    def restart(self) -> None:
        self.tracker = Tracker(self.settings, self.files.calibration, self.table)
        self.images, self.stamp_ns = 0, 0
        self.lamps = self.files.lamps  # to begin with
        for asked in self.pending.values():
            self.requests.answer(asked, False, said('jumped'))
        self.pending.clear()

    def time_jumped(self, jump_ns: int) -> None:
        """Begin as a run does: the bag that begins here can then be proved from its images."""
        stamp_ns = self.stamp_ns
        self.restart()
        self.stamp_ns, self.gaps = stamp_ns, StampGaps(self.scene.image_rate)

    def tell_calibration(self) -> None:
        """Publish the calibration when it is another than the one that was told last."""
        if self.tracker.calibration is not self.told and self.tracker.calibration is not None:
            self.told = self.tracker.calibration
            row = calibrations.of(self.get_clock().now().nanoseconds, self.told)
            message = calibrations.RECORD.fill(CalibrationMessage(), row, self.frame_prefix)
            self.calibrations.publish(message)

    def on_tap(self, tap: BlockTap) -> None:
        self.tracker.tap(*taps.to_core(taps.RECORD.take(tap)))

    def hand_over(self, asked: Asked) -> None:
        for kind, value in for_tracker(asked):
            self.tracker.requests.add(asked.from_ns, kind, value)

    def pend(self, asked: Asked) -> object:
        """Let the tracker do it, and answer when it is known what came of it."""
        if asked.kind in self.pending:
            raise EolError(said('being_done'))
        # The next image would answer it. A replay asks for what has been done.
        if not self.sim_time and (silent_s := self.health.overdue_s()):
            raise EolError(
                clauses(
                    [
                        said('nothing_of', what=said('images'), seconds=f'{silent_s:.0f}'),
                        'eol status says what the camera lacks',
                    ]
                )
            )
        self.hand_over(asked)
        self.pending[asked.kind] = asked
        return LATER

    def on_background(self, asked: Asked) -> None:
        self.lamps = b''  # a replay has those of that day, and not of today
        self.hand_over(asked)

    def on_covers(self, asked: Asked) -> None:
        self.covers = b''  # as above
        self.hand_over(asked)

    def read_jpeg(self, message: CompressedImage) -> images.Grey:
        began_s = time.perf_counter()
        taken = images.read_compressed(message)
        self.cost.add(message.format or 'compressed', time.perf_counter() - began_s)
        return taken

    def on_lens(self, info: CameraInfo) -> None:
        """Store what a driver states of its lens."""
        whole = info.binning_x < 2 and info.binning_y < 2 and not info.roi.width
        lens = Lens(
            info.distortion_model, (info.width, info.height), whole, tuple(info.k), tuple(info.d)
        )
        if lens != self.lens:
            self.lens, self.lens_compared = lens, None

    def compare_lens(self) -> None:
        """Compare the driver's lens with the calibration after either changes."""
        lens, calibration = self.lens, self.tracker.calibration
        if lens is None or calibration is None or calibration is self.lens_compared:
            return
        self.lens_compared, self.lens_differs = calibration, ''
        size = calibration.image_width, calibration.image_height
        finite = np.isfinite([*lens.k, *lens.d]).all()
        if not (lens.whole and lens.size == size and finite and lens.k[0] > 0 and lens.k[4] > 0):
            return  # not calibrated, or not for these images
        if lens.model != 'plumb_bob' or len(lens.d) > 5:
            self.get_logger().warning(
                f'camera/camera_info: distortion model {lens.model!r} cannot be compared with the '
                'calibration, only plumb_bob; check the calibration file'
            )
            return
        apart_px = calibration.lens_difference_px(lens.k, [*lens.d, *[0.0] * (5 - len(lens.d))])
        if apart_px > LENS_APART_PX:
            self.lens_differs = said('lens_differs', px=f'{apart_px:.1f}')

    def on_image(self, taken: images.Grey) -> None:
        self.stamp_ns, image = taken.stamp_ns + self.offset_ns, taken.pixels
        self.stamped(self.stamp_ns)
        if not self.images:
            self._begin_with(BACKGROUND, self.lamps)
            self._begin_with(COVERS, self.covers)
        self.gaps.take(self.stamp_ns)
        tracked = self.tracker.update(self.stamp_ns * 1e-9, image)
        self.blocks.publish(self._packed(tracked))
        self.health.took('image_to_blocks', (time.time_ns() - self.stamp_ns) * 1e-9)
        self.images += 1
        self.health.tick()
        self._tell(tracked)
        self._learn()
        if self.jpeg or not self.pictures.get_subscription_count():
            return
        if self.preview.due(self.stamp_ns, self.settings.preview_hz):
            self.preview.take(self.stamp_ns, image)

    def _covers_before(self) -> bytes:
        """Return what was learnt of the covers before a restart; nothing where it is damaged."""
        try:
            covers = base64.b64decode(self.resumed.get(COVERS, ''))
            if covers:
                learnt.check(covers, self.table.cells)
            return covers
        except (ConfigError, ValueError, TypeError) as error:
            self.get_logger().warning(f'learnt covers of the blocks are lost: {error}')
            return b''

    def _begin_with(self, kind: str, data: bytes) -> None:
        if data:
            self.tracker.requests.add(self.stamp_ns, kind, data)
            self.requests.declare(kind, {}, self.stamp_ns, data)

    def _learn(self) -> None:
        """Keep what was learned of the blocks for a restart of this node."""
        if self.sim_time or abs(self.stamp_ns * 1e-9 - self.learnt_s) < LEARNT_EVERY_S:
            return
        self.learnt_s = self.stamp_ns * 1e-9
        if covers := self.tracker.learned():
            self.covers = covers
            self.keep(**{COVERS: base64.b64encode(covers).decode()})

    def _packed(self, t: Tracked) -> bytes:
        rows = blocks.rows_of(t, self.writer.rows)
        return self.writer.pack(self.stamp_ns, t.state, t.symmetry_ambiguous, self.images, rows)

    def _tell(self, tracked: Tracked) -> None:
        self.health.values.update(
            seen=int(tracked.seen.sum()), state=STATES[tracked.state], missing=self.gaps.missing
        )
        self.tell_calibration()
        outcome = self.files.news(self.tracker, tracked.stamp_s)
        asked = self.pending.pop(outcome.kind, None) if outcome else None
        if outcome and asked:
            self.requests.answer(asked, not outcome.refused, outcome.text)
        self.files.look(self.tracker, tracked)
        good, text = self.files.words(tracked)
        self.compare_lens()
        if self.lens_differs:
            good, text = False, clauses([text, self.lens_differs])
        (self.health.ok if good else self.health.warn)(text)

    def _show(self, stamp_ns: int, jpeg: bytes) -> None:
        message = CompressedImage(format='mono8; jpeg compressed')
        message.header.stamp = to_msg(stamp_ns)
        message.header.frame_id = self.frame_prefix + images.FRAME_ID
        message.data.frombytes(jpeg)
        self.pictures.publish(message)

    def close(self) -> None:
        if not self.jpeg:
            self.preview.close()
