# SPDX-License-Identifier: Apache-2.0
"""The limit of flashes while the process that asks for light is killed again and again."""

import random
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from eol_msgs.msg import Slip
from support.fields_of_view import RATE_HZ, fields, most_in_a_second
from support.flashes import changes
from support.paper import rest_lattice
from support.spinning import Nodes

from eol_ros.devices.board.fake import FakeBoard
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.settings import MotionSettings

LEDS = [sys.executable, '-m', 'eol_ros.nodes', 'leds', '--ros-args', '-p', 'decay_s:=0.182', '-p']
EYES = (0.0, 0.0, 0.8), (0.0, -0.9, 0.6), (1.0, -1.0, 0.9)
SLIP_S = 0.06  # from slip to slip: without the limit more than ten flashes a second


class Motion(EolNode):
    """Publishes a slip of the next block every 60 ms."""

    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.slips, self.block = self.publisher('slips'), 0
        self.create_timer(SLIP_S, self.slip)

    def slip(self):
        self.block = (self.block + 7) % 25
        message = Slip(kind=Slip.KIND_START, block=self.block)
        message.header.stamp = message.onset = to_msg(now_ns())
        self.slips.publish(message)


class Eye(threading.Thread):
    """Looks at the blocks every 2 ms."""

    def __init__(self, fake):
        super().__init__(daemon=True)
        self.fake, self.times, self.shown = fake, [], []
        self.done = threading.Event()

    def run(self):
        while not self.done.wait(0.002):
            self.times.append(time.monotonic())
            self.shown.append(bytes(self.fake.levels()))

    def most_flashes_in_a_second(self, limit):
        """Of each block; and of all together, or of any field of view of 10 degrees."""
        each = np.frombuffer(b''.join(self.shown), np.uint8).reshape(-1, 25).T / 255
        most, together = 0, [each.mean(axis=0), each.max(axis=0)]
        if limit == 'field_of_view':
            at = np.arange(self.times[0], self.times[-1], 1 / RATE_HZ)
            levels = np.array([np.interp(at, self.times, light) for light in each]).T
            areas_sr = np.concatenate([fields(rest_lattice(), eye) for eye in EYES])
            most, together = most_in_a_second(levels, areas_sr), []
        for light in (*each, *together):
            found = changes(self.times, light)
            most = max([most, *(((found >= t) & (found <= t + 1)).sum() // 2 for t in found)])
        return most


def started(killed, port, limit, folder):
    """Start `leds` alone, or bringup with it: it ends with bringup."""
    words = [*LEDS, f'port:={port}', '-p', f'flash_limit:={limit}']
    if killed == 'bringup':
        scene = folder / 'scene.yaml'
        leds = f'{{port: {port}, flash_limit: {limit}, decay_s: 0.182}}'
        nodes = f'{{camera: {{device: none}}, tracker: {{}}, motion: {{}}, leds: {leds}}}'
        scene.write_text(f'scene: killed\nnodes: {nodes}\n')
        words = [sys.executable, '-m', 'eol_ros.bringup', scene, '--only', 'leds']
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.mark.parametrize(
    ('killed', 'limit'),
    [('leds', 'field_of_view'), ('bringup', 'field_of_view'), ('leds', 'field')],
)
@pytest.mark.parametrize(
    'kills',
    [
        pytest.param(2, marks=pytest.mark.slow),
        pytest.param(200, marks=[pytest.mark.soak, pytest.mark.timeout(3600)]),
    ],
)
def test_killing_breaks_no_limit(ros, tmp_path, kills, killed, limit):
    """Blocks knock by themselves all the while, and what they hold is bright at each kill."""
    rng, lit = random.Random(kills), 0
    with FakeBoard() as fake, Nodes(Motion()) as nodes:
        eye = Eye(fake)
        eye.start()
        for _ in range(kills):
            fake.log.clear()
            leds = started(killed, fake.port, limit, tmp_path)
            try:
                nodes.until(lambda: sum(a.kind == 'Light' for a in list(fake.log)) > 3)
                end = time.monotonic() + rng.uniform(0, 0.5)
                nodes.until(lambda end=end: time.monotonic() > end)
                fake.knock(rng.randrange(25), 2.0)
                lit += max(fake.levels()) > 128
            finally:
                leds.kill()
                leds.wait()
        eye.done.set()
        eye.join()
    assert lit == kills
    assert 1 <= eye.most_flashes_in_a_second(limit) <= 3
