# SPDX-License-Identifier: Apache-2.0
"""Finds slips and cascades in the motion of the 25 blocks."""

import sys

from eol_msgs.msg import BlockTap, Cascade, Slip

from eol_ros.core.motion.cascades import CascadeEvent
from eol_ros.core.motion.motion import Motion, NumberedSlip
from eol_ros.ros.blocks import blocks_from_cdr
from eol_ros.ros.node import EolNode
from eol_ros.ros.run import runner
from eol_ros.ros.stamps import to_msg, to_ns


class MotionNode(EolNode):
    NAME = 'motion'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        self.motion = Motion(self.settings)
        self.slips = self.publisher('slips')
        self.cascades = self.publisher('cascades')
        self.health.expects('blocks')
        self.subscribe('blocks', self.on_blocks, raw=True)
        self.subscribe('block_taps', self.on_tap)

    def on_settings(self, new) -> None:
        self.motion.set(new)

    def restart(self) -> None:
        self.motion = Motion(self.settings)

    def time_jumped(self, jump_ns: int) -> None:
        """Motion sees it in the stamps themselves, as `eol report --retrack` does."""

    def on_tap(self, tap: BlockTap) -> None:
        self.motion.tap(to_ns(tap.header.stamp) * 1e-9, tap.block, tap.sigma)

    def on_blocks(self, raw: bytes) -> None:
        try:
            message = blocks_from_cdr(raw)
        except ValueError as error:
            return self.health.error(str(error))
        self.stamped(message.stamp_ns)
        blocks, stamp_s = message.blocks, message.stamp_ns * 1e-9
        seen = blocks['seen'] & (message.state == 1)  # Blocks.TRACKING
        # What begins goes out before anything else is thought of: light and sound wait for it.
        for slip in self.motion.starts(stamp_s, blocks['x'], blocks['y'], seen, blocks['sigma']):
            self.slips.publish(_slip_message(message.stamp_ns, slip))
        slips, cascades = self.motion.stops(stamp_s)
        for slip in slips:
            self.slips.publish(_slip_message(message.stamp_ns, slip))
        for cascade in cascades:
            self.cascades.publish(_cascade_message(message.stamp_ns, cascade))
        self.health.tick()
        moving = int(self.motion.detector.moving.sum())
        self.health.values.update(moving=moving, slips=self.motion.detector.count)
        self.health.ok(f'{moving} of 25 blocks move' if moving else 'all is still')


def _slip_message(stamp_ns: int, slip: NumberedSlip) -> Slip:
    event = slip.event
    message = Slip(
        kind=event.kind,
        slip=event.slip,
        block=event.block,
        onset=to_msg(round(event.onset_s * 1e9)),
        onset_sigma=event.onset_sigma_s,
        x=event.x,
        y=event.y,
        speed=event.speed_mps,
        distance=event.distance_m,
        duration=event.duration_s,
        cascade=slip.cascade,
        tapped=slip.tapped,
    )
    message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'table'
    return message


def _cascade_message(stamp_ns: int, event: CascadeEvent) -> Cascade:
    message = Cascade(
        cascade=event.cascade,
        onset=to_msg(round(event.onset_s * 1e9)),
        duration=event.duration_s,
        nucleus=event.nucleus,
        area=event.area,
        size=event.size,
        blocks=list(event.blocks),
        distance=event.distance_m,
    )
    message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'table'
    return message


main = runner(MotionNode)

if __name__ == '__main__':
    sys.exit(main())
