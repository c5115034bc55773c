# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into the graph: the recorded bytes, stamps unchanged, and their time on `/clock`."""

import threading
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from eol_msgs.msg import Calibration
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock

from eol_ros.core.table import Table, check_same
from eol_ros.devices.bag.player import BagPlayer, Played, choose, complete
from eol_ros.devices.bag.reader import BagMessage, BagReader, table_in
from eol_ros.devices.bag.requests import heeded
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.files import calibration_file
from eol_ros.devices.rounds import Rounds
from eol_ros.errors import ConfigError
from eol_ros.ros.definitions import is_installed
from eol_ros.ros.node import EolNode
from eol_ros.ros.played import BLOCKS, IMAGES, REQUESTS, TAPS, played
from eol_ros.ros.player_services import serve_player
from eol_ros.ros.requests import new_id, request_to_msg
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.ros.startup_barrier import StartupBarrier
from eol_ros.ros.topics import CLOCK, CLOCK_QOS, QOS, UNKNOWN_NODE, message_class, with_depth
from eol_ros.said import said
from eol_ros.streams import calibrations, tables
from eol_ros.streams.graph import FORMER_TYPES, TOPICS, relative_name
from eol_ros.streams.requests import Asked, ahead, meanwhile

READY_S = 1.0  # from the last reader found to the first message
ACKNOWLEDGED_S = 2.0  # longest wait for readers to say that they have all
LOOK_S = 0.02  # in pieces of this: rclpy keeps Python's lock while it waits
DISK_S, DISK_HUNG_S = 5.0, 60.0  # time limits for a chunk of the bag on a slow disk
CLOCK_S = 0.01  # from message to message on /clock, also while none of the bag is due
FAST_DEPTH = 10  # messages given in one go where readers set the pace: well within their queues


class ReplayNode(EolNode):
    NAME = 'replay'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s = self.settings
        if not s.bag:
            raise ConfigError('replay.bag: name a bag folder or an .mcap file')
        self.bag = BagReader(s.bag)
        recorded = self.bag.name  # in another namespace than this one, maybe
        usual = [recorded(topic) for topic in played(self.scene, complete(self.bag))]
        self.names = choose(self.bag, s.topics, usual)
        # Requests are asked again, by today's definition; topics asked for by name go as they are.
        self._asked_on = () if s.topics else (recorded(REQUESTS),)
        self._former: set[str] = set()  # topics whose messages are converted
        self.publishers_of = self._make_publishers()
        self._given: Counter[Publisher] = Counter()  # since its readers said that they have all
        self._unanswered: set[Publisher] = set()  # a reader of theirs did not say so in time
        self._asks: Any = None
        self._ahead: list[Asked] = []
        self._then: dict[int, Asked] = {}
        if self._asked_on and self._asked_for():
            self._prepare_requests()
        self.rounds = Rounds()
        self.health.watches('replay', self.rounds, DISK_S, DISK_HUNG_S)
        self.player = BagPlayer(
            self.bag,
            Played(self.names, [recorded(IMAGES), recorded(BLOCKS)], [recorded(TAPS)]),
            self.give,
            s,
            begin=self.begin,
            sleep=self._nap,
        )
        self.barrier = StartupBarrier(self)
        self._there: Table | None = None  # of the running graph that it plays into
        if not self.barrier.expects:
            self.subscribe('table', self._on_table)
        self.state, self.fault = 'waiting', None
        for line in self.bag.cut_short:
            self.get_logger().warning(line)
        self.clock = self.create_publisher(Clock, CLOCK, CLOCK_QOS)
        self.create_timer(CLOCK_S, self.tick)
        serve_player(self, self.player)
        self._stop = threading.Event()
        if s.fast or s.rate > 1:  # it must not keep readers from what they are given
            self._thread = threading.Thread(target=self._play, name='replay', daemon=True)
        else:
            self._thread = carrier_thread('replay', self._play)
        self._thread.start()
        self.create_timer(0.2, self.tell)

    def on_settings(self, new) -> None:
        self.player.rate = new.rate

    def _make_publishers(self) -> dict[str, Publisher]:
        """Return the publishers of what is played; what cannot be is left out, and named.

        Raises ConfigError where nothing is left.
        """
        found, errors = {}, {}
        for name in self.names:
            if name in self._asked_on:
                continue
            try:
                found[name] = self._publisher(name)
            except ConfigError as error:
                errors[name] = error
        self.names = [name for name in self.names if name not in errors]
        if not found and errors:
            raise next(iter(errors.values()))
        for why in errors.values():
            self.get_logger().warning(f'{why}: left out')
        return found

    def _publisher(self, name: str):
        recorded = self.bag.topics[name]
        if recorded.foreign:
            raise ConfigError(
                f'{self.bag.path}: {name}: its messages are {recorded.foreign}, not those of ROS 2'
            )
        try:
            kind, known = (
                message_class(recorded.type),
                is_installed(recorded.type, recorded.definition, recorded.type_hash),
            )
        except (ImportError, AttributeError, ValueError):
            package = recorded.type.partition('/')[0]
            raise ConfigError(
                f'{self.bag.path}: {name}: {recorded.type} is not installed here; install the '
                f'package {package}'
            ) from None
        if not known:
            raise ConfigError(
                f'{self.bag.path}: {name} was recorded with another definition of {recorded.type} '
                'than the installed one; it can be analysed, and not be played'
            )
        topic, name = name, relative_name(recorded.name, self.bag.namespace)
        depth = FAST_DEPTH if self.settings.fast else None
        ours = TOPICS.get(name)
        if former := recorded.type == FORMER_TYPES.get(name):
            self._former.add(topic)
        if ours and (former or ours.type_name == recorded.type):
            return self.publisher(name, depth)
        qos = with_depth(QOS['latched' if recorded.latched else 'stream'], depth)
        return self.create_publisher(kind, name, qos)

    def _asked_for(self) -> bool:
        """Whether a node of the scene heeds requests, or the scene is not known."""
        nodes = set(self.scene.nodes) - {'replay', 'recorder'}
        return not nodes or bool(nodes & set(TOPICS[REQUESTS].subscribers))

    def _prepare_requests(self) -> None:
        found = heeded(self.bag)
        if not found:
            return
        self._asks = self.publisher(REQUESTS)
        self.publishers_of[self.bag.name(REQUESTS)] = self._asks
        self._ahead = ahead(found, self.bag.start_ns + round(self.settings.start_s * 1e9))
        self._then = meanwhile(found)

    def ask(self, asked: Asked) -> None:
        asked = replace(asked, id=new_id(self.NAME), source=self.NAME)
        self._asks.publish(request_to_msg(asked, now_ns()))
        self._keep_pace(self._asks)

    def begin(self) -> None:
        """Tell what holds when a round begins, and ask what must be known before."""
        start_ns = self.player.first_ns
        for message in self.bag.latched(self.names, start_ns):
            self.publishers_of[message.topic].publish(self._as_now(message))
        for asked in self._ahead:
            self.ask(asked)

    def _on_table(self, message: Any) -> None:
        self._there = tables.table(message)

    def tick(self) -> None:
        self.clock.publish(Clock(clock=to_msg(self.player.now_ns())))

    def _as_now(self, message: BagMessage) -> Any:
        """Return what to publish: the recorded bytes, or a message of today for an old type."""
        if message.topic not in self._former:
            return message.data
        recorded = self.bag.topics[message.topic]
        text = deserialize_message(message.data, message_class(recorded.type)).data
        found = calibration_file.loads(text, f'{self.bag.path}: {recorded.name}')
        row = calibrations.of(message.log_ns, found)
        return calibrations.RECORD.fill(Calibration(), row, self.frame_prefix)

    def give(self, message: BagMessage) -> None:
        if message.topic in self._asked_on:
            asked = self._then.get(message.log_ns)
            if asked is not None:
                self.ask(asked)
            return
        publisher = self.publishers_of[message.topic]
        publisher.publish(self._as_now(message))
        self._keep_pace(publisher)
        self.health.tick()
        self.rounds.done()

    def _nap(self, seconds: float) -> None:
        time.sleep(seconds)
        self.rounds.done()

    def _play(self) -> None:
        try:
            self._await_readers()
            # All is well: bringup gives the nodes their priority now.
            self.state = said('doing_standing')
            if not self._stop.wait(READY_S):
                self._refuse_others()
                self.state = said('doing_playing')
            self.player.run()
            if not self._stop.is_set():
                self._acknowledged(self.publishers_of.values())
        except Exception as error:  # the executor's thread ends the node with it
            self.fault = error
        self.state = said('doing_over')
        self.rounds.rest()

    def _keep_pace(self, publisher: Publisher) -> None:
        """Wait for the readers each time the publisher's history is full.

        At every rate: a reader whom the system held up for a moment misses nothing; recorded time
        waits for it. With the message that fills the history Fast DDS asks the readers what they
        have; before, once in 3 s.
        """
        self._given[publisher] += 1
        if self._given[publisher] >= publisher.qos_profile.depth:
            self._given[publisher] = 0
            self._acknowledged([publisher])

    def _acknowledged(self, publishers: Iterable[Publisher]) -> None:
        """Wait until the readers have all; one that was killed is waited for once."""
        look = Duration(seconds=LOOK_S)
        for publisher in publishers:
            patience_s = 0.0 if publisher in self._unanswered else ACKNOWLEDGED_S
            end_s = time.monotonic() + patience_s
            while not (answered := publisher.wait_for_all_acked(look)):
                self.rounds.done()
                if time.monotonic() >= end_s or self._stop.is_set():
                    break
                time.sleep(0)  # for those who wait for the lock
            (self._unanswered.discard if answered else self._unanswered.add)(publisher)

    def _await_readers(self) -> None:
        """Wait for those whom the scene names, else until there is any reader."""
        if self.barrier.expects:
            while not self._stop.wait(0.05) and not self.barrier.ready():
                pass
            return
        end = time.monotonic() + self.settings.wait_s
        while time.monotonic() < end and not self._stop.wait(0.05):
            if any(p.get_subscription_count() for p in self.publishers_of.values()):
                break  # they find us a little later than we them, and each other

    def _refuse_others(self) -> None:
        """Raise ConfigError if another node gives the same, or if the graph has another table."""
        if self.barrier.expects:
            return
        recorded = table_in(self.bag.about.get('settings', ''))
        if recorded and self._there:
            advice = 'start the graph with the scene of the bag, or name the bag in `replay.bag`'
            check_same(recorded, self._there, str(self.bag.path), 'the running graph', advice)
        for name in () if self.settings.topics else (IMAGES, BLOCKS):
            found = self.get_publishers_info_by_topic(self.resolve_topic_name(name))
            others = {end.node_name for end in found} - {self.get_name()}
            if others and self.bag.name(name) in self.publishers_of:
                known = sorted(others - {UNKNOWN_NODE}) or ['another program']
                raise ConfigError(
                    f'{known[0]} publishes {name}, and so would the replay: stop it, or say with '
                    '--only (replay.topics) what to play beside it'
                )

    def tell(self) -> None:
        if self.fault is not None:
            raise self.fault
        if self.state == 'waiting':
            self.health.warn(said('waiting_reader', names=', '.join(self.names)))
        else:
            self.health.ok(
                said(
                    'replayed',
                    doing=said('doing_paused') if self.player.paused else self.state,
                    at=f'{self.player.position_s:.1f}',
                    all=f'{self.bag.duration_s:.1f}',
                    path=self.bag.path,
                )
            )
        self.health.values.update(
            messages=self.player.played,
            rounds=self.player.rounds,
            position_s=round(self.player.position_s, 1),
        )

    def close(self) -> None:
        self._stop.set()
        self.player.stop()
        self._thread.join()
