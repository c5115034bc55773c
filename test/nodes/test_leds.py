# SPDX-License-Identifier: Apache-2.0
"""The leds node over real DDS, with the twin's board on a real pty."""

import contextlib
import dataclasses

import numpy as np
import pytest
from eol_msgs.msg import NodeState, Slip
from rclpy.parameter import Parameter
from support.fake_board import FakeBoard
from support.spinning import Nodes

from eol_ros.core.table import Table
from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.board.fake import latency_s
from eol_ros.devices.board.twin import Felt, Radio
from eol_ros.errors import ConfigError
from eol_ros.nodes.leds import LedsNode
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import parameter_messages
from eol_ros.ros.stamps import now_ns, to_msg, to_ns
from eol_ros.said import translated
from eol_ros.scene import Machine, Scene
from eol_ros.settings import CameraSettings, LedsSettings, MotionSettings, TableSettings
from eol_ros.streams import blocks
from eol_ros.streams.requests import Asked

LIT = 191  # a slip after rest: three quarters of full light


class Around(EolNode):
    """The nodes around leds, in one: it gives slips and keeps what comes."""

    NAME = 'motion'

    def __init__(self, settings, table):
        super().__init__(settings, scene=Scene('around', {}, table=table))
        self.commands, self.taps, self.states = [], [], []
        self.slips, self.blocks = self.publisher('slips'), self.publisher('blocks')
        self.results = []
        self.subscribe('request_results', self.results.append)
        self.subscribe('led_commands', self.commands.append)
        self.subscribe('block_taps', self.taps.append)
        self.subscribe('/diagnostics', self.on_diagnostics)

    def on_diagnostics(self, array):
        self.states += [(s.level[0], s.message) for s in array.status if s.name == 'eol: leds']

    def slip(self, block, kind=Slip.KIND_START, ahead_s=0):
        message = Slip(kind=kind, block=block)
        message.header.stamp = to_msg(now_ns() + round(ahead_s * 1e9))
        message.onset = message.header.stamp
        self.slips.publish(message)
        return to_ns(message.header.stamp)


class Rig(Nodes):
    def __init__(self, scene=None, **settings):
        self.leds = LedsNode(LedsSettings(**settings), scene=scene)
        self.around = Around(MotionSettings(), self.leds.scene.table)
        super().__init__(self.leds, self.around)
        self.meet()


@pytest.fixture
def make_rig(ros):
    with contextlib.ExitStack() as rigs:
        yield lambda scene=None, **settings: rigs.enter_context(Rig(scene, **settings))


def heard_by(lights):
    """Return the list of the slips that `lights` gets from now on."""
    heard, slip = [], lights.slip

    def listen(*slipped):
        slip(*slipped)
        heard.append(slipped)

    lights.slip = listen
    return heard


@pytest.fixture
def rig(make_rig):
    rig = make_rig(port='twin', decay_s=0.182)
    assert rig.until(lambda: rig.leds.lights.board.ready)
    return rig


def test_a_slip_is_light_on_the_wire_with_the_stamp_of_its_image(rig):
    fake = rig.leds.lights.twin.fake
    stamp_ns = rig.around.slip(7)

    assert rig.until(lambda: rig.around.commands)
    command = rig.around.commands[0]
    assert to_ns(command.header.stamp) == stamp_ns
    assert command.white[7] == LIT and np.count_nonzero(command.white) == 1
    assert command.infrared
    assert to_ns(command.sent) > stamp_ns
    assert rig.until(lambda: any(a.stamp_us for a in list(fake.log)))
    arrived = next(a for a in fake.log if a.stamp_us)
    assert arrived.stamp_us == stamp_ns // 1000 % 2**32
    assert arrived.sequence == command.sequence
    assert latency_s(arrived) > 0  # how long it takes is measured by `eol bench graph`


def test_light_begins_now_where_the_clock_here_is_ahead_of_the_stamps(make_rig):
    machines = {'show': Machine('10.0.0.1', ('camera',)), 'light': Machine('10.0.0.2', ('leds',))}
    nodes = {'camera': CameraSettings(), 'leds': LedsSettings()}
    rig = make_rig(Scene('two', nodes, network='lan', machines=machines), port='twin')
    assert rig.until(lambda: rig.leds.lights.board.ready)
    values = parameter_messages({'offset_ms': 400.0, 'offset_error_ms': 1.0})
    rig.leds.main_clock.take(NodeState(node='machine_light', values=values))
    began_ns = now_ns()
    stamp_ns = rig.around.slip(7, ahead_s=-0.4)

    assert rig.until(lambda: rig.around.commands)
    rig.until(lambda: not rig.around.commands[-1].white[7])
    assert to_ns(rig.around.commands[0].header.stamp) == stamp_ns
    assert min(to_ns(c.sent) for c in rig.around.commands) >= began_ns
    assert rig.leds.lights.frames.late == 0
    assert rig.until(lambda: '400.0 ms of clock offset' in rig.leds.health.text)


def test_light_has_a_level_for_each_place_of_the_table_of_the_scene(make_rig):
    table = TableSettings(rows=2, columns=18, block_side_m=0.03, gap_m=0.02)
    scene = dataclasses.replace(Scene.alone('leds'), table=table)
    rig = make_rig(scene, port='twin')
    assert rig.until(lambda: rig.leds.lights.board.ready)
    rig.leds.on_test(Asked('test', 'leds'))

    assert rig.until(lambda: rig.around.commands)
    assert list(rig.around.commands[0].white) == [LIT] * 36
    assert rig.until(lambda: rig.leds.lights.twin.fake.levels()[35])


def test_the_light_dies_away_and_then_the_line_is_quiet(rig):
    rig.around.slip(3)
    assert rig.until(lambda: rig.around.commands)
    rig.until(lambda: not rig.leds.lights.glows)
    rig.until(lambda: not rig.around.commands[-1].white[3])
    levels = [c.white[3] for c in rig.around.commands]

    assert levels[0] == LIT and levels[-1] == 0
    assert max(np.diff(np.array(levels, int))) <= 0
    assert {c.sequence for c in rig.around.commands} == {rig.around.commands[0].sequence}
    assert len(levels) > 20
    rig.until(rig.leds.frames.is_canceled)  # nothing is left that could write
    assert len(rig.around.commands) == len(levels)
    rig.until(lambda: rig.leds.lights.twin.fake.levels() == [0] * 25)


def test_idle_light_needs_no_slip_and_no_frames_until_it_is_due(make_rig):
    rig = make_rig(port='twin', idle_period_s=600.0, decay_s=0.02)
    assert len([*rig.leds.timers]) < 8  # from eight on rclpy prints a warning
    assert rig.until(lambda: not rig.leds.idle.is_canceled())
    assert rig.leds.frames.is_canceled() and not rig.around.commands
    rig.leds.set_parameters([Parameter('idle_period_s', value=1.0)])
    assert rig.leds.idle.timer_period_ns <= 10**9

    assert rig.until(lambda: any(c.white[0] for c in rig.around.commands))
    rig.leds.set_parameters([Parameter('idle_period_s', value=600.0)])
    assert rig.until(rig.leds.frames.is_canceled)
    assert rig.leds.idle.timer_period_ns > 10**9


def test_idle_light_takes_the_stress_of_the_last_image_once_it_is_asked_to(make_rig):
    rig = make_rig(port='twin')
    assert not rig.leds.sees_blocks and np.isnan(rig.leds.stress()).all()
    rig.leds.set_parameters([Parameter('idle_by_stress', value=True)])
    rows, codec = np.zeros(25, blocks.BLOCK), blocks.Codec(definition(blocks.TYPE))
    rows['x'], rows['y'] = Table().rest.T
    rows['x'][[4, 9, 14, 19, 24]] += 0.01  # the springs to the last column are 1 cm longer

    def seen():
        rig.around.blocks.publish(codec.pack(now_ns(), TRACKING, False, 7, rows))
        return rig.leds.blocks

    assert rig.until(seen)
    strains = rig.leds.stress().reshape(5, 5)
    assert (strains[:, 3:] > 0.1).all() and np.allclose(strains[:, :3], 0, atol=1e-6)


def test_a_stop_makes_no_light(rig):
    rig.around.slip(5, Slip.KIND_STOP)
    rig.around.slip(6)
    rig.until(lambda: rig.around.commands)

    assert np.flatnonzero(rig.around.commands[0].white).tolist() == [6]


def test_what_the_blocks_of_the_twin_feel_is_published(rig):
    assert rig.until(lambda: rig.leds.lights.board.sync.ready)
    felt_ns, radio = now_ns() - 20_000_000, Radio()
    radio.send([Felt(felt_ns, 11, 2.45)])

    assert rig.until(lambda: rig.around.taps)
    radio.close()
    (tap,) = rig.around.taps
    assert (tap.block, tap.strength) == (11, pytest.approx(2.45))
    assert abs(to_ns(tap.header.stamp) - felt_ns) < max(10e6, 3e9 * tap.sigma)  # on a busy machine
    assert 0 < tap.sigma < 0.03


def test_a_battery_that_is_low_is_a_warning_and_the_rest_goes_on(make_rig):
    with FakeBoard() as fake:
        rig = make_rig(port=fake.port)
        assert rig.until(lambda: len(rig.leds.lights.board.blocks) == 26)
        fake.report(6, millivolts=2950)
        words = 'the battery of block 6 is at 3.0 V: charge it'
        assert rig.until(lambda: (1, words) in [(int(n), t) for n, t in rig.around.states])
        assert translated(rig.leds.health.text, 'zh-Hant') == '編號 6 方塊的電池剩 3.0 V：請充電'
        rig.around.slip(6)
        assert rig.until(lambda: fake.levels()[6] > 0)
        fake.report(6)
        assert rig.until(lambda: rig.around.states[-1][0] == 0)


def test_infrared_goes_off_while_the_tracker_learns(rig, monkeypatch):
    fake = rig.leds.lights.twin.fake
    rig.around.requests.ask(Asked('learn_background'))

    assert rig.until(lambda: fake.infrared_mask == 0)
    assert rig.until(lambda: rig.around.commands)
    assert not rig.around.commands[0].infrared
    assert rig.until(lambda: fake.infrared_mask != 0)
    assert rig.until(lambda: rig.around.commands[-1].infrared)


def test_asleep_it_stays_dark_and_a_test_lights_all(rig):
    rig.around.requests.ask(Asked('sleep', 'leds'))
    assert rig.until(lambda: rig.leds.lights.asleep)
    heard = heard_by(rig.leds.lights)
    rig.around.slip(1)
    rig.until(lambda: heard)
    assert not any(a.kind == 'Light' for a in rig.leds.lights.twin.fake.log)

    rig.around.requests.ask(Asked('test', 'leds'))
    assert rig.until(lambda: any(all(c.white) for c in rig.around.commands))


def test_the_run_goes_on_without_the_board_and_with_it_again(make_rig, tmp_path):
    link = str(tmp_path / 'board')
    with FakeBoard(link) as fake:
        rig = make_rig(port=link)
        assert rig.until(lambda: rig.leds.lights.board.ready)
        fake.fault('unplug')
        assert rig.until(lambda: any(level == 1 for level, _ in rig.around.states))
        heard = heard_by(rig.leds.lights)
        rig.around.slip(2)
        rig.until(lambda: heard)
        fake.fault('plug')
        assert rig.until(lambda: rig.leds.lights.board.ready)
        rig.around.slip(4)

        assert rig.until(lambda: fake.levels()[4] > 0)
        warned = [text for level, text in rig.around.states if level == 1]
        assert ('lost' in warned[0] or 'gone' in warned[0]) and 'trying again in' in warned[0]
        assert rig.until(lambda: rig.around.states[-1][0] == 0)


def test_the_limit_goes_off_only_with_a_reason(ros, make_rig):
    with pytest.raises(ConfigError, match='needs a written reason'):
        LedsNode(LedsSettings(port='twin', flash_limit='false'))
    rig = make_rig(port='twin', flash_limit='false', flash_limit_off_because='a video of one slip')
    assert rig.leds.lights.values()['flash_limit'] == 'off: a video of one slip'
