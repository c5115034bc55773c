# SPDX-License-Identifier: Apache-2.0
"""Lights the blocks whose slips only the camera saw, and publishes the taps of the blocks.

The packet with the light of a slip is written inside the callback that brings the slip, and carries
the stamp of its image. What a block lights by itself has the stamp of its knock, that is of the
tap; the levels of the decay that follows have none.
"""

import numpy as np
from eol_msgs.msg import BlockTap, LedCommand, Slip

from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.board.board import State
from eol_ros.devices.board.lights import FRAME_HZ, Lights, Played, Sent, Tap
from eol_ros.errors import EolError
from eol_ros.nodes.leds_infrared import Infrared
from eol_ros.ros.main_clock import MainClock
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import LATER
from eol_ros.ros.stamps import to_ns
from eol_ros.said import clauses
from eol_ros.streams import blocks, leds, slips, taps
from eol_ros.streams.osc import poses, strains
from eol_ros.streams.requests import Asked


class LedsNode(EolNode):
    """slips, block_taps, requests -> led_commands, block_taps."""

    NAME = 'leds'
    MAPS_TIME = True

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        played = Played(self.wall_ns, self.recorded_ns, self.stretch) if self.sim_time else None
        self.lights = Lights(
            self.settings, self.on_tap, self.on_state, played, self.namespace, self.table,
            self.stress,
        )  # fmt: skip
        self.lights.asleep = bool(self.resumed.get('asleep'))
        self.relearns = False  # the background, as soon as the lights have fallen asleep
        self.commands = self.publisher('led_commands')
        # Behind a replay the taps are those of its bag, and a knock of today does not count.
        self.taps = None if self.sim_time else self.publisher('block_taps')
        self.frames = self.create_timer(1 / FRAME_HZ, self.on_frame, autostart=False)
        self.idle = self.create_timer(1.0, self.on_idle, autostart=False)
        self.infrared = Infrared(self, self.lights, self.tell)
        self.health.watches('board', self.lights.board.rounds)
        if self.lights.twin:
            self.health.watches('radio', self.lights.twin.rounds)
            self.health.watches('fake board', self.lights.twin.fake.rounds)
        self.create_timer(1.0, self.on_second)
        self.main_clock: MainClock = MainClock(self)
        self.blocks: blocks.Blocks | None = None
        self.sees_blocks = False
        self.see_blocks(self.settings)
        self.subscribe('slips', self.on_slip)
        self.subscribe('block_taps', self.on_own_tap)
        self.requests.serve(
            sleep=self.on_sleep,
            wake=self.on_sleep,
            test=self.on_test,
            learn_background=self.on_learn_background,
        )
        self.lights.start()

    def on_settings(self, new) -> None:
        self.lights.set(new)
        self.see_blocks(new)
        self.idle.cancel()
        self.await_idle()

    def see_blocks(self, new) -> None:
        """Subscribe to the places of blocks where idle light needs them."""
        if new.idle_by_stress and not self.sees_blocks:
            self.sees_blocks = True
            self.subscribe('blocks', self.on_blocks)

    def on_blocks(self, message: blocks.Blocks) -> None:
        self.blocks = message

    def stress(self) -> np.ndarray:
        """Return the stress of each place by the last image, (cells,); NaN where not known."""
        if self.blocks is None:
            return np.full(self.table.cells, np.nan)
        at = poses(self.blocks.rows, self.blocks.state == TRACKING)
        return strains(at, self.scene.settings('grains').ambience_break_m, self.table)

    def restart(self) -> None:
        self.lights.restart()

    def time_jumped(self, jump_ns: int) -> None:
        """The lights follow the clock, so that the limit of flashes holds over the jump."""

    def on_slip(self, slip: Slip) -> None:
        self.stamped(to_ns(slip.header.stamp))
        if slip.kind == slips.START:
            ahead_ns = self.main_clock.ahead_ns
            took_s = self.lights.slip(
                slip.block, to_ns(slip.header.stamp), to_ns(slip.onset), ahead_ns
            )
            if took_s is not None:
                self.health.took('onset_to_light', took_s)
            self.health.tick()
            self.fade()

    def on_own_tap(self, tap: BlockTap) -> None:
        """A tap that this node has published, or a replay."""
        self.lights.tap(tap.block, to_ns(tap.header.stamp), tap.board_time_us)
        self.fade()

    def fade(self) -> None:
        if self.lights.glows:
            self.resume(self.frames)

    def on_frame(self) -> None:
        self.tell(self.lights.frame())
        if not self.lights.glows:
            self.frames.cancel()
            self.await_idle()

    def await_idle(self) -> None:
        """Wake up when idle light is due; until then no frames are needed."""
        wait_s = self.lights.idle_in_s
        if wait_s is not None:
            self.resume(self.idle, max(wait_s, 1 / FRAME_HZ))

    def on_idle(self) -> None:
        self.idle.cancel()
        self.on_frame()
        self.fade()

    def tell(self, sent: list[Sent]) -> None:
        for one in sent:  # none while the line is down: health says so
            row = leds.of(one, self.recorded_ns(one.sent_ns))
            self.commands.publish(leds.RECORD.fill(LedCommand(), row))

    def on_tap(self, tap: Tap) -> None:
        if self.taps is not None:
            self.taps.publish(taps.RECORD.fill(BlockTap(), taps.of(tap)))

    def on_learn_background(self, asked: Asked) -> object:
        self.infrared.darken(asked.id)
        return LATER  # the tracker says what came of it

    def on_sleep(self, asked: Asked) -> None:
        self.lights.asleep = asked.kind == 'sleep'
        self.keep(asleep=self.lights.asleep)
        self.health.values['asleep'] = self.lights.asleep
        s = self.settings
        self.relearns = self.lights.asleep and s.relearn_background_on_sleep and not self.sim_time
        self.relearn()
        self.fade()

    def relearn(self) -> None:
        """Let the background be learnt once the lights have fallen asleep."""
        if self.relearns and self.lights.dark:
            self.relearns = False
            try:
                self.infrared.darken()
            except EolError as error:  # it sleeps all the same
                self.get_logger().warning(f'background not learnt: {error}')

    def on_test(self, asked: Asked) -> None:
        self.lights.test(self.now_ns())
        self.fade()

    def on_second(self) -> None:
        self.lights.follow_firmware()
        self.await_idle()
        self.relearn()
        self.health.values.update(self.lights.values(), asleep=self.lights.asleep)
        if self.lights.board.ready:
            self.on_state(self.lights.board.state)

    def on_state(self, state: State) -> None:
        report = {'ready': self.health.ok, 'refused': self.health.error}
        faults = self.lights.faults() if state.kind == 'ready' else []
        if faults:
            self.health.warn(clauses(faults))
        else:
            text = clauses([state.text, self.main_clock.report()])
            report.get(state.kind, self.health.warn)(text)

    def close(self) -> None:
        self.lights.close()
