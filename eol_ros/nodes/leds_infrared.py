# SPDX-License-Identifier: Apache-2.0
"""The infrared light of the blocks over time: dark for a moment, or one block that blinks."""

from eol_ros.devices.board.lights import Sent
from eol_ros.errors import EolError
from eol_ros.ros.stamps import NS
from eol_ros.said import said
from eol_ros.streams.requests import Asked

DARKNESS_S = 1.5  # the tracker looks at the table without infrared for this long
FADE_NS = 60_000_000  # less at both ends: bytes, LEDs and exposures take their time


class Infrared:
    """Timers of `node`; `tell` takes each packet. What others must know is asked of them."""

    def __init__(self, node, lights, tell):
        s = node.settings
        self.node, self.lights, self.tell = node, lights, tell
        self.all = (1 << node.table.cells) - 1
        self.dark = False
        self.relight = node.create_timer(DARKNESS_S, self.light, autostart=False)
        if s.blink_block >= 0:
            node.create_timer(s.blink_period_s, lambda: self.blink(s.blink_block))

    def darken(self, id_: str = '') -> None:
        """Switch all off for a moment, and tell the tracker from when to when; it answers `id_`.

        Raises EolError where there is no light to be switched off.
        """
        if self.node.sim_time:
            raise EolError(said('replayed_dark'))
        sent = self._switch(0)
        if sent is None:
            raise EolError(said('no_board', why=self.node.health.text))
        self.dark = True
        self._light_in(DARKNESS_S)
        until_ns = sent.sent_ns + round(DARKNESS_S * NS) - FADE_NS
        from_ns = sent.sent_ns + FADE_NS
        values = {'until_ns': until_ns}
        self.node.requests.ask(Asked('darkness', 'tracker', values, b'', from_ns, id_))

    def blink(self, block: int) -> None:
        """Switch one block off for a moment, unless all are."""
        if not self.dark:
            self._switch(self.all & ~(1 << block))
            self._light_in(self.node.settings.blink_off_s)

    def light(self) -> None:
        self.relight.cancel()
        self.dark = False
        self._switch(self.all)

    def _light_in(self, wait_s: float) -> None:
        self.relight.cancel()
        self.node.resume(self.relight, wait_s)

    def _switch(self, mask: int) -> Sent | None:
        told = self.lights.infrared(mask)
        self.tell(told)
        if not told:
            return None
        if self.lights.twin:  # what the twin's camera sees of it
            self.node.requests.ask(Asked('infrared', 'twin', {'mask': f'{mask:x}'}))
        return told[-1]
