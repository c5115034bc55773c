# SPDX-License-Identifier: Apache-2.0
"""Compares this machine with the others of the scene: nodes, scene file, version and clock."""

import importlib.metadata
import time
from collections import deque

from eol_msgs.msg import NodeState

from eol_ros.ros.node import EolNode
from eol_ros.said import clauses, code_and_args, from_message, said
from eol_ros.scene import machine_node
from eol_ros.streams.requests import values_of
from eol_ros.streams.work_state import ERROR, STARTING

SILENT_S = 3.0  # of nodes that report once a second
APART_S = 0.005  # above: an error of the set-up; NTP on a LAN keeps a tenth of it, and its delay
FAR_S = 0.02  # of clocks so far apart sound and light are plainly out of time
START_S = 15.0  # as long as a source waits for the nodes of its scene


class MachineNode(EolNode):
    """One runs on each machine, as `machine_NAME`.

    Bringup gets a row for each node of the others, `NAME/NODE`, and so has them in its status and
    its notifications.
    """

    NAME = 'machine'

    def __init__(self, settings, clock=time.monotonic, **kwargs):
        super().__init__(settings, **kwargs)
        self.clock, machines = clock, self.scene.machines
        self.me, self.main = self.settings.name, self.scene.main
        others = {name: one for name, one in machines.items() if name != self.me}
        # By the node's name on the graph: machine, and what bringup calls it.
        self.rows = {
            node: (name, f'{name}/{short}')
            for name, one in others.items()
            for node, short in [(machine_node(name), 'machine'), *((n, n) for n in one.nodes)]
        }
        self.heard: dict[str, tuple[float, dict]] = {}
        self.about: dict[str, dict] = {}  # what the nodes `machine` of the others say
        self.others = tuple(others)
        self.apart_s: deque[float] = deque(maxlen=8)  # clock of the main machine, and what it took
        self.began_s = clock()
        self.health.values.update(
            scene_digest=self.settings.digest, version=importlib.metadata.version('eol_ros')
        )
        self.states = self.intake('node_states')
        self.subscribe('node_states', self.on_state, raw=True, with_info=True)
        self.create_timer(1.0, self.look)

    def on_state(self, raw: bytes, received_ns: int, sent_ns: int, _sequence: int) -> None:
        if (state := self.states(raw)) is None or state.node not in self.rows:
            return
        self.health.tick()
        machine, row = self.rows[state.node]
        self.heard[state.node] = self.clock(), _status(state, row)
        if state.node == machine_node(machine):
            self.about[machine] = values_of(state.values)
            if machine == self.main:
                self.apart_s.append((received_ns - sent_ns) * 1e-9)

    def look(self) -> None:
        now_s = self.clock()
        silent = {node: text for node in self.rows if (text := self.silence(node, now_s))}
        troubles: list[str] = []
        for machine in self.others:
            if (name := machine_node(machine)) in silent:
                troubles.append(said('of_node', node=machine, why=silent[name]))
                continue
            troubles += [
                said('of_node', node=row, why=silent[node])
                for node, (of, row) in self.rows.items()
                if of == machine and node in silent
            ]
            troubles += self.differences(machine)
        values = self.health.values
        if machine_node(self.main) in silent:
            self.apart_s.clear()
        apart_s = min(self.apart_s, default=0.0)  # of the message that came quickest
        values['offset_ms'] = round(apart_s * 1e3, 3)
        self.report(troubles, apart_s)
        for node in self.rows:
            _, row = self.heard.get(node, (0.0, _status(NodeState(level=STARTING), '')))
            if node in silent:
                code, args = code_and_args(silent[node])
                row = row | {'level': ERROR, 'text': silent[node], 'code': code, 'args': args}
            self.health.relay(row | {'node': self.rows[node][1]})

    def silence(self, node: str, now_s: float) -> str:
        """Return for how long a node that should be heard was not; '' while that is not long."""
        since_s = self.heard[node][0] if node in self.heard else self.began_s
        if now_s - since_s <= (SILENT_S if node in self.heard else START_S):
            return ''
        return said('not_heard', seconds=f'{now_s - since_s:.0f}')

    def differences(self, machine: str) -> list[str]:
        """Return what differs between another machine that is heard and this one."""
        theirs, ours = self.about.get(machine, {}), self.health.values
        found: list[str] = []
        if theirs and theirs.get('scene_digest') != ours['scene_digest']:
            found.append(said('other_scene', machine=machine))
        if theirs and theirs.get('version') != ours['version']:
            versions = {'theirs': theirs.get('version'), 'ours': ours['version']}
            found.append(said('other_version', machine=machine, **versions))
        return found

    def report(self, troubles: list[str], apart_s: float) -> None:
        clock: str = ''
        if abs(apart_s) > APART_S:
            clock = said('clock_apart', offset=f'{apart_s * 1e3:.1f}', machine=self.main)
        if troubles or abs(apart_s) > FAR_S:
            self.health.error(clauses([*troubles, clock]))
        elif clock:
            self.health.warn(clock)
        elif len(self.about) == len(self.others):
            self.health.ok(said('machines_heard', count=len(self.about)))
        else:
            waited = sorted(set(self.others) - set(self.about))
            self.health.text = said('machines_waited', names=', '.join(waited))


def _status(state: NodeState, name: str) -> dict:
    """Return a state as a row of bringup's status."""
    args = values_of(state.args)
    return {
        'node': name, 'level': state.level, 'text': from_message(state.text, state.code, args),
        'code': state.code, 'args': args, 'rate': state.rate, 'pid': state.pid, 'values': {},
    }  # fmt: skip
