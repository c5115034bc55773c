# SPDX-License-Identifier: Apache-2.0
"""Plays a bag as if it happened now: the recorded bytes, their stamps unchanged."""

import sys
import threading
import time

from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from eol_ros.devices.bag_player import BagPlayer, choose
from eol_ros.devices.bag_reader import BagReader
from eol_ros.errors import ConfigError
from eol_ros.ros.definitions import type_hash
from eol_ros.ros.node import NAMESPACE, EolNode
from eol_ros.ros.run import runner
from eol_ros.ros.stamps import to_msg
from eol_ros.ros.topics import QOS, TOPICS, message_class

CLOCK_NS = 10_000_000  # between two messages on /clock


class ReplayNode(EolNode):
    NAME = 'replay'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        if not self.settings.bag:
            raise ConfigError('replay.bag: name a bag folder or an .mcap file')
        self.bag = BagReader(self.settings.bag)
        favourites = [self.resolve_topic_name(t) for t in ('camera/image_raw', 'blocks')]
        self.names = choose(self.bag, self.settings.topics, favourites)
        self.publishers_of = {name: self._publisher(name) for name in self.names}
        self.clock = self.create_publisher(Clock, '/clock', 10) if self.settings.clock else None
        self._clock_ns = 0
        s = self.settings
        self.player = BagPlayer(
            self.bag, self.names, self.give, s.rate, s.fast, s.loop, s.start_s
        )  # fmt: skip
        self.state = 'waiting'
        for line in self.bag.cut_short:
            self.get_logger().warning(line)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._play, name='replay', daemon=True)
        self._thread.start()
        self.create_timer(1.0, self.tell)

    def _publisher(self, name: str):
        recorded = self.bag.topics[name]
        if recorded.type_hash and recorded.type_hash != type_hash(recorded.type):
            raise ConfigError(
                f'{self.bag.path}: {name} was recorded with another definition of {recorded.type} '
                'than the installed one; it can be analysed, and not be played'
            )
        ours = TOPICS.get(name.removeprefix(f'/{NAMESPACE}/'))
        if ours and ours.type_name == recorded.type:
            return self.publisher(ours.name)
        return self.create_publisher(message_class(recorded.type), name, QOS['stream'])

    def give(self, message) -> None:
        publisher = self.publishers_of[message.topic]
        publisher.publish(message.data)
        if self.settings.fast:  # the reader has it before the next comes
            publisher.wait_for_all_acked(Duration(seconds=1.0))
        if self.clock and abs(message.log_ns - self._clock_ns) >= CLOCK_NS:
            self._clock_ns = message.log_ns
            self.clock.publish(Clock(clock=to_msg(message.log_ns)))
        self.health.tick()

    def _play(self) -> None:
        self._await_readers()
        self.state = 'playing'
        self.player.run()
        if not self._stop.is_set():
            for publisher in self.publishers_of.values():
                publisher.wait_for_all_acked(Duration(seconds=2.0))
        self.state = 'over'

    def _await_readers(self) -> None:
        end = time.monotonic() + self.settings.wait_s
        while time.monotonic() < end and not self._stop.wait(0.05):
            if any(p.get_subscription_count() for p in self.publishers_of.values()):
                self._stop.wait(1.0)  # they find us a little later than we them, and each other
                return

    def tell(self) -> None:
        words = f'{self.player.position_s:.1f} of {self.bag.duration_s:.1f} s of {self.bag.path}'
        if self.state == 'waiting':
            self.health.warn(f'waiting for a reader of {", ".join(self.names)}')
        else:
            self.health.ok(f'{"paused at" if self.player.paused else self.state} {words}')
        self.health.values.update(messages=self.player.played, rounds=self.player.rounds)

    def close(self) -> None:
        self._stop.set()
        self.player.stop()
        self._thread.join()


main = runner(ReplayNode)

if __name__ == '__main__':
    sys.exit(main())
