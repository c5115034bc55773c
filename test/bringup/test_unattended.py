# SPDX-License-Identifier: Apache-2.0
"""Bringup whole, over stand-in nodes, where nobody reads, nobody answers, and files vanish."""

import contextlib
import fcntl
import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import threading
import time

import pytest
from support.domains import next_domain
from support.waiting import wait_until

from eol_ros import cli
from eol_ros.bringup import status, terminal
from eol_ros.bringup.child import Child
from eol_ros.bringup.plan import Process
from eol_ros.bringup.terminal import Terminal
from eol_ros.errors import DeviceMissing, EolError

# The command line of bringup; its nodes are `NODE`, with the words that each is given in earnest.
BRINGUP = """
import dataclasses, sys
from eol_ros.bringup import __main__ as bringup, plan
script, real = sys.argv.pop(1), plan.processes
plan.processes = lambda *words, **more: [
    dataclasses.replace(process, command=(sys.executable, '-c', script, *process.command[3:]))
    for process in real(*words, **more)
]
plan.compiler = lambda scene: None
sys.exit(bringup.main())
"""
# Reads its scene as nodes do, beats, and counts its rounds in a file.
NODE = """
import json, os, pathlib, signal, sys, time
from eol_ros import scene as scenes
scene = scenes.load(sys.argv[sys.argv.index('--scene') + 1])
name, fd = sys.argv[1], int(os.environ['EOL_HEALTH_FD'])
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
rounds = pathlib.Path(os.environ['ROUNDS'])
for k in range(10**9):
    line = json.dumps({'node': name, 'level': 0, 'text': scene.name, 'rate': 1.0, 'values': {},
                       'pid': os.getpid()}) + chr(10)
    try:
        os.write(fd, line.encode())
    except BlockingIOError:
        pass
    for _ in range(int(os.environ['LINES'])):
        print('x' * 200, flush=True)
        print('y' * 200, file=sys.stderr)
    rounds.with_suffix('.part').write_text(str(k))
    rounds.with_suffix('.part').replace(rounds)
    time.sleep(0.02)
"""


class Run:
    """Bringup in a process of its own, with one node."""

    def __init__(self, folder, stderr=subprocess.DEVNULL, lines=0):
        self.domain = next_domain()
        self.temporary = folder / 'tmp'
        self.temporary.mkdir()
        self.rounds_file = folder / 'rounds'
        scene = folder / 'at-night.yaml'
        scene.write_text('nodes: {twin: {}, recorder: off}')
        self.process = subprocess.Popen(
            [sys.executable, '-c', BRINGUP, NODE, str(scene)],
            stderr=stderr,
            env={
                **os.environ,
                'ROS_DOMAIN_ID': str(self.domain),
                'EOL_STATE': str(folder / 'state'),
                'TMPDIR': str(self.temporary),
                'ROUNDS': str(self.rounds_file),
                'LINES': str(lines),
            },
        )

    def ask(self, timeout_s=2.0):
        """Return the status; an empty one where none comes."""
        with contextlib.suppress(EolError):
            return status.ask(self.domain, timeout_s)
        return {}

    def node(self):
        """Return the row of the node while it is well, else None."""
        rows = self.ask().get('nodes') or [{'level': 3}]
        return rows[0] if rows[0]['level'] == 0 else None

    def rounds(self):
        return int(self.rounds_file.read_text())

    def comes_back(self):
        """Kill the node and wait until another is well in its place; return that one's row."""
        pid = wait_until(self.node)['pid']
        os.kill(pid, signal.SIGKILL)
        return wait_until(lambda: (row := self.node()) and row['pid'] != pid and row)


@pytest.fixture
def start(tmp_path):
    runs = []

    def go(**options):
        runs.append(Run(tmp_path, **options))
        wait_until(lambda: runs[-1].node() or runs[-1].process.poll() is not None)
        return runs[-1]

    yield go
    for run in runs:
        run.process.send_signal(signal.SIGCONT)
        run.process.send_signal(signal.SIGINT)
        assert run.process.wait(30) == 0


def test_nodes_go_on_while_bringup_is_stopped(start, tmp_path):
    run = start(lines=20)  # 8 kB a round: a pipe is full after 8 of them
    before = run.node()
    run.process.send_signal(signal.SIGSTOP)
    time.sleep(0.5)
    rounds = run.rounds()
    wait_until(lambda: run.rounds() > rounds + 100)
    time.sleep(5.0)  # longer than a node may be silent
    run.process.send_signal(signal.SIGCONT)

    after = wait_until(run.node)
    assert after['pid'] == before['pid']
    assert run.ask()['restarts'] == 0
    events = tmp_path / 'state' / 'events.log'
    assert 'bringup stood still for' in wait_until(
        lambda: 'stood still' in (words := events.read_text()) and words
    )


def test_supervision_goes_on_while_the_terminal_is_held(start):
    master, slave = pty.openpty()
    run = start(stderr=slave, lines=5)
    os.write(master, b'\x13')  # Ctrl-S

    row = run.comes_back()
    assert row['text'] == 'at-night'
    assert run.ask()['restarts'] == 1

    os.write(master, b'\x11')  # Ctrl-Q: what was said meanwhile is shown
    seen = b''
    while b'has died (killed by SIGKILL)' not in seen:
        assert select.select([master], [], [], 10)[0], seen[-500:]
        seen += os.read(master, 65536)
    os.write(master, b'\x13')  # held again: a stop does not wait either
    run.process.send_signal(signal.SIGINT)
    assert run.process.wait(30) == 0
    os.close(master)
    os.close(slave)


def test_a_node_comes_back_after_a_cleaner_has_emptied_tmp(start):
    run = start()
    for path in run.temporary.iterdir():
        shutil.rmtree(path)

    assert run.comes_back()['text'] == 'at-night'


def test_status_of_a_stopped_supervisor(start, capsys, monkeypatch):
    run = start()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(run.domain))
    run.process.send_signal(signal.SIGSTOP)
    pid = run.process.pid
    code = cli.main(['status'])
    words = capsys.readouterr().err

    assert code == 1
    assert words == (
        f'eol status: the supervisor of domain {run.domain} (process {pid}) does not answer '
        f'within 2 s: it is stopped, `kill -CONT {pid}` lets it go on; its nodes run\n'
    )
    for _ in range(30):  # those who have given up are in no one's way
        assert run.ask(timeout_s=0.01) == {}
    run.process.send_signal(signal.SIGCONT)
    assert wait_until(run.node)


def test_status_where_a_supervisor_neither_answers_nor_stands(capsys, monkeypatch):
    domain = next_domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    with status.listen(domain):
        assert cli.main(['status']) == 1
        words = capsys.readouterr().err
        assert f'`kill -KILL {os.getpid()}`' in words and words.count('\n') == 1
    with pytest.raises(DeviceMissing, match='no graph runs'):
        status.ask(domain)


def test_status_of_a_supervisor_that_ends_while_it_is_asked():
    domain = next_domain()
    server = status.listen(domain)

    def end():
        select.select([server], [], [])
        server.accept()[0].close()

    thread = threading.Thread(target=end)
    thread.start()
    with pytest.raises(DeviceMissing, match='no graph runs'):
        status.ask(domain)
    thread.join()
    server.close()


LOUD = """
import os, rclpy.logging, sys
for k in range(400):
    print('x' * 100, flush=True)
    print('y' * 100, file=sys.stderr)
for k in range(400):
    rclpy.logging.get_logger('loud').warning('z' * 100)
os.write(int(os.environ['EOL_HEALTH_FD']), b'{"node": "loud", "level": 0}\\n')
"""


def test_no_way_to_print_waits_for_a_bringup_that_does_not_read(monkeypatch):
    monkeypatch.delenv('PYTHONUNBUFFERED', raising=False)
    child = Child(Process(('loud',), (sys.executable, '-c', LOUD), {}))
    child.start(0.0)
    fcntl.fcntl(child.output_fd, fcntl.F_SETPIPE_SZ, 4096)
    try:
        wait_until(lambda: child.popen.poll() is not None, 30.0)
        assert child.beats(0.0)
        assert set(child.output(0.0)[0]) == {'x'}
    finally:
        child.signal(signal.SIGKILL)
        assert child.reap() == 0


def test_a_child_that_never_stops_printing_does_not_keep_bringup_reading():
    child = Child(Process(('loud',), (), {}))
    with open('/dev/zero', 'rb') as endless:
        child.output_fd = endless.fileno()
        assert child.output(0.0) == []


def test_of_many_lines_the_newest_are_shown_and_the_others_counted(monkeypatch):
    monkeypatch.setattr(terminal, 'LINES', 3)
    monkeypatch.setattr(terminal, 'FLUSH_S', 10.0)
    out, into = os.pipe()
    fcntl.fcntl(into, fcntl.F_SETPIPE_SZ, 4096)
    with Terminal(into) as person:
        person.say('a' * 5000)  # fills the pipe: the thread is stuck in it
        wait_until(lambda: not person._lines)
        for k in range(10):
            person.say(f'line {k}')
        got = [b'']
        reader = threading.Thread(target=lambda: got.extend(iter(lambda: os.read(out, 4096), b'')))
        reader.start()
    os.close(into)
    reader.join()
    os.close(out)

    lines = b''.join(got).decode().splitlines()
    assert lines[1:] == [
        '(7 lines are not shown here; eol.log has them)',
        *(f'line {k}' for k in (7, 8, 9)),
    ]
