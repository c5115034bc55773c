# SPDX-License-Identifier: Apache-2.0
"""Puts the work to sleep when its opening hours end, and wakes it when they begin."""

import sys
import time

from eol_msgs.msg import RequestResult

from eol_ros.core.opening_hours import SLEEP, Door, OpeningHours
from eol_ros.devices.files import time_zone
from eol_ros.ros.node import EolNode
from eol_ros.ros.run import runner
from eol_ros.said import clauses, said
from eol_ros.streams.requests import KINDS, Asked

LOOK_S = 1.0
AGAIN_S = 2.0  # who has not answered is asked again: it may be starting
PATIENCE_S = 20.0  # then that is told


class HoursNode(EolNode):
    """Asks what people ask with the buttons Sleep and Wake, so that bags show it."""

    NAME = 'hours'
    HOLDS = False

    def __init__(self, settings, clock=time.time, **kwargs):
        super().__init__(settings, **kwargs)
        s, self.clock = self.settings, clock
        hours = OpeningHours(s.open, time_zone.load(s.time_zone))
        self.door = Door(hours, self.resumed.get('heeded_s'))
        self.asleep = bool(self.resumed.get('asleep'))
        there = {*self.scene.nodes, *self.scene.elsewhere} - {self.NAME}
        self.sleepers = there & set(KINDS[SLEEP].whom(''))
        self.kind = ''  # what is being asked of the work
        self.waits: set[str] = set()  # for the answers of these
        self.began_s = self.asked_s = 0.0
        self.requests.serve(sleep=self.on_hand, wake=self.on_hand)
        self.requests.on_results(self.on_result)
        self.create_timer(LOOK_S, self.look)
        self.look()

    def look(self) -> None:
        kind, now_s = self.door.look(self.clock()), time.monotonic()
        if kind != self.kind:
            self.kind, self.began_s = kind, now_s
            self.waits = set(self.sleepers) if kind else set()
            self.asleep = kind == SLEEP if kind else self.asleep
            if self.waits:
                self.ask([''])
        elif self.waits and now_s - self.asked_s > AGAIN_S:
            self.ask(sorted(self.waits))
        if self.kind and not self.waits:
            self.heed()
        self.report()

    def ask(self, nodes: list[str]) -> None:
        self.asked_s = time.monotonic()
        for node in nodes:
            self.requests.ask(Asked(self.kind, node))

    def on_result(self, result: RequestResult) -> None:
        if result.kind == self.kind:
            self.waits.discard(result.node)
            if not self.waits:
                self.heed()

    def on_hand(self, asked: Asked) -> str:
        """People have the last word until the next change."""
        self.asleep = asked.kind == SLEEP
        self.heed()
        return self.door.words(self.asleep)

    def heed(self) -> None:
        self.kind, self.waits = '', set()
        self.door.heed()
        self.keep(heeded_s=self.door.heeded_s, asleep=self.asleep)
        self.report()

    def report(self) -> None:
        door = self.door
        until = door.state.until
        self.health.values.update(
            asleep=self.asleep,
            open=door.state.open,
            trusted=door.trusted,
            until_s=round(until.timestamp()) if until else 0,
            time_zone=self.settings.time_zone,
        )
        text = door.words(self.asleep)
        if not door.trusted:
            date = time.strftime('%Y-%m-%d %H:%M', time.gmtime(self.clock()))
            self.health.warn(said('clock_untrusted', date=date))
        elif self.waits and time.monotonic() - self.began_s > PATIENCE_S:
            self.health.warn(
                clauses([text, said('no_answer_of', names=', '.join(sorted(self.waits)))])
            )
        else:
            self.health.ok(text)


main = runner(HoursNode)

if __name__ == '__main__':
    sys.exit(main())
