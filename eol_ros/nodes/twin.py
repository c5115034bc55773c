# SPDX-License-Identifier: Apache-2.0
"""Simulates table, visitors and camera, so that the graph runs without hardware."""

from array import array
from collections import deque
from typing import NamedTuple

import numpy as np
from eol_msgs.msg import RimCommand, Truth

from eol_ros.core.physics.twin.live import Coupling
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.devices.board import block
from eol_ros.devices.board.felt import TRACE, FeltBlocks
from eol_ros.devices.board.twin import Lamps, Radio
from eol_ros.devices.camera.exposure_clock import VirtualCamera
from eol_ros.devices.files.twin_camera import twin_camera
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import NS, to_msg
from eol_ros.ros.startup_barrier import StartupBarrier
from eol_ros.said import said
from eol_ros.streams.requests import Asked

LONGEST_STEP_S = 0.1  # a machine that slept does not make up for it
HANDS = {
    'visitors': said('hands_visitors'),
    'nobody': said('hands_nobody'),
}


class Moment(NamedTuple):
    """The table as it is at `end_s`, and which blocks lit up since `begin_s`."""

    stamp_ns: int
    begin_s: float
    end_s: float
    truth: Truth
    velocity: np.ndarray
    lit: list[tuple[float, int]]


class TwinNode(EolNode):
    """rim_command, requests -> camera/image_raw, camera/camera_info, truth."""

    NAME = 'twin'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s, exposure_s = self.settings, self.settings.exposure_us * 1e-6
        calibration = twin_camera(s, self.table)
        options = RenderOptions(s.noise, exposure_s=exposure_s)
        self.renderer = Renderer(options, calibration, s.seed)
        felt = s.accelerometer and block.compiled()
        self.blocks = FeltBlocks(s, self.table) if felt else None
        if s.accelerometer and self.blocks is None:
            self.get_logger().warning(block.MISSING)
        self.radio, self.knocks = Radio(self.namespace), 0
        self.lamps = Lamps(self.radio, self.table)
        self.play = Play(s.seed, TRACE if self.blocks else 0, Coupling.of(s), self.table)
        self.image = np.empty((s.height, s.width), np.uint8)
        self.moments: deque[Moment] = deque()  # that no image has shown yet
        self.stamp_ns = 0
        self.told = '', ''  # whose hands, and who has the table, as last reported
        self.images = ImagePublisher(self, 'camera/image_raw', 'camera/camera_info', calibration)
        self.truth = self.publisher('truth')
        self.infrared: np.ndarray = np.ones(self.table.cells)  # light of each block
        self.subscribe('rim_command', self.on_rim_command)
        self.requests.serve(infrared=self.on_infrared)
        self.step(1e-4)  # compiles what is not compiled yet, before the clock runs
        self.render(0, [self.moment()])
        self.barrier, self.camera = StartupBarrier(self), None
        self.create_timer(0.1, self.check)

    def on_rim_command(self, command: RimCommand) -> None:
        velocity = command.vx, command.vy, command.yaw_rate
        self.play.commands.take(self.play.time_s, command.source, velocity, command.hold)

    def on_infrared(self, asked: Asked) -> None:
        mask = int(asked.values['mask'], 16)
        self.infrared = np.array([mask >> block & 1 for block in range(self.table.cells)])

    def move(self, stamp_ns: int) -> None:
        """Move hands, rim and table to `stamp_ns`; blocks report in their time what they feel.

        That is before they feel it: the image before is not even made yet.
        """
        span_s = (stamp_ns - self.stamp_ns) / NS if self.stamp_ns else 1 / self.settings.fps
        self.stamp_ns = stamp_ns
        self.step(min(max(span_s, 1e-4), LONGEST_STEP_S))
        self.moments.append(self.moment())

    def moment(self) -> Moment:
        """Return what an image of the table as it is now shows."""
        table, truth = self.play.table, Truth()
        truth.header.stamp = to_msg(self.stamp_ns)
        truth.header.frame_id = self.frame_prefix + 'table'
        truth.rim_x, truth.rim_y, truth.rim_yaw = table.rim_pose.tolist()
        truth.x, truth.y, truth.yaw = (
            array('d', v.tobytes()) for v in (table.x, table.y, table.yaw)
        )
        truth.moving = table.moving.tolist()
        truth.slips, truth.energy_residual = table.slips, table.energy_residual
        lit = list(self.blocks.lit) if self.blocks else []
        begin_s, end_s = self.begin_s, self.play.time_s
        return Moment(self.stamp_ns, begin_s, end_s, truth, table.velocity.copy(), lit)

    def expose(self, index: int, stamp_ns: int) -> None:
        """Render the table as it was at `stamp_ns`, and keep its true places for `deliver`."""
        moments = [self.moments.popleft()]
        while moments[-1].stamp_ns != stamp_ns:  # one whose image was skipped
            moments.append(self.moments.popleft())
        self.render(index, moments)
        self.packed, self.shown = self.images.packed(stamp_ns, self.image), moments[-1].truth

    def step(self, span_s: float) -> None:
        self.begin_s = self.play.advance(span_s, self.settings.hands == 'visitors')
        if self.blocks is None:
            return
        t, end_s = self.play.table, self.play.time_s
        knocks = self.blocks.advance(self.begin_s, end_s, t.trace, self.play.rim.velocity)
        origin_ns = self.stamp_ns - round(end_s * NS)
        self.radio.send(k._replace(time_ns=origin_ns + k.time_ns) for k in knocks)
        self.knocks += len(knocks)

    def render(self, index: int, moments: list[Moment]) -> None:
        """Make the image of the last of `moments`; before it are those that no image has shown."""
        for moment in moments:
            white, detector = self.lamps.advance(moment.begin_s, moment.end_s, moment.lit)
            if self.blocks and detector:
                self.blocks.configure(detector)
        at = moments[-1]
        self.renderer.render(
            np.asarray(at.truth.x), np.asarray(at.truth.y), np.asarray(at.truth.yaw), index,
            self.image, velocity=at.velocity, ir=self.infrared, flash=white,
        )  # fmt: skip

    def deliver(self) -> None:
        """Publish the image and what it shows."""
        self.images.send(self.packed)
        self.truth.publish(self.shown)
        self.health.tick()
        self.health.values['slips'] = self.shown.slips
        self.health.values['knocks'] = self.knocks
        self.health.values['hands'] = self.settings.hands
        self.health.values['playing'] = self.play.playing
        self.health.values['missed'] = self.camera.missed if self.camera else 0

    def check(self) -> None:
        s = self.settings
        if self.camera is None and self.barrier.ready():
            self.health.expects(said('images'))
            self.camera = VirtualCamera(
                s.fps, s.exposure_us * 1e-6, self.expose, self.deliver, move=self.move
            )
            self.health.watches('camera', self.camera.rounds)
        elif self.camera is not None and self.camera.fault:
            raise self.camera.fault
        if self.camera is not None and self.told != (now := (s.hands, self.play.playing)):
            self.told = now
            self.health.ok(
                said('twin', width=s.width, height=s.height, fps=f'{s.fps:g}', hands=HANDS[s.hands])
            )
            self.health.report()  # pages name who plays: do not wait for the next second

    def close(self) -> None:
        if self.camera is not None:
            self.camera.close()
        self.radio.close()
