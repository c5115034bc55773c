# SPDX-License-Identifier: Apache-2.0
"""One child process: how it is started so that it never outlives us, and what it tells us."""

import contextlib
import json
import os
import resource
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eol_ros import parent_death
from eol_ros.bringup import priority, processor
from eol_ros.bringup.plan import Process
from eol_ros.bringup.policy import QUIET_S, STARVED, Look, Policy, Silence
from eol_ros.bringup.shared_memory import Ports
from eol_ros.bringup.status import starting, state
from eol_ros.disk import said as said_of
from eol_ros.errors import printable
from eol_ros.ros.health_pipe import AGAIN, HEALTH_FD, KEPT
from eol_ros.said import said

_LOG_LINES = ('[INFO]', '[WARN]', '[ERROR]', '[FATAL]', '[DEBUG]')
OWN_LINES = 50  # a second that are logged of an own program
CHUNKS = 16  # of 64 KB at a time: one child that never stops writing must not keep us from the rest


def _prepare(parent: int) -> None:
    """Run in the child before exec."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a dump of a stuck node is of no use here
    parent_death.follow(parent, signal.SIGTERM)


class Child:
    """A process of the graph, with its heartbeat and its output."""

    def __init__(self, process: Process):
        self.process = process
        self.policy = Policy()
        self.popen: subprocess.Popen[bytes] | None = None
        self.start_at_s: float | None = 0.0  # when to start it; None: it runs, or is finished
        self.status: dict[str, dict[str, Any]] = {}
        self.kept: dict[str, dict[str, Any]] = {}  # by node: what it must take up when it starts
        self.health_fd = self.output_fd = -1
        self.hung_s: float | None = None  # since when it is being ended for its silence
        self.code: int | None = None
        self.percent = 0  # how far a compiler is
        self.settled = False
        self.order = ''  # what its node asks of bringup: restart or stop
        self.left_out = 0  # its exit code, if it could not start: the others go on without it
        self.silence = self.policy.silence
        self.starved = False
        self._ports = Ports()
        self._rest = {'health': b'', 'output': b''}
        self._inside = self._raised = False  # in a log entry or a traceback; before its exception
        self._second_s = -1.0  # in which lines of an own program are counted
        self._lines_left = self._lines_lost = 0

    def start(self, now_s: float, again: bool = False) -> None:
        """Start it; `again` while the others run."""
        health_out, health_in = os.pipe()
        output_out, output_in = os.pipe()
        for fd in (health_in,) if self.process.own else (health_in, output_in):
            os.set_blocking(fd, False)  # while we are away it does not wait for us to read
        environment = {
            **os.environ,
            **self.process.environment,
            'PYTHONUNBUFFERED': '1',  # so lines come as they are printed
        }
        passed = self.process.files
        if not self.process.own:
            passed = (health_in, *passed)
            environment |= {HEALTH_FD: str(health_in), KEPT: json.dumps(self.kept)}
            environment |= {AGAIN: '1'} if again else {}
        parent = os.getpid()

        def begin(command: Sequence[str], folder: Path | None) -> subprocess.Popen[bytes]:
            return subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output_in,
                stderr=output_in,
                pass_fds=passed,
                cwd=folder,
                start_new_session=True,  # Ctrl-C reaches us alone; we stop the children in order
                preexec_fn=lambda: _prepare(parent),
            )

        try:
            self.popen = begin(self.process.command, self.process.folder)
        except (OSError, ValueError) as error:  # the latter of words that the system cannot take
            if not self.process.own:
                raise
            what = getattr(error, 'filename', None) or self.process.command[0]
            why = printable(f'cannot start {what}: {said_of(error)}')
            self.popen = begin(('/bin/sh', '-c', 'echo "$0"; exit 127', why), None)
        os.close(health_in)
        os.close(output_in)
        for fd in (health_out, output_out):
            os.set_blocking(fd, False)
        self.health_fd, self.output_fd = health_out, output_out
        self._rest = {'health': b'', 'output': b''}
        self._inside = self._raised = False
        self.policy.start(now_s)
        self.start_at_s, self.code, self.hung_s = None, None, None
        self.settled = self.starved = False
        pid = self.popen.pid
        self.status = {n: starting(n, said('starting'), pid) for n in self.process.nodes}
        if self.process.own:
            for row in self.status.values():
                row.update(state(0, said('program_runs')))

    def comes_back(self, now_s: float) -> bool:
        """Tell whether it is about to be started again."""
        due = self.start_at_s is not None and now_s >= self.start_at_s and not self.process.own
        return self.popen is None and due and self.policy.restarts > 0

    def settle(self) -> bool:
        """Give it its priority, once it is well; return False where the system forbids that."""
        allowed = True
        if self.popen is not None and self.process.nice:
            priority.step_back(self.popen.pid, self.process.nice)
        if self.popen is not None and self.process.real_time:
            allowed = priority.step_ahead(self.popen.pid, self.process.real_time)
        self.settled = True
        return allowed

    def hold_ports(self) -> None:
        """Take hold of what it reads in shared memory, which is marked when it has ended."""
        if self.alive() and (self.process.own or self.policy.beat_s is not None):
            assert self.popen is not None
            self._ports.look(self.popen.pid)

    def well(self) -> bool:
        """Tell whether it runs and all its nodes are ok."""
        return self.alive() and all(row['level'] == 0 for row in self.status.values())

    def signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.popen is not None and self.popen.poll() is None:
            self._send(number)

    def _send(self, number: int) -> None:
        """Send it a signal; to an own program and all that it has started, such as of a shell."""
        assert self.popen is not None
        with contextlib.suppress(ProcessLookupError, PermissionError):
            (os.killpg if self.process.own else os.kill)(self.popen.pid, number)

    def alive(self) -> bool:
        """Tell whether it runs."""
        return self.popen is not None and self.popen.poll() is None

    def watched(self) -> bool:
        """Tell whether it runs and should send heartbeats."""
        return self.alive() and not self.process.own

    def gives(self) -> bool:
        """Tell whether what its nodes said of themselves last still holds."""
        return self.alive() and self.policy.silence.silent_s < QUIET_S

    def beats(self, now_s: float) -> list[dict[str, Any]]:
        """Return the statuses that have come over the pipe."""
        found = []
        for line in self._lines('health', self.health_fd):
            with contextlib.suppress(ValueError, KeyError, TypeError):
                status = json.loads(line)
                if 'order' in status:
                    self.order = status['order']
                    continue
                if 'percent' in status:
                    self.percent = int(status['percent'])
                if 'kept' in status:  # not of a node of another machine
                    self.kept[status['node']] = status.pop('kept')
                self.status[status['node']] = status
                found.append(status)
        # A status that reports a hung worker is no heartbeat.
        if found and not any(row.get('hung') for row in self.status.values()):
            self.policy.beat(now_s)
        return found

    def look(self, now_s: float) -> str:
        """Return what to think of its silence, once its heartbeats have been read: a verdict.

        Its status says so while it is starved.
        """
        self.silence = self.policy.silence
        self._watch(now_s)
        verdict = self.policy.verdict()
        self.starved = verdict == STARVED
        if self.starved:
            for row in self.status.values():
                row.update(state(max(row['level'], 1), self.silence.words()))
        return verdict

    def ask_to_end(self, number: int, now_s: float) -> None:
        """Send a signal that should end it; from here on its silence is the time that it takes."""
        self.signal(number)
        self.silence = Silence(now_s, quiet_s=0.0)

    def ending(self, now_s: float, patience_s: float, most_s: float) -> str:
        """Return what to think of the time that it takes to end: a verdict."""
        self._watch(now_s)
        return self.silence.verdict(patience_s, most_s)

    def _watch(self, now_s: float) -> None:
        self.silence.pass_until(now_s)
        if self.silence.due() and self.popen is not None:
            threads = processor.threads(self.popen.pid)
            self.silence.take(Look(now_s, threads, processor.disk_wait_s()))

    def output(self, now_s: float) -> list[str]:
        """Return the whole lines it has printed; empty ones are what a full pipe left of some.

        Of an own program OWN_LINES a second, and how many others there were.
        """
        lines = [s.decode(errors='replace') for s in self._lines('output', self.output_fd) if s]
        if not self.process.own:
            return lines
        found = []
        if not 0 <= now_s - self._second_s < 1:
            if self._lines_lost:
                found.append(f'{self._lines_lost} lines left out')
            self._second_s, self._lines_left, self._lines_lost = now_s, OWN_LINES, 0
        found += map(printable, lines[: self._lines_left])
        self._lines_lost += max(len(lines) - self._lines_left, 0)
        self._lines_left = max(self._lines_left - len(lines), 0)
        return found

    def for_people(self, line: str) -> bool:
        """Tell whether a line belongs on the terminal: no log, of a traceback its exception alone.

        What was logged or raised may have more lines: it ends where the process speaks by its name.
        """
        if line.startswith((f'{self.process.name}: ', 'eol ')):
            self._inside = False
        elif line.startswith((*_LOG_LINES, 'Traceback (', 'Fatal Python error')):
            self._inside, self._raised = True, line.startswith('Traceback (')
        elif self._raised and line and not line.startswith(' '):
            self._raised = False
            return True
        return not self._inside

    def _lines(self, kind: str, fd: int) -> list[bytes]:
        if fd < 0:
            return []
        data = self._rest[kind]
        with contextlib.suppress(BlockingIOError):
            for _ in range(CHUNKS):
                if not (chunk := os.read(fd, 65536)):
                    break
                data += chunk
        *lines, rest = data.split(b'\n')
        self._rest[kind] = rest[-65536:]
        return lines

    def reap(self) -> int:
        """Take the exit code, tell those who write to it that it is gone, and close the pipes."""
        assert self.popen is not None
        if self.process.own:
            self._send(signal.SIGKILL)  # what it has started and left
        self.code = self.popen.wait()
        self._ports.end()
        for fd in (self.health_fd, self.output_fd):
            if fd >= 0:
                os.close(fd)
        self.health_fd = self.output_fd = -1
        self.popen, self.starved = None, False
        return self.code
