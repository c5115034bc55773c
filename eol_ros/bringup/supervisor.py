# SPDX-License-Identifier: Apache-2.0
"""Starts the processes of a scene, watches their heartbeats, restarts them, stops them in order."""

import os
import select
import signal
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eol_ros import thread_faults
from eol_ros.bringup import shared_memory, status
from eol_ros.bringup.child import Child
from eol_ros.bringup.event_log import EventLog
from eol_ros.bringup.memory import Memory, words
from eol_ros.bringup.plan import Process
from eol_ros.bringup.policy import (
    FINE,
    HUNG,
    PAUSE_S,
    START_S,
    START_STARVED_S,
    STARVED,
    STARVED_S,
    StarvedInput,
)  # fmt: skip
from eol_ros.bringup.service_manager import ServiceManager
from eol_ros.said import Said, clauses, said
from eol_ros.streams.graph import IMAGE_SOURCES, NAMESPACE, NODES, providers
from eol_ros.streams.work_state import DOWN, gives_no_images, work_state

if TYPE_CHECKING:
    from eol_ros.bringup.notify import Notifier

STOPPED = 3  # exit code after the service `stop`, by which systemd does not start it again
FINAL = (2, 69, 78)  # a node that ends so at the start lacks a device or a file
ESSENTIAL = {*IMAGE_SOURCES, 'tracker'}  # without which nothing moves
DRAIN_S = 0.3  # from the last image to all that it causes
DUMP_S = 0.5  # a hung process may take this long to write down its stacks
FAULT_S = 5.0  # a longer fault is not part of the start
AWAY_S = 5.0  # bringup was stopped, or blocked, for longer: that is told
LOOK_S = 1.0  # between two looks whether all nodes must be started again
# Whose input never pauses while the node before it is well, and who that may be: a replay pauses.
FED_BY = {
    name: tuple(source for source in providers(name) if source != 'replay')
    for name, node in NODES.items()
    if node.requires in ('camera/image_raw', 'blocks')
}
STOP_STEPS = ((signal.SIGINT, 4.0), (signal.SIGTERM, 1.0), (signal.SIGKILL, 1.0))


@dataclass(frozen=True)
class Around:
    """What a run has beside its processes.

    `compiler` compiles before they start. `changed` returns why all have to be started again.
    """

    compiler: Process | None = None
    namespace: str = NAMESPACE
    manager: ServiceManager | None = None
    memory: Memory | None = None
    notifier: 'Notifier | None' = None
    changed: Callable[[bool], str] = lambda restarting: ''


class Supervisor:
    """All processes of one run."""

    def __init__(
        self,
        scene: str,
        processes: Sequence[Process],
        server: socket.socket,
        events: EventLog,
        say: Callable[[str], None],
        around: Around | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        around = around or Around()
        self.scene, self.namespace, self._clock = scene, around.namespace, clock
        self._manager = around.manager or ServiceManager({}, clock)
        self.children = [Child(process) for process in processes]
        self._compiler = Child(around.compiler) if around.compiler else None
        self._memory, self._notifier = around.memory, around.notifier
        self._changed = around.changed
        self._server, self._events, self._say = server, events, say
        self._asked_to_stop = self._hurry = self._stopped = False
        self._code = 0  # of a run that was asked to stop
        self._told_work = self._work_code = ''
        self._told: dict[str, tuple[int, str]] = {}
        self._began_s = self._clock()
        self.all_ok_s: float | None = None  # seconds from the start to all ok
        self.real_time = any(process.real_time > 0 for process in processes)
        self._told_priority = False
        self._unfed = {name: StarvedInput() for name in FED_BY}
        self._told_slow_start = False
        self._told_slow: list[Child] = []  # whom to wait for at the end
        self._told_memory = self._told_notifier = ''
        self._look_s = 0.0  # when to look next whether something has changed
        self._wake, self._waker = os.pipe()
        for fd in (self._wake, self._waker):
            os.set_blocking(fd, False)

    def run(self, seconds: float | None = None) -> int:
        """Run until asked to stop, or for `seconds` once all is ok; return the exit code."""
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        signal.signal(signal.SIGCHLD, lambda *_: None)  # only to wake the loop
        shared_memory.clean()
        self._recall()
        self._began_s = self._clock()
        self._compile()
        code = 0
        try:
            code = self._watch(seconds)
        finally:
            self._manager.stopping()
            self._stopped = True
            self._stop()
            if self._memory:
                self._memory.end(asked=self._asked_to_stop or code == 0)
            if self._notifier:
                self._notifier.end()
        restarts = sum(child.policy.restarts for child in self.children)
        age = int(self._clock() - self._began_s)
        self._note(
            f'stopped, {age // 3600:02d}:{age % 3600 // 60:02d}:{age % 60:02d}, {restarts} restarts'
        )
        return code

    def _watch(self, seconds: float | None) -> int:
        """Look after the nodes until the run is over; return its exit code."""
        began_s = last_s = self._clock()
        could_s = faulty_s = 0.0  # time without starved nodes, and time of a fault, s
        while not self._asked_to_stop:
            thread_faults.check()
            now = self._clock()
            self._tidy(now)
            ended = self._step(now)
            if ended is not None:
                return ended
            if not any(child.starved for child in self.children):
                could_s += min(now - last_s, PAUSE_S)
                faulty_s = faulty_s + min(now - last_s, PAUSE_S) if self._faulty() else 0.0
            if now - last_s > AWAY_S:
                self._note(
                    f'bringup stood still for {now - last_s:.0f} s; the nodes went on, but '
                    'lines that they printed meanwhile may be lost'
                )
            last_s = now
            late = could_s > START_S or now - began_s > START_STARVED_S
            if seconds is not None and self.all_ok_s is not None:
                if now - self._began_s - self.all_ok_s >= seconds:
                    return max(child.left_out for child in self.children)
            elif seconds is not None and (late or faulty_s > max(FAULT_S, seconds)):
                self._note(f'not all OK within {now - began_s:.0f} s: {self._not_ok()}')
                return 1
            self._manager.ready()
            if self._manager.there:
                self._manager.status(self._summary())
            self._wait()
        return self._code

    def _tidy(self, now: float) -> None:
        """Start all again where the machine has changed; take away what killed processes left.

        A node may ask for all to be started again, or to end.
        """
        orders = {child.order for child in self.children}
        if 'stop' in orders:
            self._note('the run ends, as the service `stop` asks')
            self.stop()
            self._code = STOPPED
            return
        if 'restart' in orders:
            self._begin_again('the service `restart` was called')
        restarting = any(child.comes_back(now) for child in self.children)
        if not restarting and now < self._look_s:
            return
        self._look_s = now + LOOK_S
        if why := self._changed(restarting):
            self._begin_again(why)
        for name in shared_memory.release_unfinished():
            self._note(f'{name}, which a killed process left half made, is removed')
        for child in self.children:
            child.hold_ports()

    def _begin_again(self, why: str) -> None:
        """Stop all nodes and start them again; none of them has failed."""
        self._note(f'{why}: all nodes are started again')
        running = [child for child in self.children if child.popen is not None]
        self._stop()
        for child in running:
            child.start_at_s = self._clock()
        for child in self.children:
            child.order = ''  # it may have come again meanwhile

    def stop(self) -> None:
        """Ask the loop to end."""
        self._asked_to_stop = True

    def _recall(self) -> None:
        """Give the nodes what they kept in a run that was cut short, or before the last boot."""
        kept = self._memory.recall() if self._memory else {}
        for child in self.children:
            child.kept = {node: kept[node] for node in child.process.nodes if node in kept}
        if text := words(kept):
            self._note(f'as people left it: {text}')
        if self._memory and self._memory.left_out:
            self._note(f'left out: {self._memory.left_out}')

    def _remember(self) -> None:
        if self._memory is None:
            return
        self._memory.note({k: v for child in self.children for k, v in child.kept.items()})
        if (trouble := self._memory.trouble) != self._told_memory:
            self._told_memory = trouble
            self._note(trouble or 'what people ask is kept again')

    def describe(self) -> dict[str, Any]:
        """Return the state of everything as plain data."""
        rows = [row for child in self.children for row in child.status.values()]
        return {
            'scene': self.scene,
            'work': status.of_work(self._work(rows)),
            'namespace': self.namespace,
            'pid': os.getpid(),
            'running_s': round(self._clock() - self._began_s, 1),
            'all_ok_s': self.all_ok_s,
            'real_time': self.real_time,
            'restarts': sum(child.policy.restarts for child in self.children),
            'latency': status.latencies(rows),
            'nodes': rows,
        }

    def _work(self, rows: list[dict[str, Any]]) -> Said:
        if self._stopped:
            return said('stopped')
        return work_state({row['node']: row for row in rows})

    def _compile(self) -> None:
        """Wait for the compiler, if one is needed, before the first node is started.

        It has all processors for itself so, and is no node: nobody takes it for hung. If it fails,
        the nodes start all the same, and compile what they need themselves.
        """
        if self._compiler is None:
            return
        compiler, told = self._compiler, -10
        compiler.start(self._clock())
        while compiler.alive() and not self._asked_to_stop:
            compiler.beats(self._clock())
            self._hear(compiler, self._clock())
            if compiler.percent >= told + 10:
                told = compiler.percent
                self._note(f'compiling, {told} %')
            text = said('compiling', percent=compiler.percent)
            self._manager.status(text)
            for child in self.children:
                child.status = {n: status.starting(n, text) for n in child.process.nodes}
            status.answer(self._server, self.describe())
            self._wait([compiler])
        compiler.signal(signal.SIGTERM)
        self._hear(compiler, self._clock())
        if (code := compiler.reap()) and not self._asked_to_stop:
            self._note(f'compiling has failed (exit code {code}): the nodes do it themselves')

    def _hear(self, child: Child, now: float) -> None:
        """Log the output of a process, and print the lines meant for people."""
        for line in child.output(now):
            shown = child.for_people(line) and not line.startswith('compiling, ')
            self._events.line(f'{child.process.name}: {line}', shown)
            if shown:
                self._say(f'{child.process.name} | {line}')

    def _on_signal(self, _number: int, _stack: Any) -> None:
        self._hurry = self._asked_to_stop  # asked twice
        self._asked_to_stop = True

    def _note(self, text: str) -> None:
        self._events.entry(f'{self.scene}: {text}')
        self._say(text)

    def _summary(self) -> str:
        """Return all in a line, for people who look from outside."""
        count = sum(len(child.status) for child in self.children)
        restarts = sum(child.policy.restarts for child in self.children)
        return f'{self.scene}: {self._not_ok() or "all OK"}; {count} nodes, {restarts} restarts'

    def _faulty(self) -> bool:
        """Return whether a fault prevents all nodes from being OK.

        A camera without images is a fault, even while other nodes only wait for its images. A
        replay without images is none: it waits for its subscribers.
        """
        rows = [row for child in self.children for row in child.status.values()]
        blind = any(row['node'] == 'camera' and gives_no_images(row) for row in rows)
        return blind or self._work_code in ('work_fault', 'no_camera')

    def _not_ok(self) -> str:
        rows = [row for child in self.children for row in child.status.values() if row['level']]
        return ', '.join(f'{row["node"]} ({row["text"]})' for row in rows)

    def _wait(self, children: Sequence[Child] = ()) -> None:
        self._manager.beat()
        fds = [self._wake, self._server.fileno()]
        children = children or self.children
        fds += [c.health_fd for c in children if c.health_fd >= 0]
        # An own program that floods its output wakes nobody: it waits.
        fds += [c.output_fd for c in children if c.output_fd >= 0 and not c.process.own]
        ready, _, _ = select.select(fds, [], [], 0.1)
        if self._wake in ready:
            os.read(self._wake, 4096)

    def _step(self, now: float) -> int | None:
        """Look after every child once; return an exit code when the run is over."""
        for child in self.children:
            self._listen(child, now)
            if child.popen is not None and child.popen.poll() is not None:
                ended = self._ended(child, now)
                if ended is not None:
                    return ended
            elif child.watched() and (verdict := child.look(now)) != FINE:
                self._end_hung(child, now) if verdict == HUNG else self._leave(child)
            elif child.popen is None and child.start_at_s is not None and now >= child.start_at_s:
                child.start(now, any(one.settled and one.alive() for one in self.children))
            elif self.all_ok_s is not None and not child.settled and child.well():
                child.left_out = 0
                self._settle(child)
        self._feed(now)
        if self.all_ok_s is None:
            there = [c for c in self.children if not (c.left_out or c.process.own)]
            rows = [row for child in there for row in child.status.values()]
            if len(rows) >= len(there) and all(row['level'] == 0 for row in rows):
                self.all_ok_s = round(now - self._began_s, 2)
                self._note(f'all OK after {self.all_ok_s:.1f} s')
        self._remember()
        described = self.describe()
        if (work := described['work']['text']) != self._told_work:
            self._told_work, self._work_code = work, described['work']['code']
            self._events.entry(f'{self.scene}: {work}')
        self._notify(now, described)
        status.answer(self._server, described)
        return None

    def _notify(self, now: float, described: dict[str, Any]) -> None:
        """Let people be told of what lasts; nothing here waits for a server."""
        if self._notifier is None:
            return
        restarts = {child.process.name: child.policy.restarts for child in self.children}
        if message := self._notifier.look(now, described, restarts):
            self._note(f'told: {message["title"]}')
        if (trouble := self._notifier.trouble) != self._told_notifier:
            self._told_notifier = trouble
            self._note(f'nobody can be told: {trouble}' if trouble else 'messages arrive again')

    def _settle(self, child: Child) -> None:
        if not child.settle():
            self.real_time = False
            if not self._told_priority:
                self._told_priority = True
                self._note(
                    'no real-time priority here: light and sound may come late when the '
                    'machine is busy (docs/guides/install.md)'
                )

    def _end_hung(self, child: Child, now: float) -> None:
        """First let it write down where it hangs (faulthandler, on SIGABRT), then kill it.

        One that was stopped hangs nowhere. It would hear SIGABRT only if it went on, and its other
        threads would with it: for an instant that is too short for what they begin, as a port in
        shared memory.
        """
        if child.hung_s is None:
            child.hung_s = now
            stopped = child.silence.stopped
            self._note(
                f'{child.process.name} {"was stopped" if stopped else "is silent"}: '
                'it is started again'
            )
            self._events.line(f'{child.process.name}: {child.silence.measured()}')
            child.signal(signal.SIGKILL if stopped else signal.SIGABRT)
        elif now - child.hung_s > DUMP_S:
            child.signal(signal.SIGKILL)

    def _feed(self, now: float) -> None:
        """Start a node again that gets nothing of what another node gives all the while."""
        rows = {name: (row, child) for child in self.children for name, row in child.status.items()}
        giving = {
            name: row.get('rate', 0.0)
            for name, (row, child) in rows.items()
            if row['level'] == 0 and child.gives()
        }
        for name, sources in FED_BY.items():
            if name not in rows:
                continue
            (row, child), well = rows[name], [source for source in sources if source in giving]
            given = max((giving[source] for source in well), default=0.0)
            judged = child.alive() and child.policy.beat_s is not None and not child.starved
            gets = row.get('rate', 1.0) if judged else 1.0
            if self._unfed[name].look(now, gets, given, self.all_ok_s is None):
                self._note(
                    f'{name} gets nothing of the {given:.0f} a second that {well[0]} gives: it is '
                    'started again'
                )
                child.policy.unfed = True
                child.signal(signal.SIGKILL)

    def _leave(self, child: Child) -> None:
        """A starved process is reported, once, and left alone.

        Until all are well they compete with each other: that is said once, for all of them.
        """
        if self.all_ok_s is None:
            if not self._told_slow_start:
                self._told_slow_start = True
                self._note(f'slow start: {child.silence.waits_for} busy')
            return
        most_s = START_STARVED_S if child.policy.beat_s is None else STARVED_S
        for row in child.status.values():
            if not self._told.get(row['node'], (3, ''))[1].startswith('starved'):
                self._note(f'{row["node"]:9} {row["text"]}; left alone for up to {most_s:.0f} s')
            self._told[row['node']] = (row['level'], row['text'])

    def _listen(self, child: Child, now: float) -> None:
        for row in child.beats(now):
            told = self._told.get(row['node'], (3, ''))[0]
            self._told[row['node']] = (row['level'], row['text'])
            if row['level'] != told:
                self._note(f'{row["node"]:9} {status.WORDS[row["level"]]}: {row["text"]}')
        self._hear(child, now)

    def _ended(self, child: Child, now: float) -> int | None:
        self._listen(child, now)
        code = child.reap()
        never_ran = child.policy.beat_s is None or all(
            row['level'] == 3 for row in child.status.values()
        )
        name = child.process.name
        if code == 0:
            self._note(f'{name} has finished')
            child.start_at_s = None
            if set(child.process.nodes) & set(IMAGE_SOURCES):
                return 0  # its input has come to an end, and so has the run
            for row in child.status.values():
                row.update(status.state(0, said('finished')), rate=0.0)
            return None
        fails = code in FINAL and never_ran and not child.process.own
        if fails and (child.left_out or child.policy.restarts == 0):
            if not child.left_out:
                self._note(f'{name} cannot start (exit code {code})' + self._without(child))
                child.left_out = code
            if not self._without(child):
                return code
        wait = child.policy.died(now)
        name_of = signal.Signals(-code).name if code < 0 else ''
        how = said('killed_by', signal=name_of) if name_of else said('exit_code', code=code)
        again = said('again', seconds=f'{wait:.0f}') if wait else said('starting_again')
        if not child.left_out:
            self._note(f'{name} has died ({how}); {again}')
        child.status = {node: child.status[node] for node in child.process.nodes}
        for row in child.status.values():
            row.update(status.state(DOWN, clauses([how, again])), rate=0.0)
        for node in child.process.nodes:
            self._told[node] = (DOWN, '')
        child.start_at_s = now + wait
        return None

    def _without(self, child: Child) -> str:
        """Return what is said if the run goes on without a node that cannot start, or nothing.

        It does as long as nodes are left that do something: the walls need no sound card.
        """
        rest = [c for c in self.children if c is not child and not c.left_out]
        left = {node for c in rest for node in c.process.nodes} - ESSENTIAL
        if child.code == 2 or not left or ESSENTIAL & set(child.process.nodes):
            return ''
        return ': the others go on without it, and it is tried again'

    def _stop(self) -> None:
        """Stop the sources first, the rest when that has run dry, the recorder last.

        So a bag ends with what its last image caused, and a replay of it gives just that.
        """
        last = [c for c in self.children if 'recorder' in c.process.nodes]
        first = [c for c in self.children if set(c.process.nodes) & set(IMAGE_SOURCES)]
        between = [c for c in self.children if c not in first and c not in last]
        for group in (first, between, last):
            if group is between and any(child.alive() for child in between):
                time.sleep(DRAIN_S)
            for number, patience_s in STOP_STEPS:
                for child in group:
                    child.ask_to_end(number, self._clock())
                while self._may_yet_end(group, patience_s):
                    for child in self.children:
                        self._listen(child, self._clock())
                    status.answer(self._server, self.describe())
                    self._wait()
                if not any(child.alive() for child in group):
                    break
        for child in self.children:
            if child.popen is not None:
                self._listen(child, self._clock())
                child.reap()

    def _may_yet_end(self, group: Sequence[Child], patience_s: float) -> bool:
        """Tell whether some of `group` run that did not have `patience_s` in which to end."""
        most_s = patience_s if self._hurry else STARVED_S
        verdicts = [(c, c.ending(self._clock(), patience_s, most_s)) for c in group if c.alive()]
        for child, verdict in verdicts:
            if verdict == STARVED and child not in self._told_slow:
                self._told_slow.append(child)
                self._note(f'{child.process.name} is waited for: {child.silence.words()}')
        return any(verdict != HUNG for _, verdict in verdicts)
