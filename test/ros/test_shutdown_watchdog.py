# SPDX-License-Identifier: Apache-2.0
"""A node whose DDS hangs on the way out ends all the same."""

import os
import signal
import subprocess
import sys

import pytest

HANGS = """
import ctypes, sys
import rclpy
from eol_ros.ros import run, session

def hang():
    print('down', flush=True)
    while True:
        ctypes.PyDLL(None).sleep(60)  # in C, with the lock of the interpreter; signals end it early

rclpy.try_shutdown = hang
session.LEAVE_S = 1
init = rclpy.init
def started(**kwargs):
    init(**kwargs)
    print('up', flush=True)
rclpy.init = started
sys.exit(run.run(['motion'], []))
"""


@pytest.mark.slow
def test_a_hang_inside_dds_is_ended_by_the_kernel():
    child = subprocess.Popen([sys.executable, '-c', HANGS], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == 'up\n'
        child.send_signal(signal.SIGTERM)
        assert child.stdout.readline() == 'down\n'
        child.send_signal(signal.SIGTERM)  # in vain
        assert child.wait(30) == -signal.SIGALRM
    finally:
        child.kill()
        child.communicate()


WARNS = """
import sys, warnings
from eol_ros.nodes.motion import MotionNode
from eol_ros.ros import run

def close(self):
    warnings.warn('divide\\nby zero', RuntimeWarning)
    print('closed', flush=True)

MotionNode.close = close
made = MotionNode.__init__
def begun(self, *words, **named):
    made(self, *words, **named)
    print('up', flush=True)
MotionNode.__init__ = begun
sys.exit(run.run(['motion'], []))
"""


@pytest.mark.slow
def test_a_warning_in_a_node_is_one_line_of_the_log():
    child = subprocess.Popen(
        [sys.executable, '-c', WARNS], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'PYTHONWARNINGS': 'default::RuntimeWarning'},
    )  # fmt: skip
    assert child.stdout.readline() == 'up\n'
    child.send_signal(signal.SIGTERM)
    out, err = child.communicate(timeout=60)
    assert out == 'closed\n'
    assert child.returncode == 0
    (line,) = (line for line in err.splitlines() if 'zero' in line)
    assert line.startswith('[WARN]')  # which the supervisor keeps off the terminal
    assert line.endswith('RuntimeWarning: divide by zero (<string>:7)')
    assert 'warnings.warn' not in err
