# SPDX-License-Identifier: Apache-2.0
"""What a developer sees of a callback that raises, in a shell and under bringup."""

import os
import re
import subprocess
import sys

import pytest
from support.attended import attended
from support.domains import next_domain
from support.waiting import wait_until

from eol_ros.bringup import status
from eol_ros.bringup.event_log import EventLog
from eol_ros.bringup.plan import Process
from eol_ros.bringup.supervisor import Supervisor

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
NODE = """\
import sys
from eol_msgs.msg import RimCommand
from eol_ros.errors import DeviceMissing
from eol_ros.nodes.motion import MotionNode
from eol_ros.ros.run import run

def boom():
    if FAULT == 'expected':
        raise DeviceMissing('no such table')
    try:
        raise KeyError('first')
    except KeyError as error:
        raise ValueError('of\\ntwo lines') from (error if FAULT == 'chained' else None)

class Failing(MotionNode):
    NAME = 'motion'

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        if FAULT == 'timer':
            self.create_timer(1.5, boom)
        else:
            self.subscribe('rim_command', self.on_hand, raw=True)
            self.pub = self.publisher('rim_command')
            self.create_timer(0.2, lambda: self.pub.publish(RimCommand()))

    def on_hand(self, raw):
        boom()

import eol_ros.nodes.motion
eol_ros.nodes.motion.MotionNode = Failing
sys.exit(run(['motion'], []))
"""


def script(fault):
    return f'FAULT = {fault!r}\n{NODE}'


@pytest.mark.parametrize('fault', ['timer', 'chained'])
def test_a_callback_that_raises_ends_in_one_line(fault):
    env = {**os.environ, 'ROS_DOMAIN_ID': str(next_domain())}
    done = subprocess.run(
        [sys.executable, '-c', script(fault)], env=env, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 1
    *before, last = done.stderr.splitlines()
    name = 'boom' if fault == 'timer' else 'on_hand'
    line = rf'motion: {name}\(\) failed with ValueError: of two lines \(<string>:\d+\); '
    assert re.fullmatch(line + 'its traceback is above', last)
    trace = '\n'.join(before)
    assert 'in boom' in trace and trace.count('[FATAL]') == 1  # of rclpy, with its traceback
    assert ('KeyError' in trace) == (fault == 'chained') and '\nTraceback' not in trace


def test_an_expected_error_in_a_callback_keeps_its_own_line_and_code():
    env = {**os.environ, 'ROS_DOMAIN_ID': str(next_domain())}
    done = subprocess.run(
        [sys.executable, '-c', script('expected')], env=env, capture_output=True, text=True,
        timeout=120,
    )  # fmt: skip
    assert done.returncode == 69 and done.stderr.splitlines()[-1] == 'motion: no such table'


def test_bringup_shows_that_line_alone_and_starts_the_node_again(tmp_path, monkeypatch):
    domain = next_domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    lines = []
    command = (sys.executable, '-c', script('chained'))
    with status.listen(domain) as server, EventLog(tmp_path) as events:
        supervisor = Supervisor('test', [Process(('motion',), command, {})], server, events,
                                lines.append)  # fmt: skip

        def restarted():
            return supervisor.children[0].policy.restarts >= 1

        attended(supervisor, lambda: wait_until(restarted))
    shown = [line for line in lines if '|' in line]
    assert all(line.startswith('motion | motion: ') for line in shown), shown
    assert shown[0].endswith(f'its traceback is in {tmp_path / "eol.log"}')
    assert any('motion has died (exit code 1); ' in line for line in lines)
    assert 'in boom' in (tmp_path / 'eol.log').read_text()
