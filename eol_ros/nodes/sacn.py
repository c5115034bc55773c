# SPDX-License-Identifier: Apache-2.0
"""Sends the light of the blocks, flash limit included, to theatre lights by sACN (E1.31)."""

import time
import uuid

from eol_msgs.msg import LedCommand

from eol_ros.core.light.e131 import Stream, mistakes, multicast, target
from eol_ros.devices.files.machine_id import machine_id
from eol_ros.devices.udp import UdpOut
from eol_ros.errors import ConfigError
from eol_ros.ros.node import EolNode
from eol_ros.said import clauses, said

LOOK_S = 0.1  # between looks for packets to send again
RESOLVE_S = 5.0


class SacnNode(EolNode):
    NAME = 'sacn'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s, cells = self.settings, self.table.cells
        leds = self.scene.nodes.get('leds')
        wrong = mistakes(s.first_channel, leds, cells, self.sim_time)
        if found := [': '.join(one) for one in wrong]:
            raise ConfigError('\n'.join(found))
        targets = [target(line) for line in s.send_to] or [multicast(s.universe)]
        self.outs = [UdpOut(one, s.send_from) for one in targets]
        # the same after a restart, but different for each machine, graph and universe
        cid = uuid.uuid5(self.machine_id(), f'{self.namespace} {s.universe}').bytes
        self.stream = Stream(cid, s.universe, s.first_channel, s.priority, bytes(cells))
        self.sent = 0
        self.rest = self.create_timer(LOOK_S, self.on_rest, autostart=False)
        self.subscribe('led_commands', self.on_lights)
        self.create_timer(LOOK_S, self.look)
        self.create_timer(1.0, self.report)
        self.create_timer(RESOLVE_S, self.resolve)
        self.report()

    def machine_id(self) -> uuid.UUID:
        try:
            return machine_id()
        except ConfigError as error:
            what = 'after a restart, receivers take this machine for another source of sACN'
            self.get_logger().warning(f'{error}; {what}')
            return uuid.uuid4()

    def on_lights(self, message: LedCommand) -> None:
        self.stream.take(bytes(message.white), time.monotonic())
        self.health.tick()
        self.look()

    def look(self) -> None:
        now_s = time.monotonic()
        if packet := self.stream.due(now_s):
            self.send(packet)
        elif wait_s := self.stream.wait_s(now_s):  # the last level must not get lost
            self.resume(self.rest, wait_s)

    def on_rest(self) -> None:
        self.rest.cancel()
        self.look()

    def send(self, packet: bytes) -> None:
        self.sent += 1
        for out in self.outs:
            out.send(packet)

    def resolve(self) -> None:
        for out in self.outs:
            out.resolve()

    def report(self) -> None:
        self.health.values['sent'] = self.sent
        trouble = [said('osc_unsent', why=out.trouble) for out in self.outs if out.trouble]
        told = said('osc_to', targets=', '.join(out.target for out in self.outs))
        (self.health.warn if trouble else self.health.ok)(clauses([*trouble, told]))

    def close(self) -> None:
        for packet in self.stream.end():
            self.send(packet)
        for out in self.outs:
            out.close()
