# SPDX-License-Identifier: Apache-2.0
"""A node that takes long to be made, or to answer, goes on telling how it is, once a second."""

import itertools
import json
import os
import subprocess
import sys
import time

import pytest

SLOW = """
import sys, time
from eol_ros.nodes.montage import MontageNode
from eol_ros.ros import run

class Slow(MontageNode):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        for _ in range(3):
            self.create_timer(0.2, lambda: None)
        time.sleep(1.3)
        self.other = self.create_timer(100.0, lambda: None)
        self.once = self.create_timer(0.1, self.stall)

    def stall(self):
        # the heartbeat is due, and the executor looks at it eight times
        self.once.cancel()
        time.sleep(1.1)
        for _ in range(8):
            self.other.reset()

run.node_class = lambda name: Slow
sys.exit(run.run(['montage'], []))
"""
LONG_S = 3.0


@pytest.mark.live
@pytest.mark.slow
def test_heartbeats_come_each_second_after_a_slow_start():
    """Timers that were overdue, or reset, put the next heartbeat off by seconds."""
    out, into = os.pipe()
    node = subprocess.Popen(
        [sys.executable, '-c', SLOW], pass_fds=[into],
        env={**os.environ, 'EOL_HEALTH_FD': str(into)},
    )  # fmt: skip
    os.close(into)
    beats: list[float] = []
    with os.fdopen(out) as lines:
        for line in lines:
            if json.loads(line).get('node') == 'montage':
                beats.append(time.monotonic())
            if beats and beats[-1] - beats[0] > LONG_S:
                break
        node.terminate()
        assert node.wait(30) == 0

    assert max(b - a for a, b in itertools.pairwise(beats)) < 3.0
