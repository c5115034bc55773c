# SPDX-License-Identifier: Apache-2.0
"""A node whose DDS hangs on the way out ends all the same."""

import signal
import subprocess
import sys

import pytest

HANGS = """
import ctypes, sys
import rclpy
from eol_ros.ros import leave, run

def hang():
    print('down', flush=True)
    while True:
        ctypes.PyDLL(None).sleep(60)  # in C, with the lock of the interpreter; signals end it early

rclpy.try_shutdown = hang
leave.end_in_time.__defaults__ = (1,)
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


@pytest.mark.slow
def test_a_node_that_leaves_in_time_ends_with_0():
    words = HANGS.replace('rclpy.try_shutdown = hang\n', '')
    child = subprocess.Popen([sys.executable, '-c', words], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == 'up\n'
        child.send_signal(signal.SIGTERM)
        assert child.wait(30) == 0
    finally:
        child.kill()
