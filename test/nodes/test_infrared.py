# SPDX-License-Identifier: Apache-2.0
"""Twin, leds and tracker together: what is switched off is seen by the one who must know."""

import pytest
from eol_msgs.msg import Blocks
from rclpy.serialization import deserialize_message
from support.spinning import Nodes, states_of

from eol_ros.nodes.leds import LedsNode
from eol_ros.nodes.tracker import TrackerNode
from eol_ros.nodes.twin import TwinNode
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_ns
from eol_ros.scene import Scene
from eol_ros.settings import LedsSettings, MontageSettings, TrackerSettings, TwinSettings
from eol_ros.streams.requests import Asked

BLINK = {'blink_block': 7, 'blink_period_s': 0.6, 'blink_off_s': 0.1}


class Panel(EolNode):
    """Who asks and looks on."""

    NAME = 'montage'

    def __init__(self):
        super().__init__(MontageSettings(), scene=Scene('panel', {}))
        self.blocks, self.said = [], []
        self.subscribe('request_results', self.said.append)
        self.subscribe(
            'blocks', lambda raw: self.blocks.append(deserialize_message(raw, Blocks)), raw=True
        )
        self.states = states_of(self, 'tracker')


@pytest.fixture
def show(ros, request):
    """Nodes over real DDS; the twin's table is at rest."""
    tracker, leds = request.param
    alone = Scene('test', {})
    nodes = [
        TrackerNode(TrackerSettings(**tracker), scene=alone),
        LedsNode(LedsSettings(port='twin', **leds), scene=alone),
        TwinNode(TwinSettings(hands='nobody', fps=30.0), scene=alone),
        Panel(),
    ]
    panel = nodes[-1]
    with Nodes(*nodes) as turned:
        turned.meet()
        turned.until(lambda: nodes[1].lights.board.ready)
        turned.until(lambda: panel.blocks and panel.blocks[-1].state == Blocks.STATE_TRACKING)
        yield (*nodes, turned.until)


@pytest.mark.slow
@pytest.mark.parametrize('show', [({'background': 'lamps.png'}, {})], indirect=True)
def test_the_button_makes_the_tracker_learn_the_lamps(show, tmp_path, monkeypatch):
    tracker, _leds, _twin, panel, until = show
    monkeypatch.chdir(tmp_path)
    panel.requests.ask(Asked('learn_background', id='mine'))
    until(lambda: any(b.state == Blocks.STATE_LOST for b in panel.blocks))
    until(lambda: any('background learnt' in text for _, text in panel.states))
    assert tracker.tracker.background is not None
    assert (tmp_path / 'lamps.png').exists()
    until(lambda: panel.blocks[-1].state == Blocks.STATE_TRACKING)
    until(lambda: any(r.node == 'tracker' for r in panel.said))
    (answer,) = (r for r in panel.said if r.id == 'mine')  # of whom is asked last
    assert (answer.node, answer.kind, answer.accepted) == ('tracker', 'darkness', True)
    assert 'background learnt' in answer.reason and 'kept in lamps.png' in answer.reason
    (until_ns,) = (v.value.integer_value for v in answer.values)
    assert until_ns > to_ns(answer.from_stamp) > 0


@pytest.mark.slow
@pytest.mark.parametrize('show', [(BLINK | {'trust_start': False}, BLINK)], indirect=True)
def test_one_blinking_block_tells_which_way_round(show):
    _tracker, _leds, _twin, panel, until = show
    assert any(b.symmetry_ambiguous for b in panel.blocks)
    until(lambda: not panel.blocks[-1].symmetry_ambiguous)
    block = panel.blocks[-1].blocks[24]
    assert abs(block.x - 0.35) < 0.02
    assert abs(block.y - 0.35) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize('show', [({}, {})], indirect=True)
def test_calibration_from_the_panel(show):
    _tracker, _leds, twin, panel, until = show
    panel.requests.ask(Asked('calibrate', 'tracker'))
    until(lambda: any('calibrated by the blocks' in text for _, text in panel.states))
    until(lambda: panel.blocks[-1].state == Blocks.STATE_TRACKING)
    assert abs(panel.blocks[-1].blocks[24].x - twin.play.table.x[24]) < 0.002
    until(lambda: any(r.node == 'tracker' for r in panel.said))
    (answer,) = [r for r in panel.said if r.node == 'tracker']
    assert answer.kind == 'calibrate' and answer.accepted and 'calibrated' in answer.reason
