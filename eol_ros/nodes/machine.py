# SPDX-License-Identifier: Apache-2.0
"""Compares this machine with the others of the scene: nodes, scene file, version and clock."""

import importlib.metadata
import time

from eol_msgs.msg import NodeState

from eol_ros.core.clock_offset import Offset, OneWay, offset
from eol_ros.errors import EolError
from eol_ros.ros.node import EolNode
from eol_ros.ros.services import GIVE_UP_S
from eol_ros.ros.startup_barrier import PATIENCE_S
from eol_ros.said import clauses, code_and_args, from_message, said
from eol_ros.scene import machine_node
from eol_ros.streams.requests import Asked, values_of
from eol_ros.streams.work_state import ERROR, STARTING

SILENT_S = 3.0  # of nodes that report once a second
FAR_S = 0.02  # of clocks so far apart sound and light are plainly out of time
ORDER_S = GIVE_UP_S + 2.0  # from the answer to `restart` or `stop` to its begin


class MachineNode(EolNode):
    """One runs on each machine, as `machine_NAME`.

    Bringup gets a row for each node of the others, `NAME/NODE`, and so has them in its status and
    its notifications.
    """

    NAME = 'machine'
    HOLDS = False

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
        self.arrivals = {name: OneWay() for name in others}
        self.one_way_s: dict[str, float] = {}
        self.began_s = clock()
        self.health.values.update(
            scene_digest=self.settings.digest, version=importlib.metadata.version('eol_ros')
        )
        self.states = self.intake('node_states')
        self.subscribe('node_states', self.on_state, raw=True, with_info=True)
        self.create_timer(1.0, self.look)
        self.requests.serve(restart=self.on_order, stop=self.on_order)

    @property
    def answers_as(self) -> str:
        return machine_node(self.me)

    def on_order(self, asked: Asked) -> str:
        """Let bringup restart or stop the nodes here, whatever the other machines answer."""
        if self.scene.network != 'secure':  # anybody on the network could ask for it
            raise EolError(f'{asked.kind} needs `network: secure`')
        if not self.health.supervised:
            raise EolError(f'{asked.kind}: no bringup runs this node')

        def begin() -> None:
            once.cancel()
            self.health.order(asked.kind)

        once = self.create_timer(ORDER_S, begin)
        return f'{self.me}: {asked.kind} in {ORDER_S:.0f} s'

    def on_state(self, raw: bytes, received_ns: int, sent_ns: int, _sequence: int) -> None:
        if (state := self.states(raw)) is None or state.node not in self.rows:
            return
        self.health.tick()
        machine, row = self.rows[state.node]
        self.heard[state.node] = self.clock(), _status(state, row)
        if state.node == machine_node(machine):
            self.about[machine] = values_of(state.values)
            self.one_way_s[machine] = self.arrivals[machine].add(sent_ns, received_ns)

    def offset(self) -> Offset | None:
        """Return how far this machine's clock is ahead of the main one's; None if not known."""
        there_ms = self.about.get(self.main, {}).get(f'from_{self.me}_ms')
        if there_ms is None:
            return None
        return offset(self.one_way_s[self.main], there_ms * 1e-3)

    def look(self) -> None:
        now_s = self.clock()
        silent = {node: text for node in self.rows if (text := self.silence(node, now_s))}
        troubles: list[str] = []
        for machine in self.arrivals:
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
        if self.me == self.main:
            for machine, one_way_s in self.one_way_s.items():
                values[f'from_{machine}_ms'] = round(one_way_s * 1e3, 4)
        found = None if machine_node(self.main) in silent else self.offset()
        if found:
            values.update(
                offset_ms=round(found.offset_s * 1e3, 3),
                offset_error_ms=round(found.error_s * 1e3, 3),
            )
        else:
            for name in ('offset_ms', 'offset_error_ms'):
                values.pop(name, None)
        self.report(troubles, found)
        for node in self.rows:
            _, row = self.heard.get(node, (0.0, _status(NodeState(level=STARTING), '')))
            if node in silent:
                code, args = code_and_args(silent[node])
                row = row | {'level': ERROR, 'text': silent[node], 'code': code, 'args': args}
            self.health.relay(row | {'node': self.rows[node][1]})

    def silence(self, node: str, now_s: float) -> str:
        """Return for how long a node that should be heard was not; '' while that is not long."""
        since_s = self.heard[node][0] if node in self.heard else self.began_s
        if now_s - since_s <= (SILENT_S if node in self.heard else PATIENCE_S):
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

    def report(self, troubles: list[str], found: Offset | None) -> None:
        clock: str = ''
        if found and found.matters:
            clock = said(
                'clock_apart',
                offset=f'{found.offset_s * 1e3:.1f}',
                error=f'{found.error_s * 1e3:.1f}',
                machine=self.main,
            )
        if troubles or (found and clock and abs(found.offset_s) > FAR_S):
            self.health.error(clauses([*troubles, clock]))
        elif clock:
            self.health.warn(clock)
        elif len(self.about) == len(self.arrivals):
            self.health.ok(said('machines_heard', count=len(self.about)))
        else:
            waited = sorted(set(self.arrivals) - set(self.about))
            self.health.text = said('machines_waited', names=', '.join(waited))


def _status(state: NodeState, name: str) -> dict:
    """Return a state as a row of bringup's status."""
    args = values_of(state.args)
    return {
        'node': name, 'level': state.level, 'text': from_message(state.text, state.code, args),
        'code': state.code, 'args': args, 'rate': state.rate, 'pid': state.pid, 'values': {},
    }  # fmt: skip
