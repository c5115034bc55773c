# SPDX-License-Identifier: Apache-2.0
"""The work on one of several machines: a bag of slips that plays for ever."""

import contextlib
import signal
import sys

import pytest
from eol_msgs.msg import Slip
from rclpy.serialization import serialize_message

from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.ros.definitions import describe


@pytest.fixture(scope='module', name='bag')
def played_bag(tmp_path_factory):
    """One second of slips."""
    path = tmp_path_factory.mktemp('bags') / 'run'
    writer = BagWriter(path, [BagTopic('/eol/slips', **describe('slips'))], {})
    for i in range(50):
        now = 1_700_000_000_000_000_000 + i * 20_000_000
        writer.write('/eol/slips', bytes(serialize_message(Slip(slip=i))), now, now)
    writer.close()
    return str(path)


@contextlib.contextmanager
def play(machines, bag, *words):
    """The work: a bag that plays for ever."""
    child = machines.run('work', sys.executable, '-m', 'eol_ros', 'replay', bag, '--only', 'slips',
                         '--loop', '--wait', '0', *words)  # fmt: skip
    try:
        yield
    finally:
        child.send_signal(signal.SIGTERM)
        _, err = child.communicate(timeout=20)
    assert child.returncode == 0, err
