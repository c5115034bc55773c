# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from eol_msgs.msg import Block, Blocks, BlockTap, Cascade, FeltSlip, Slip
from support.spinning import Nodes
from support.tables import on_tables

from eol_ros.core.motion.slips import SlipDetector
from eol_ros.core.table import Table
from eol_ros.nodes.motion import MotionNode
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_msg, to_ns
from eol_ros.scene import Scene
from eol_ros.settings import MotionSettings

pytestmark = pytest.mark.usefixtures('any_stamp')


class Probe(EolNode):
    NAME = 'probe'

    def __init__(self, table):
        super().__init__(MotionSettings(), scene=Scene('probe', {}, table=table))
        self.blocks = self.publisher('blocks')
        self.taps = self.publisher('block_taps')
        self.slips, self.cascades, self.felt = [], [], []
        self.subscribe('felt_slips', self.felt.append)
        self.subscribe('slips', self.slips.append)
        self.subscribe('cascades', self.cascades.append)


@pytest.fixture
def graph(ros, table):
    node, probe = MotionNode(MotionSettings(), scene=Scene('motion', {}, table=table)), Probe(table)
    with Nodes(node, probe) as nodes:
        nodes.meet()
        yield node, probe, nodes


def track(nodes, node, probe, image, stamp_ns, place):
    """Publish the blocks of one image as the tracker does; return when the node has had them."""
    message = Blocks(state=Blocks.STATE_TRACKING, image=image)
    message.header.stamp = to_msg(stamp_ns)
    message.header.frame_id = 'table'
    message.blocks = [
        Block(id=i, x=x, y=y, sigma=1e-5, seen=bool(node.table.present[i]), visibility=1.0)
        for i, (x, y) in enumerate(place.tolist())
    ]
    probe.blocks.publish(message)
    nodes.until(lambda: node.health.ticks > image)


@pytest.mark.slow
@on_tables
def test_a_slip_goes_through_the_graph(graph, table):
    node, probe, nodes = graph
    near, moved = int(table.ids[3]), int(table.ids[table.count // 2])
    random = np.random.default_rng(1)
    start_ns = 1_700_000_000_123_456_789
    knock = BlockTap(block=moved, strength=2.9, sigma=2e-4)
    knock.header.stamp = to_msg(start_ns + 1_505_000_123)
    struck = BlockTap(block=near, strength=2.9, sigma=2e-4)  # and does not move
    struck.header.stamp = to_msg(start_ns + 2_000_000_000)
    for k in range(180):
        t = k / 60
        place = table.rest + random.normal(0, 1e-5, (table.cells, 2))
        place[moved, 1] += 1.25 * min(max(t - 1.505, 0), 0.12) ** 2
        for tap, at_s in ((knock, 1.505), (struck, 2.0)):
            if t - 1 / 60 <= at_s < t:  # it comes before the image that follows
                probe.taps.publish(tap)
                told = len(probe.felt)
                nodes.until(lambda told=told: len(probe.felt) > told)
        track(nodes, node, probe, k, start_ns + round(t * 1e9), place)
    nodes.until(lambda: probe.cascades and len(probe.slips) == 2)
    start, stop = probe.slips
    assert (start.kind, stop.kind) == (Slip.KIND_START, Slip.KIND_STOP)
    assert start.block == stop.block == moved
    assert start.slip == stop.slip
    assert [(f.kind, f.sense, f.block, f.slip) for f in probe.felt] == [
        (FeltSlip.KIND_PROVISIONAL, FeltSlip.SENSE_KNOCK, moved, 0),
        (FeltSlip.KIND_CONFIRMED, FeltSlip.SENSE_IMAGE, moved, start.slip),
        (FeltSlip.KIND_PROVISIONAL, FeltSlip.SENSE_KNOCK, near, 0),
        (FeltSlip.KIND_RETRACTED, FeltSlip.SENSE_IMAGE, near, 0),
    ]
    for tap, (first, verdict) in zip(
        (knock, struck), (probe.felt[:2], probe.felt[2:]), strict=True
    ):
        assert first.header.stamp == first.onset == verdict.onset == tap.header.stamp
        assert to_ns(verdict.header.stamp) - to_ns(first.onset) >= 100_000_000
        assert first.probability > 0.99
    assert (probe.felt[0].x, probe.felt[0].y) == pytest.approx(table.rest[moved], abs=1e-4)
    assert stop.tapped
    onset_s = start.onset.sec - 1_700_000_000 + start.onset.nanosec * 1e-9
    assert onset_s == pytest.approx(1.505 + 0.123456789, abs=0.006)
    decided = [start_ns + round(k / 60 * 1e9) for k in range(180)]
    assert start.header.stamp.sec * 10**9 + start.header.stamp.nanosec in decided
    assert stop.distance == pytest.approx(0.018, abs=2e-4)
    assert isinstance(probe.cascades[0], Cascade)
    assert list(probe.cascades[0].blocks) == [moved]
    assert isinstance(node.motion.detector, SlipDetector)
    values = node.health.status()['values']
    assert [values[k] for k in ('slips', 'felt', 'confirmed', 'retracted')] == [1, 2, 1, 1]


@pytest.mark.slow
@pytest.mark.parametrize('jump_s', [-3600, 3600])
def test_slips_go_on_when_the_clock_is_set(graph, jump_s):
    node, probe, nodes = graph
    warned = []
    node.get_logger().warning = warned.append
    random, start_ns = np.random.default_rng(1), 1_700_000_000_000_000_000
    for k in range(120):
        t = k / 60
        place = Table().rest + random.normal(0, 1e-5, (25, 2))
        for slip_s in (0.5, 1.5):  # a slip before the jump and one half a second after it
            place[12, 1] += 1.25 * min(max(t - slip_s, 0), 0.12) ** 2
        stamp_ns = start_ns + round((t + (k >= 60) * jump_s) * 1e9)
        track(nodes, node, probe, k, stamp_ns, place)
    nodes.until(lambda: len(probe.slips) == 4)
    assert [(s.kind, s.slip) for s in probe.slips] == [
        (Slip.KIND_START, 1), (Slip.KIND_STOP, 1), (Slip.KIND_START, 2), (Slip.KIND_STOP, 2),
    ]  # fmt: skip
    (line,) = warned
    way = 'ahead' if jump_s > 0 else 'back'
    assert line.startswith(f'time jumped {way} by 3') and line.endswith(' s: starting again')
    assert node.health.status()['values']['time_jumps'] == 1
