# SPDX-License-Identifier: Apache-2.0
"""Requests over real DDS: who answers, from when it counts, and the tools of the command line."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from eol_msgs.msg import Slip
from rclpy.parameter import Parameter
from support.spinning import Nodes, spinning_in

from eol_ros.cli import main
from eol_ros.errors import EolError
from eol_ros.nodes.motion import MotionNode
from eol_ros.nodes.replay import ReplayNode
from eol_ros.ros import requests
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import expected_of, request_from_msg, request_to_msg
from eol_ros.settings import MontageSettings, MotionSettings, ReplaySettings
from eol_ros.streams.requests import Asked, values_of

SAMPLE = Path(__file__).parents[2] / 'bags' / 'sample'
NOW_NS = 1_790_000_000_000_000_000


class Around(EolNode):
    NAME = 'montage'

    def __init__(self):
        super().__init__(MontageSettings())
        self.results, self.asked = [], []
        self.subscribe('request_results', self.results.append)
        self.subscribe('requests', self.asked.append)
        self.slips: list[Slip] = []


class Rig(Nodes):
    def __init__(self, node):
        self.node, self.around = node, Around()
        super().__init__(self.node, self.around)
        self.meet()

    def answer(self, *asked, **values):
        before = len(self.around.results)
        self.around.requests.ask(Asked(*asked, **values))
        self.until(lambda: len(self.around.results) > before)
        return self.around.results[-1]


@pytest.fixture
def rig(ros):
    with Rig(MotionNode(MotionSettings())) as made:
        yield made


def test_a_message_says_what_was_asked():
    asked = Asked('set', 'grains', {'a': 1, 'b': 0.5, 'c': True, 'd': 'x', 'e': ('p', 'q')},
                  b'\x00\xff', NOW_NS + 1, 'id', 'who')  # fmt: skip
    assert request_from_msg(request_to_msg(asked, NOW_NS)) == asked


@pytest.mark.slow
def test_a_setting_is_changed_or_refused_with_the_reason(rig):
    done = rig.answer('set', 'motion', {'stop_mps': 0.002})
    assert (done.accepted, done.node, done.kind) == (True, 'motion', 'set')
    assert done.reason == 'stop_mps is 0.002' and rig.node.settings.stop_mps == 0.002
    assert rig.node.get_parameter('stop_mps').value == 0.002
    assert done.code == 'is_now'
    codes = []
    for values, words in (
        ({'stop_mps': 7.0}, 'stop_mps: 7 is out of range'),
        ({'stop_mps': 'slow'}, "stop_mps: 'slow' is not a number"),
        ({'stop_mqs': 0.1}, 'motion has no setting stop_mqs. Did you mean stop_mps?'),
        ({}, 'names no setting'),
    ):
        refused = rig.answer('set', 'motion', values)
        assert not refused.accepted and words in refused.reason
        codes.append((refused.code, values_of(refused.args).get('why:')))
    assert codes == [
        ('of_node', 'out_of_range'), ('of_node', 'not_a_line'), ('no_setting', None), ('', None),
    ]  # fmt: skip
    refused = rig.answer('dance', 'motion')
    assert not refused.accepted and refused.reason.endswith('; motion is asked for set')
    assert refused.reason.startswith('dance: no such request. Of 15, the nearest are ')
    assert rig.node.settings.stop_mps == 0.002


@pytest.mark.slow
def test_what_ros2_param_set_changes_is_told_too(rig):
    rig.node.stamped(NOW_NS)
    rig.node.set_parameters([Parameter('stop_mps', value=0.003)])
    rig.until(lambda: rig.around.results and rig.around.asked)
    asked, result = request_from_msg(rig.around.asked[-1]), rig.around.results[-1]
    assert (asked.kind, asked.source, asked.values) == ('set', 'motion', {'stop_mps': 0.003})
    assert result.id == asked.id and result.accepted
    assert asked.from_ns == NOW_NS + 1_000_000  # the next image
    rig.node.set_parameters([Parameter('stop_mps', value=0.003)])  # no change, nothing to tell
    rig.answer('set', 'motion', {'stop_mps': 0.004})
    assert len(rig.around.results) == 2


@pytest.mark.slow
def test_what_counts_from_a_later_image_waits_for_it(rig):
    rig.node.stamped(NOW_NS)
    asked = Asked('set', 'motion', {'stop_mps': 0.005}, from_ns=NOW_NS + 50_000_000)
    rig.around.requests.ask(asked)
    first = Asked('set', 'motion', {'stop_mps': 0.006}, from_ns=NOW_NS + 20_000_000)
    rig.around.requests.ask(first)
    rig.until(lambda: len(rig.node.requests._waiting) == 2)
    seen = []
    for k in range(5):
        rig.node.stamped(NOW_NS + k * 16_666_667)
        seen.append(rig.node.settings.stop_mps)
    assert seen == [0.001, 0.001, 0.006, 0.005, 0.005]
    rig.until(lambda: len(rig.around.results) == 2)


def test_a_recorder_is_waited_for_that_comes_after_the_named_node(monkeypatch):
    now_s, names = [0.0], ['sound']
    monkeypatch.setattr(requests.time, 'monotonic', lambda: now_s[0])

    def ends(_topic):
        return [SimpleNamespace(node_name=name) for name in names]

    graph = SimpleNamespace(
        resolve_topic_name=str, get_subscriptions_info_by_topic=ends,
        get_publishers_info_by_topic=ends,
    )  # fmt: skip
    found = requests._Heeding(graph)
    assert not found.whole('sound', matched=1)
    now_s[0] = 1.0
    names.append('recorder')
    assert not found.whole('', matched=2), 'more may come'
    assert found.whole('sound', matched=2) and not found.whole('sound', matched=1)
    assert not found.whole('leds', matched=2)
    names.remove('recorder')
    assert not found.whole('sound', matched=1)
    now_s[0] = 2.6
    assert found.whole('sound', matched=1), 'a scene without a recorder'


def test_who_must_answer_and_who_does_not_run():
    running = {'leds', 'sound'}.__contains__
    assert expected_of('sleep', '', running) == {'leds', 'sound'}
    assert expected_of('sleep', 'sound', running) == {'sound'}
    for kind, node, words in (
        ('sleep', 'montage', 'montage does not run'),
        ('calibrate', '', 'tracker does not run'),
        ('learn_background', '', 'tracker does not run'),  # it is the one who learns
        ('move_grain', '', 'grains does not run'),
        ('mute', 'leds', 'leds does not heed it'),
        ('dance', '', 'no such request'),
    ):
        with pytest.raises(EolError, match=words):
            expected_of(kind, node, running)
    both = {'leds', 'tracker'}.__contains__
    assert expected_of('learn_background', '', both) == {'tracker'}


@pytest.fixture
def spinning(ros):
    """The node motion, for what visits the graph."""
    with spinning_in(lambda context: MotionNode(MotionSettings(), context=context)) as node:
        yield node


@pytest.mark.slow
def test_the_command_line_asks_and_reads(spinning, capfd):
    assert main(['param', 'set', 'motion', 'stop_mps', '0.002']) == 0
    assert capfd.readouterr().out == 'motion: done, stop_mps is 0.002\n'
    assert main(['param', 'get', 'motion', 'stop_mps']) == 0
    assert capfd.readouterr().out == '0.002\n'
    assert main(['param', 'list', 'motion', '--json']) == 0
    assert json.loads(capfd.readouterr().out)['stop_mps'] == 0.002
    assert main(['call', 'set', 'motion', 'stop_mps=8']) == 1
    told = capfd.readouterr()
    assert 'motion: refused, stop_mps: 8 is out of range' in told.out
    assert main(['call', 'mute', '--json']) == 69
    assert 'sound does not run here' in capfd.readouterr().err


@pytest.mark.slow
def test_the_rate_of_a_replay_is_changed_while_it_plays(ros, capfd):
    settings = ReplaySettings(bag=str(SAMPLE), wait_s=0.0, loop=True)
    with spinning_in(lambda context: ReplayNode(settings, context=context)) as node:
        assert main(['param', 'set', 'replay', 'rate', '4']) == 0
        assert capfd.readouterr().out == 'replay: done, rate is 4.0\n'
        assert (node.settings.rate, node.player.rate) == (4.0, 4.0)
        assert main(['param', 'set', 'replay', 'rate', '0']) == 1
        assert 'replay: refused, Parameter rate out of range' in capfd.readouterr().err


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['call', 'dance'], 'no such request. Of 15, the nearest are '),
        (['call', 'darkness', 'until_ns=3'], 'no such request'),
        (['call'], 'name a kind of request'),
        (['call', 'set', 'radius=1'], 'the node is missing'),
        (['call', 'play_grain', 'grain'], 'grain does not heed it, but sound'),
        (['call', 'play_grain', 'sound', 'grain'], "'grain' is not NAME=VALUE"),
        (['call', 'play_grain', 'grain=-1'], 'grain: -1 is not within'),
        (['param', 'get', 'moon'], 'no such node'),
        (['param', 'get', 'grains', 'radios'], 'grains has no setting radios'),
        (['param', 'set', 'grains', 'radius'], 'the value is missing'),
        (['param', 'set', 'twin', 'seed', '3'], 'write it into the scene, and start that again'),
    ],
)
def test_a_wrong_command_line_is_one_line(words, said, capfd):
    assert main(words) == 2
    err = capfd.readouterr().err
    assert said in err and len(err.strip().splitlines()) == 1


def test_what_can_be_asked_is_listed(capfd):
    assert main(['call', '--list', '--json']) == 0
    rows = {row['kind']: row for row in json.loads(capfd.readouterr().out)}
    assert rows['move_grain']['takes'] == ['grain', 'x', 'y'] and 'darkness' not in rows
    assert main(['call', '--list']) == 0
    assert 'play_grain grain=' in capfd.readouterr().out
