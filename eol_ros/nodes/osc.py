# SPDX-License-Identifier: Apache-2.0
"""Connects other programs by OSC and TUIO: the graph's events out, requests and settings in."""

import functools
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from eol_ros.core.sound.senses import FirstSense
from eol_ros.core.tuio import Tokens, tuio1, tuio2
from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.osc import IMMEDIATELY, OscIn, Peer, TimeTag, bundle, encode
from eol_ros.devices.udp import UdpOut
from eol_ros.errors import ConfigError, EolError, printable
from eol_ros.ros.main_clock import MainClock
from eol_ros.ros.node import EolNode
from eol_ros.ros.parameters import checked_live
from eol_ros.ros.requests import Answers, RequestClient, expected_of
from eol_ros.ros.stamps import to_ns
from eol_ros.said import clauses, code_and_args, said
from eol_ros.streams import osc, triggers
from eol_ros.streams.graph import NODES, full_name
from eol_ros.streams.requests import SET, Asked
from eol_ros.streams.work_state import States

LOOK_S = 0.05
FULL = 30_000  # bytes that wait for a bundle: UDP carries 64 KB
MOST_OPEN = 256  # requests that wait for their answers
WARN_S, WARNED = 60.0, 20  # one warning an address, of so many addresses


class OscNode(EolNode):
    """Time tags are system time, as the clock of the machine has it when an image is exposed."""

    NAME = 'osc'
    MAPS_TIME = True
    READS_ONLY = True
    REST_S = 0.002

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s = self.settings
        names = osc.addresses(s.send, self.namespace)
        self.outs, self.tuio, self.tuio2 = (
            [UdpOut(target, s.send_from) for target in targets]
            for targets in (s.send_to, s.tuio, s.tuio2)
        )
        self.all = [*self.outs, *self.tuio, *self.tuio2]
        if not self.all and not s.port:
            raise ConfigError(osc.IDLE)
        self.to = names if self.outs else {}
        self.there = {*self.scene.nodes, *self.scene.elsewhere}
        self.sent = self.refused = 0
        # by time and targets: who sends what goes out together, and its size in all
        self.leaving: dict[tuple, tuple[list[Callable[[bytes], None]], list[bytes]]] = {}
        self.leaving_size = 0
        self.warned: dict[str, float] = {}  # addresses, and when
        self.input = OscIn(s.port, s.peers, s.peer_rate_hz) if s.port else None
        if self.input:
            self.set_up_input()
        self.main_clock: MainClock = MainClock(self)
        self.set_up_output()
        self.create_timer(1.0, self.report)
        self.create_timer(osc.AGAIN_S, self.again)
        self.report()

    def set_up_output(self) -> None:
        s, here = self.settings, self.to.keys()
        self.tokens = Tokens(self.table)
        least = np.array([osc.MOVED_M, osc.MOVED_M, osc.TURNED_RAD, 0.0])
        self.poses, self.tracking = osc.Changes(s.rate_hz, least), osc.Changes(s.rate_hz)
        self.stress = osc.Changes(s.rate_hz, osc.STRESSED)
        self.meter = osc.Changes(s.rate_hz)
        self.lights: osc.Values = ()
        self.break_m = self.scene.settings('grains').ambience_break_m
        if here & {'block', 'tracking', 'stress'} or self.tuio or self.tuio2:
            self.subscribe('blocks', self.on_blocks)
        for name, topic in (
            ('slip', 'slips'),
            ('provisional', 'felt_slips'),
            ('cascade', 'cascades'),
        ):
            if name in here:
                self.subscribe(topic, functools.partial(self.tell, name))
        if 'wall' in here:
            self.subscribe('wall', self.on_wall)
        if 'lights' in here:
            self.subscribe('led_commands', self.on_lights)
        if 'meter' in here:
            self.subscribe('sound_meter', self.on_meter)
        self.grains, self.first, self.described_s = osc.GrainValues(), FirstSense(), 0.0
        if here & {'grain', 'descriptors'}:
            self.subscribe('corpus', self.on_corpus)
        if 'grain' in here:
            self.subscribe('grain_triggers', self.on_grain)
            self.subscribe('felt_triggers', functools.partial(self.on_grain, felt=True))
        self.state: tuple[str, str] | None = None  # code and text, of the whole work
        self.states = None if 'panel' in self.there else States(self.there, time.monotonic())
        self.levels: dict[str, int] = {}
        if 'state' in here and not self.states:
            self.subscribe('work_state', lambda m: self.on_state((m.code, m.text)))
        if 'health' in here or ('state' in here and self.states):
            self.on_states(self.on_node)

    def set_up_input(self) -> None:
        self.client = RequestClient(self, self.publisher('requests'))
        self.sets = full_name('set/', self.namespace)
        self.subscribe('request_results', self.client.heard)
        self.create_timer(LOOK_S, self.look)

    def send(self, name: str, lines: list[osc.Values], stamp_ns: int = 0) -> None:
        """Send messages in one bundle with the time of `stamp_ns`, or of now where it is 0."""
        if name in self.to and lines:
            unix_ns = self.wall_ns(stamp_ns) if stamp_ns else time.time_ns()
            self.transmit(self.outs, unix_ns, [(self.to[name], *line) for line in lines])

    def transmit(self, outs: list[UdpOut], unix_ns: int, messages: list) -> None:
        """Send messages in one bundle with all others of this time that arrive with them."""
        key = unix_ns, *map(id, outs)
        self.gather(key, [out.send for out in outs], [encode(*message) for message in messages])
        self.sent += len(messages)
        self.health.tick(len(messages))

    def gather(self, key: tuple, sends: list, packets: list[bytes]) -> None:
        """Let packets of one time and receiver wait for the others that are on their way."""
        if not self.leaving and self.executor is not None:
            self.executor.create_task(self.flush)
        self.leaving.setdefault(key, (sends, []))[1].extend(packets)
        self.leaving_size += sum(map(len, packets))
        if self.leaving_size > FULL:
            self.flush()

    def flush(self) -> None:
        """Send what waits, a bundle for each time and receiver; a single reply without."""
        leaving, self.leaving, self.leaving_size = self.leaving, {}, 0
        for (unix_ns, *_), (sends, messages) in leaving.items():
            tag = TimeTag.of(unix_ns) if unix_ns else IMMEDIATELY
            packet = bundle(tag, messages) if unix_ns or len(messages) > 1 else messages[0]
            for send in sends:
                send(packet)

    def tell(self, name: str, message) -> None:
        self.send(name, [osc.ROWS[name].of(message)], to_ns(message.header.stamp))

    def on_blocks(self, message) -> None:
        self.stamped(message.stamp_ns)
        rows, known, now_s = message.rows, message.state == TRACKING, time.monotonic()
        poses = osc.poses(rows, known)
        there = np.isfinite(poses).all(axis=1)
        if 'block' in self.to:
            numbers = self.poses.rows(np.column_stack([poses, rows['seen']]), now_s).tolist()
            lines = [
                (k, *poses[k].tolist(), float(rows['sigma'][k]), int(rows['seen'][k]))
                for k in numbers
                if there[k]
            ]
            self.send('block', lines, message.stamp_ns)
        if 'tracking' in self.to:
            state = message.state, int(there.sum())
            if len(self.tracking.rows(np.array([state]), now_s)):
                self.send('tracking', [state], message.stamp_ns)
        if 'stress' in self.to:
            found = osc.strains(poses, self.break_m, self.table)
            if len(self.stress.rows(found[None], now_s)):
                self.send('stress', [tuple(found.tolist())], message.stamp_ns)
        if self.tuio or self.tuio2:
            self.send_tokens(message.stamp_ns, poses)

    def send_tokens(self, stamp_ns: int, poses: np.ndarray) -> None:
        frame = self.tokens.frame(stamp_ns * 1e-9, poses)
        unix_ns = self.wall_ns(stamp_ns)
        for out in self.tuio:
            self.transmit([out], unix_ns, tuio1(frame, self.namespace, out.own))
        for out in self.tuio2:
            tag, size = TimeTag.of(unix_ns), self.table.platform_m
            self.transmit([out], unix_ns, tuio2(frame, tag, size, self.namespace, out.own))

    def on_wall(self, message) -> None:
        self.send('wall', [osc.ROWS['wall'].of(message)], to_ns(message.flip))

    def on_lights(self, message) -> None:
        levels = tuple(message.white)
        if levels != self.lights:  # the last of all must not get lost: no limit of the rate
            self.lights = levels
            self.send('lights', [levels], to_ns(message.header.stamp))

    def on_meter(self, message) -> None:
        values = osc.ROWS['meter'].of(message)
        if len(self.meter.rows(np.array([values]), time.monotonic())):
            self.send('meter', [values], to_ns(message.header.stamp))

    def on_corpus(self, message) -> None:
        if self.grains.take(message, to_ns(message.header.stamp)):
            self.describe()

    def describe(self) -> None:
        self.described_s = time.monotonic()
        self.send('descriptors', [self.grains.names])

    def on_grain(self, message, felt: bool = False) -> None:
        stamp_ns, m = to_ns(message.header.stamp), message
        by_hand = m.block == triggers.NO_BLOCK
        if not by_hand and not self.first.plays(stamp_ns * 1e-9, m.block, m.grain, felt):
            return
        if self.grains.names and time.monotonic() > self.described_s + osc.AGAIN_S:
            self.describe()
        known = self.grains.of(m.grain, stamp_ns)
        self.send('grain', [(m.block, m.grain, m.gain, m.rate, m.pan, *known)], stamp_ns)

    def on_node(self, message) -> None:
        if self.levels.get(message.node) != message.level:
            self.levels[message.node] = message.level
            self.send('health', [(message.node, message.level, message.text)])
        if self.states:
            self.states.take(message, time.monotonic())
            state = self.states.work(time.monotonic())
            self.on_state((code_and_args(state)[0], str(state)))

    def on_state(self, state: tuple[str, str]) -> None:
        if state != self.state:
            self.state = state
            self.send('state', [state])

    def again(self) -> None:
        if self.state:
            self.send('state', [self.state])
        if self.lights:
            self.send('lights', [self.lights])
        for out in self.all:
            out.resolve()

    def look(self) -> None:
        """Do what peers ask, in order; settings of one node that come together are one request.

        Of a setting that comes several times, the last counts; requests of one machine that are
        alike are one.
        """
        assert self.input is not None  # there is a timer only then
        latest: dict[tuple, tuple[list[tuple[Peer, str]], list]] = {}
        for peer, (address, *values) in self.input.take(time.monotonic(), self.warn):
            is_set = address.startswith(self.sets)
            key = (address,) if is_set else (peer.host, address, repr(values))
            alike, _ = latest.pop(key, ([], []))
            senders = [] if is_set else alike
            senders.append((peer, address))
            latest[key] = senders, values
        together: dict[tuple[str, str], tuple[Asked, list[tuple[Peer, str]]]] = {}
        for senders, values in latest.values():
            asked = self.read(senders, values)
            if asked is None:
                continue
            if asked.kind == SET:
                first, others = together.get((asked.source, asked.node), (asked, []))
                asked = replace(asked, values=first.values | asked.values)
                together[asked.source, asked.node] = asked, [*others, *senders]
                continue
            for one in together.values():
                self.ask(*one)
            together = {}
            self.ask(asked, senders)
        for one in together.values():
            self.ask(*one)
        self.client.look()

    def read(self, senders: list[tuple[Peer, str]], values: list) -> Asked | None:
        """Return the request of a message; None for a button let go, and for what is refused."""
        peer, address = senders[-1]
        try:
            asked = osc.asked_of(address, values, self.namespace)
            if asked is None:
                return None
            if asked.kind == SET:
                kind = NODES[asked.node].settings
                asked = replace(asked, values=checked_live(kind, asked.node, asked.values))
        except EolError as error:
            self.refuse(senders, str(error))
            return None
        return replace(asked, source=f'osc {peer.host}')

    def ask(self, asked: Asked, senders: list[tuple[Peer, str]]) -> None:
        try:
            if self.client.waiting >= MOST_OPEN:
                raise EolError(f'{MOST_OPEN} requests wait for their answers already')
            expected = expected_of(asked.kind, asked.node, self.there.__contains__)
        except EolError as error:
            return self.refuse(senders, str(error))
        self.client.ask(asked, expected, functools.partial(self.answered, senders))

    def answered(self, senders: list[tuple[Peer, str]], answers: Answers) -> None:
        if answers.refusal or not answers.whole:
            return self.refuse(senders, answers.refusal or answers.silent)
        self.reply(senders, 1, answers.text)

    def refuse(self, senders: list[tuple[Peer, str]], why: str) -> None:
        self.refused += len(senders)
        for address in {address for _, address in senders}:
            self.warn(address, why)
        self.reply(senders, 0, why)

    def reply(self, senders: list[tuple[Peer, str]], done: int, text: str) -> None:
        assert self.input is not None
        name, text = full_name('reply', self.namespace), printable(text)
        for peer, address in senders:
            to = Peer(peer.host, self.settings.reply_port or peer.port)
            packet = encode(name, printable(address)[:200], done, text)
            self.gather((0, *to), [functools.partial(self.input.reply, to)], [packet])

    def warn(self, what: str, why: str) -> None:
        """Warn of what is not done, once an address or host and a minute."""
        now_s = time.monotonic()
        self.warned = {a: s for a, s in self.warned.items() if now_s - s < WARN_S}
        if what not in self.warned and len(self.warned) < WARNED:
            self.warned[what] = now_s
            self.get_logger().warning(f'OSC {printable(what)[:200]}: {printable(why)}')

    def report(self) -> None:
        self.health.values['sent'] = self.sent
        told = []
        if self.all:
            targets = ', '.join(dict.fromkeys(out.target for out in self.all))
            told.append(said('osc_to', targets=targets))
        if self.input:
            names = ('received', 'malformed', 'dropped', 'strangers')
            self.health.values.update({name: getattr(self.input, name) for name in names})
            self.health.values['refused'] = self.refused
            told.append(said('osc_port', port=self.input.port))
        trouble = [said('osc_unsent', why=out.trouble) for out in self.all if out.trouble]
        (self.health.warn if trouble else self.health.ok)(
            clauses([*trouble, *told, self.main_clock.report()])
        )

    def restart(self) -> None:
        self.tokens.forget()
        self.first = FirstSense()

    def close(self) -> None:
        if self.tuio or self.tuio2:  # no block is known any more
            self.send_tokens(self.now_ns(), np.full((self.table.cells, 3), np.nan))
        self.flush()
        for end in (*self.all, self.input):
            if end:
                end.close()
