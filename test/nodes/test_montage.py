# SPDX-License-Identifier: Apache-2.0
"""The montage node over real DDS: slips in, walls out."""

import itertools
import time

import pytest
from eol_msgs.msg import Slip, Wall
from rclpy.experimental.events_executor import EventsExecutor
from support.spinning import Nodes, states_of
from support.tables import on_tables
from support.waiting import GENEROUS_S, wait_until

from eol_ros.core.table import Table
from eol_ros.nodes.montage import MontageNode
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import now_ns, to_msg, to_ns
from eol_ros.scene import Scene
from eol_ros.settings import MontageSettings, MotionSettings
from eol_ros.streams.requests import Asked

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"><rect width="4" height="3"/></svg>'


class Around(EolNode):
    NAME = 'motion'

    def __init__(self, scene=None):
        super().__init__(MotionSettings(), scene)
        self.walls = []
        self.slips = self.publisher('slips')
        self.subscribe('wall', self.walls.append)
        self.states = states_of(self, 'montage')

    def slip(self, block, kind, cascade=0):
        message = Slip(kind=kind, block=block, cascade=cascade)
        message.header.stamp = to_msg(now_ns())
        self.slips.publish(message)
        return message.header.stamp

    def order(self, command, target=''):
        self.requests.ask(Asked(command, target))


class Rig(Nodes):
    def __init__(self, table=Table(), **settings):
        scene = Scene('test', {}, table=table)
        self.montage = MontageNode(MontageSettings(**settings), scene=scene)
        self.around = Around(scene)
        super().__init__(self.montage, self.around)
        self.meet()
        self.until(lambda: self.around.walls)

    def until(self, condition, seconds=GENEROUS_S):
        self.turn()  # what was just asked for is on its way
        return super().until(condition, seconds)


@pytest.fixture
def folder(tmp_path):
    for i in range(4):
        for side in 'lr':
            (tmp_path / f'{i}{side}.svg').write_text(SVG)
    (tmp_path / 'pairs.csv').write_text(''.join(f'{i}l.svg,{i}r.svg,words {i}\n' for i in range(4)))
    return tmp_path


@pytest.fixture
def rig(ros, folder):
    with Rig(pairs=str(folder), period_s=0.34, lead_s=0.05) as made:
        yield made


def changes(walls):
    """Return the first message of each change."""
    return [w for i, w in enumerate(walls) if i == 0 or w.change != walls[i - 1].change]


def test_a_first_pair_stands_before_anything_moves(rig):
    wall = rig.around.walls[0]
    assert wall.left[0] == wall.right[0] and wall.left.endswith('l.svg')
    assert wall.caption == f'words {wall.left[0]}' and not wall.moving
    names = {f'{i}{side}.svg' for i in range(4) for side in 'lr'}
    assert len(wall.ahead) == 16 and set(wall.ahead) <= names


@pytest.mark.slow
def test_shuffles_while_a_block_moves_and_freezes_with_the_last(rig):
    around = rig.around
    rig.run(0.4)
    begun = around.slip(3, Slip.KIND_START)
    around.slip(4, Slip.KIND_START)
    rig.run(0.8)
    around.slip(3, Slip.KIND_STOP)
    rig.run(0.7)
    ended = around.slip(4, Slip.KIND_STOP)
    rig.until(lambda: not around.walls[-1].moving)
    count = len(around.walls)
    rig.run(0.8)
    assert len(around.walls) == count  # frozen
    assert around.walls[-1].header.stamp == ended
    moved = [w for w in changes(around.walls)[1:] if w.moving]
    assert all(w.header.stamp == begun for w in moved)
    flips = [to_ns(w.flip) for w in moved]
    assert len(flips) >= 4
    gaps = [b - a for a, b in itertools.pairwise(flips)]
    assert min(gaps) >= 0.34e9 - 100_000  # each is known to 50 us in system time
    assert flips[0] - to_ns(begun) < 0.5e9
    for now, following in itertools.pairwise(moved):
        assert now.ahead[:2] == [following.left, following.right]


@pytest.mark.slow
@on_tables
def test_a_rupture_damages_the_pair_that_stands_and_calm_heals_it(ros, folder, table):
    for i in range(4):
        (folder / f'{i}r.svg').rename(folder / f'{i}r.1.svg')
        for degree in (2, 3, 4):
            (folder / f'{i}r.{degree}.svg').write_text(SVG)
    with Rig(table, pairs=str(folder), period_s=0.34, lead_s=0.05, heal_s=3.0) as rig:
        around = rig.around
        assert around.walls[0].right.endswith('r.1.svg') and around.walls[0].left.endswith('l.svg')
        for block in table.ids.tolist():
            around.slip(block, Slip.KIND_START, cascade=9)
        rig.until(lambda: around.walls[-1].ahead[1].endswith('.4.svg'))
        for block in table.ids.tolist():
            around.slip(block, Slip.KIND_STOP, cascade=9)
        rig.until(lambda: not around.walls[-1].moving and around.walls[-1].right[3] > '1')
        broken = len(around.walls)
        rig.until(lambda: around.walls[-1].right.endswith('.1.svg'))
    healing = around.walls[broken - 1 :]
    assert len({w.left for w in healing}) == 1  # the pair with which it froze
    degrees = [int(w.right[3]) for w in healing]
    assert degrees == sorted(degrees, reverse=True) and len(set(degrees)) > 1
    flips = [to_ns(w.flip) for w in changes(around.walls)]
    assert min(b - a for a, b in itertools.pairwise(flips)) >= 0.34e9 - 100_000
    known = set().union(*(w.ahead for w in around.walls))
    moved = [w for w in changes(around.walls)[1:] if w.moving]
    assert all({w.left, w.right} <= known for w in moved)  # and so decoded in time


@pytest.mark.slow
def test_sleeps_black_and_wakes(rig):
    around = rig.around
    around.order('sleep', target='sound')
    rig.run(0.3)
    assert around.walls[-1].left
    around.order('sleep')
    rig.until(lambda: not around.walls[-1].left and not around.walls[-1].right)
    around.slip(1, Slip.KIND_START)
    rig.run(0.8)
    assert not around.walls[-1].left
    around.slip(1, Slip.KIND_STOP)
    around.order('wake')
    rig.until(lambda: around.walls[-1].left)


@pytest.mark.slow
def test_hot_reload_names_what_it_skips_and_keeps_the_walls(rig, folder):
    (folder / '2l.svg').write_text('broken')
    rig.until(lambda: any('2l.svg: not an SVG' in text for _, text in rig.around.states))
    assert rig.around.states[-1][0] == 1  # a warning
    (folder / 'pairs.csv').unlink()
    rig.until(lambda: any('no pairs.csv' in text for _, text in rig.around.states))
    assert isinstance(rig.around.walls[-1], Wall) and rig.around.walls[-1].left


@pytest.mark.slow
def test_many_slips_at_once_silence_no_timer(ros):
    """In the executor of `ros/run.py`, where they have waited for the processor."""
    montage = MontageNode(MontageSettings())
    executor, told, over = EventsExecutor(), [], []
    executor.add_node(montage)
    montage.create_timer(0.5, lambda: told.append(time.monotonic()))

    def come():
        burst.cancel()
        time.sleep(0.5)
        for block in range(20):
            montage.on_slip(Slip(kind=Slip.KIND_START, block=block))
        over.append(time.monotonic())

    burst = montage.create_timer(1.2, come)
    # Twenty resets would have called it twenty times in a row, and then not for 10 s.
    wait_until(
        lambda: over and told[-1] > over[0] + 0.5, 6,
        turn=lambda: executor.spin_once(timeout_sec=0.05),
    )  # fmt: skip
    assert burst.is_canceled()
    executor.remove_node(montage)
    montage.destroy_node()
    executor.shutdown(timeout_sec=1.0)
