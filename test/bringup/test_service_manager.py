# SPDX-License-Identifier: Apache-2.0
"""What systemd hears of bringup, at the other end of a real socket."""

import os
import signal
import socket
import subprocess
import sys

import pytest

from eol_ros.bringup.service_manager import ServiceManager


@pytest.fixture
def heard(tmp_path):
    """A socket as systemd has it; its `recv` waits for a line."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / 'notify'))
        listening.settimeout(60)
        yield listening


def test_what_is_told_and_how_often(heard):
    now, environ = [100.0], {'NOTIFY_SOCKET': heard.getsockname(), 'WATCHDOG_USEC': '4000000'}
    with ServiceManager(environ, lambda: now[0]) as manager:
        assert environ == {}  # no child tells in its name
        manager.ready()
        manager.ready()
        manager.status('all OK')
        manager.status('all OK')
        for _ in range(50):  # five seconds
            now[0] += 0.1
            manager.beat()
        manager.status('leds: no board')
        manager.stopping()
    heard.setblocking(False)
    lines = []
    with pytest.raises(BlockingIOError):
        while True:
            lines.append(heard.recv(4096).decode())

    assert lines == [
        'READY=1',
        'STATUS=all OK',
        'WATCHDOG=1',
        'WATCHDOG=1',
        'STATUS=leds: no board',
        'STOPPING=1',
    ]


def test_a_watchdog_of_another_process_is_not_ours(heard):
    now = [0.0]
    environ = {
        'NOTIFY_SOCKET': heard.getsockname(), 'WATCHDOG_USEC': '1000', 'WATCHDOG_PID': '1',
    }  # fmt: skip
    with ServiceManager(environ, lambda: now[0]) as manager:
        now[0] = 10.0
        manager.beat()
        manager.stopping()
    assert heard.recv(4096) == b'STOPPING=1'


def test_one_who_does_not_listen_holds_nobody_up(heard):
    with ServiceManager({'NOTIFY_SOCKET': heard.getsockname()}, lambda: 0.0) as manager:
        for _ in range(10_000):  # far more than the socket takes
            manager.stopping()
    assert heard.recv(4096) == b'STOPPING=1'  # those that it took are there
    for environ in ({'NOTIFY_SOCKET': '/nowhere/notify'}, {}):
        with ServiceManager(environ, lambda: 0.0) as manager:
            manager.ready()


@pytest.mark.slow
def test_bringup_tells_from_its_start_to_its_end(heard, tmp_path):
    scene = tmp_path / 'dark.yaml'
    scene.write_text('nodes: {montage: {}, recorder: off}\nelsewhere: [motion]\n')
    environ = {
        **os.environ, 'NOTIFY_SOCKET': heard.getsockname(), 'WATCHDOG_USEC': '1000000',
    }  # fmt: skip
    words = [sys.executable, '-m', 'eol_ros.bringup', str(scene)]
    with subprocess.Popen(words, env=environ, stderr=subprocess.DEVNULL) as process:
        lines = [heard.recv(4096).decode()]
        while lines[-1] != 'STATUS=dark: all OK; 1 nodes, 0 restarts' or 'WATCHDOG=1' not in lines:
            lines.append(heard.recv(4096).decode())
        process.send_signal(signal.SIGINT)  # as KillSignal says
        while lines[-1] != 'STOPPING=1':
            lines.append(heard.recv(4096).decode())
        assert process.wait(60) == 0

    assert lines.count('READY=1') == 1
    assert lines.index('READY=1') < lines.index('STATUS=dark: all OK; 1 nodes, 0 restarts')
