# SPDX-License-Identifier: Apache-2.0
"""The limit of flashes while what asks for light, or limits it, is killed again and again."""

import contextlib
import functools
import random
import subprocess
import sys
import time

import numpy as np
import pytest
from eol_msgs.msg import Slip
from support.fake_board import FakeBoard
from support.fields_of_view import RATE_HZ, fields, most_in_a_second
from support.flashes import changes
from support.paper import rest_lattice
from support.spinning import Nodes
from support.waiting import wait_until

from eol_ros.bringup.shared_memory import Ports
from eol_ros.core.light.bridge import Bridge
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


def record_calls(bridge):
    """Return a list to which the bridge adds what is done to it: methods and arguments."""
    diary = []

    def note(name, do, *args):
        diary.append((name, args))
        return do(*args)

    for name in ('configure', 'felt', 'light', 'link', 'hear'):
        setattr(bridge, name, functools.partial(note, name, getattr(bridge, name)))
    return diary


def seen(diary):
    """Return times and levels (n, 25) every 4 ms, however busy the machine was meanwhile."""
    bridge, at_s, times, levels = Bridge(), diary[0][1][0], [], []
    for name, (now_s, *args) in diary:
        while at_s < now_s:
            times.append(at_s)
            levels.append(bridge.levels(at_s))
            at_s += 0.004
        getattr(bridge, name)(now_s, *args)
    return np.array(times), np.array(levels)


def most_flashes_in_a_second(times, levels, limit):
    """Of each block; and of all together, or of any field of view of 10 degrees."""
    most, together = 0, [levels.mean(axis=1), levels.max(axis=1)]
    if limit == 'field_of_view':
        at = np.arange(times[0], times[-1], 1 / RATE_HZ)
        looks = np.array([np.interp(at, times, light) for light in levels.T]).T
        areas_sr = np.concatenate([fields(rest_lattice(), eye) for eye in EYES])
        most, together = most_in_a_second(looks, areas_sr), []
    for light in (*levels.T, *together):
        found = changes(times, light)
        most = max([most, *(((found >= t) & (found <= t + 1)).sum() // 2 for t in found)])
    return most


def started(killed, port, limit, folder):
    """Start `leds` alone, or bringup with it: it ends with bringup."""
    words = [*LEDS, f'port:={port}', '-p', f'flash_limit:={limit}']
    if killed in ('bringup', 'all'):
        scene = folder / 'scene.yaml'
        leds = f'{{port: {port}, flash_limit: {limit}, decay_s: 0.182}}'
        nodes = f'{{camera: {{device: none}}, tracker: {{}}, motion: {{}}, leds: {leds}}}'
        scene.write_text(f'scene: killed\nnodes: {nodes}\n')
        words = [sys.executable, '-m', 'eol_ros.bringup', scene, '--only', 'leds']
    with (folder / 'said').open('ab') as said:
        return subprocess.Popen(words, stdout=said, stderr=said)


@pytest.mark.parametrize(
    ('killed', 'limit'),
    [
        ('leds', 'field_of_view'), ('bridge', 'field_of_view'), ('bringup', 'field_of_view'),
        ('all', 'field_of_view'), ('leds', 'field'),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    'kills',
    [
        pytest.param(2, marks=pytest.mark.slow),
        pytest.param(200, marks=[pytest.mark.soak, pytest.mark.timeout(3600)]),
    ],
)
def test_killing_breaks_no_limit(ros, tmp_path, kills, killed, limit):
    """Blocks knock by themselves all the while, and what they hold is bright at each kill.

    `all` is bringup, `leds` and the bridge at once.
    """
    rng, lit, ports = random.Random(kills), 0, Ports()
    port, said = str(tmp_path / 'board'), tmp_path / 'said'
    with FakeBoard(port) as fake, Nodes(Motion()) as nodes, contextlib.ExitStack() as stack:
        diary, leds = record_calls(fake.bridge), None
        for _ in range(kills):
            fake.log.clear()
            if leds is None:
                leds = started(killed, port, limit, tmp_path)
                stack.callback(leds.wait)
                stack.callback(leds.kill)
            wait_until(
                lambda: sum(a.kind == 'Light' for a in list(fake.log)) > 3,
                turn=nodes.turn,
                why=lambda: f'no light; {fake.log}; {said.read_text()[-4000:]}',
            )
            end = time.monotonic() + rng.uniform(0, 0.5)
            nodes.until(lambda end=end: time.monotonic() > end)
            fake.knock(rng.randrange(25), 2.0)
            lit += max(fake.levels()) > 128
            if killed != 'bridge':
                ports.look(leds.pid)
                leds.kill()
                leds.wait()
                leds = None
                ports.end()  # as bringup does where a node has ended
            if killed in ('bridge', 'all'):  # the power of the bridge is its plug
                fake.fault('unplug')
                nodes.run(rng.uniform(0, 0.2))
                fake.fault('plug')
    fake.bridge.light(now_s := time.monotonic(), 0)
    last = fake.bridge.levels(now_s)
    times, levels = seen(diary)
    assert levels[-1] == pytest.approx(last, abs=0.1)
    assert lit >= 0.98 * kills  # on a busy machine it may have faded until it is looked at
    assert 1 <= most_flashes_in_a_second(times, levels, limit) <= 3
