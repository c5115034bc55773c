# SPDX-License-Identifier: Apache-2.0
"""Puts the work to sleep when its opening hours end, wakes it when they begin, and gives cues."""

import functools
import time
from dataclasses import replace

from eol_msgs.msg import RequestResult

from eol_ros.core.cue_times import CueTimes
from eol_ros.core.opening_hours import SLEEP, Door, OpeningHours
from eol_ros.devices.files import time_zone
from eol_ros.errors import ConfigError, UsageError, nearest
from eol_ros.ros.cues import cues_of, mistakes
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import LATER, REQUESTS, Answers, RequestClient, new_id
from eol_ros.said import Said, clauses, said
from eol_ros.streams.requests import CUE, KINDS, Asked

LOOK_S = 1.0
AGAIN_S = 2.0  # between requests to nodes that have not answered: they may be starting
PATIENCE_S = 20.0  # until silent nodes are reported, and a cue is given without them
DAY_S = 86400.0  # before a start, whose cues it gives where the work never opens or closes


class HoursNode(EolNode):
    """Sends the requests that people send with buttons, so that bags have them.

    A cue is a request, and so is each of its parts: a bag has both, with their results.
    """

    NAME = 'hours'
    HOLDS = False

    def __init__(self, settings, clock=time.time, **kwargs):
        super().__init__(settings, **kwargs)
        s, self.clock = self.settings, clock
        hours = OpeningHours(s.open, time_zone.load(s.time_zone))
        self.door = Door(hours, self.resumed.get('heeded_s'))
        self.asleep = bool(self.resumed.get('asleep'))
        there = {*self.scene.nodes, *self.scene.elsewhere, self.NAME}
        if found := [f'{name}: {what}' for name, what in mistakes(s.cues, s.cue_times, there)]:
            raise ConfigError('\n'.join(found))
        self.cues = cues_of(s.cues, there)
        self.times = CueTimes(s.cue_times, hours.zone, self.resumed.get('cued_s'))
        self.due: list[str] = []  # cues that wait for their nodes, and since when
        self.due_s = 0.0
        self.parts: dict[str, tuple[Asked, float, list[Answers]]] = {}  # of cues, by id
        self.refused: Said | str = ''  # requests of the last cue that failed, and why
        self.sleepers = (there - {self.NAME}) & set(KINDS[SLEEP].whom(''))
        self.kind = ''  # what is being asked of the work
        self.waits: set[str] = set()  # for the answers of these
        self.began_s = self.asked_s = 0.0
        self.client = RequestClient(self, self.requests.publisher)
        self.requests.serve(sleep=self.on_hand, wake=self.on_hand, cue=self.on_cue)
        self.requests.on_results(self.on_result)
        self.requests.on_results(self.client.heard)
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
        self.look_at_cues()
        self.report()

    def look_at_cues(self) -> None:
        since, now_s = self.door.state.since, self.clock()
        due = self.times.look(now_s, since.timestamp() if since else now_s - DAY_S)
        steady_s = time.monotonic()
        if due:
            self.due_s = self.due_s if self.due else steady_s
            self.due += due
        if self.due and (self.met() or steady_s - self.due_s > PATIENCE_S):
            due, self.due = self.due, []
            self.keep(cued_s=self.times.done_s)  # not before: a restart takes up cues that wait
            for name in due:
                asked = Asked(CUE, self.NAME, {'name': name}, id=new_id(self.NAME))
                self.requests.ask(asked)
                self.give(asked)
        for id_, (_, until_s, parts) in list(self.parts.items()):
            if steady_s > until_s:
                for answers in parts:
                    self.client.give_up(answers)
                self.given(id_)

    def met(self) -> bool:
        """Return whether all nodes of cues take requests: after a start some do not yet."""
        asked = {name for parts in self.cues.values() for _, names in parts for name in names}
        found = self.get_subscriptions_info_by_topic(self.resolve_topic_name(REQUESTS))
        there = {end.node_name for end in found}
        matched = self.requests.publisher.get_subscription_count()
        return asked <= there and matched >= len(there)

    def on_cue(self, asked: Asked) -> object:
        name = asked.values['name']
        if name not in self.cues:
            raise UsageError(said('no_cue', name=name, hint=nearest(name, self.cues)))
        self.give(asked)
        return LATER

    def give(self, asked: Asked) -> None:
        """Send the requests of a cue, in the order of its lines; `given` answers the cue."""
        parts: list[Answers] = []
        requests = self.cues[asked.values['name']]
        within_s = max(KINDS[one.kind].within_s for one, _ in requests)
        self.parts[asked.id] = asked, time.monotonic() + within_s, parts
        done = functools.partial(self.answered, asked.id)
        for one, expected in requests:
            parts.append(self.client.ask(replace(one, source=self.NAME), expected, done))

    def answered(self, id_: str, answers: Answers) -> None:
        if id_ in self.parts and all(one.whole for one in self.parts[id_][2]):
            self.given(id_)

    def given(self, id_: str) -> None:
        asked, _, parts = self.parts.pop(id_)
        failed = [one for one in parts if one.refusal or not one.whole]
        self.refused = clauses(
            said('of_request', request=one.asked.words(), why=one.refusal or one.silent)
            for one in failed
        )
        if failed:
            self.requests.refuse(asked, self.refused)
        else:
            self.requests.answer(asked, True, '')
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
        if self.cues:
            self.health.values['cues'] = list(self.cues)
        if following := self.times.next:
            shown = door.shown(following.at)
            text = clauses([text, said('next_cue', cue=following.cue, **shown)])
        if not door.trusted:
            date = time.strftime('%Y-%m-%d %H:%M', time.gmtime(self.clock()))
            self.health.warn(said('clock_untrusted', date=date))
        elif self.waits and time.monotonic() - self.began_s > PATIENCE_S:
            self.health.warn(
                clauses([text, said('no_answer_of', names=', '.join(sorted(self.waits)))])
            )
        elif self.refused:
            self.health.warn(clauses([text, self.refused]))
        else:
            self.health.ok(text)
