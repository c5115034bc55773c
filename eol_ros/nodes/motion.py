# SPDX-License-Identifier: Apache-2.0
"""Finds slips and cascades in the motion of the blocks."""

from eol_msgs.msg import BlockTap, Cascade, FeltSlip, Slip

from eol_ros.core.motion.felt import FeltSlip as Felt
from eol_ros.core.motion.motion import Motion
from eol_ros.ros.node import EolNode
from eol_ros.said import said
from eol_ros.streams import blocks, cascades, felt, slips, taps

TOLD = {felt.PROVISIONAL: 'felt', felt.CONFIRMED: 'confirmed', felt.RETRACTED: 'retracted'}


class MotionNode(EolNode):
    NAME = 'motion'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        self.motion = Motion(self.settings, self.table)
        self.slips = self.publisher('slips')
        self.felt_slips = self.publisher('felt_slips')
        self.cascades = self.publisher('cascades')
        self.felt = dict.fromkeys(TOLD, 0)
        self.health.expects(said('blocks_data'))
        self.subscribe('blocks', self.on_blocks)
        self.subscribe('block_taps', self.on_tap)

    def on_settings(self, new) -> None:
        self.motion.set(new)

    def restart(self) -> None:
        self.motion = Motion(self.settings, self.table)

    def time_jumped(self, jump_ns: int) -> None:
        """Motion sees it in the stamps themselves, as `eol report --retrack` does."""

    def on_tap(self, tap: BlockTap) -> None:
        self.tell_felt(self.motion.tap(taps.to_knock(taps.RECORD.take(tap))))

    def tell_felt(self, told: list[Felt], image_ns: int = 0) -> None:
        for one in told:
            row = felt.of(one, image_ns)
            self.felt_slips.publish(felt.RECORD.fill(FeltSlip(), row, self.frame_prefix))
            self.felt[one.kind] += 1

    def tell(self, stamp_ns: int, slip) -> None:
        row = slips.of(stamp_ns, slip)
        self.slips.publish(slips.RECORD.fill(Slip(), row, self.frame_prefix))

    def on_blocks(self, message: blocks.Blocks) -> None:
        self.stamped(message.stamp_ns)
        rows, stamp_s = message.rows, message.stamp_s
        # What begins goes out before anything else is thought of: light and sound wait for it.
        for slip in self.motion.starts(stamp_s, rows['x'], rows['y'], message.known, rows['sigma']):
            self.tell(message.stamp_ns, slip)
        self.tell_felt(self.motion.felt_slips(), message.stamp_ns)
        ended, closed = self.motion.stops(stamp_s)
        for slip in ended:
            self.tell(message.stamp_ns, slip)
        for cascade in closed:
            row = cascades.of(message.stamp_ns, cascade)
            self.cascades.publish(cascades.RECORD.fill(Cascade(), row, self.frame_prefix))
        self.health.tick()
        moving = int(self.motion.detector.moving.sum())
        self.health.values.update(
            moving=moving,
            slips=self.motion.detector.count,
            **{name: self.felt[kind] for kind, name in TOLD.items()},
        )
        still = said('still')
        self.health.ok(said('moving', moving=moving, all=self.table.count) if moving else still)
