# SPDX-License-Identifier: Apache-2.0
import contextlib
import dataclasses
import shutil

import numpy as np
import pytest
from eol_msgs.msg import FeltSlip
from rclpy.parameter import Parameter
from support.spinning import Nodes
from support.tables import on_tables
from support.waiting import GENEROUS_S

from assets.ice import ice
from eol_ros.core.sound.corpus import DESCRIPTORS
from eol_ros.core.sound.select import Selector
from eol_ros.core.table import Table
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_file
from eol_ros.devices.corpus.corpus_build import build_cached
from eol_ros.devices.corpus.corpus_file import Options
from eol_ros.nodes.grains import GrainsNode
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import request_to_msg
from eol_ros.ros.stamps import NS, now_ns, to_msg, to_ns
from eol_ros.scene import Scene
from eol_ros.settings import GrainsSettings
from eol_ros.streams.blocks import BLOCK, TYPE, Codec
from eol_ros.streams.corpus import to_json
from eol_ros.streams.requests import Asked

NAN = float('nan')
START_NS = 1_700_000_000_123_456_789
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('any_stamp')]


class Probe(EolNode):
    NAME = 'probe'

    def __init__(self, table):
        super().__init__(GrainsSettings(), scene=Scene('probe', {}, table=table))
        self.blocks, self.results = self.publisher('blocks'), []
        self.asks = self.publisher('requests')
        self.subscribe('request_results', self.results.append)
        self.triggers, self.corpora, self.by_knock = [], [], []
        self.felt = self.publisher('felt_slips')
        self.subscribe('felt_triggers', self.by_knock.append)
        self.subscribe('grain_triggers', self.triggers.append)
        self.subscribe('corpus', self.corpora.append)


class Stage(Nodes):
    def __init__(self, settings, table=Table()):
        self.node, self.probe = (
            GrainsNode(settings, scene=Scene('grains', {}, table=table)),
            Probe(table),
        )
        super().__init__(self.node, self.probe)
        self.meet()
        self.until(lambda: self.probe.corpora)

    def until(self, condition, seconds=GENEROUS_S):
        self.turn()  # what was just asked for is on its way
        return super().until(condition, seconds)

    def put(self, **values):
        parameters = [Parameter(k, value=v) for k, v in values.items()]
        return self.node.set_parameters_atomically(parameters).successful


@pytest.fixture(scope='module')
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp('cache')


@pytest.fixture
def sounds(cache, tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_CACHE', str(cache))  # the same sounds are described once
    for name, seed in (('floe', 1), ('shelf', 2)):
        audio_file.write(tmp_path / f'{name}.wav', ice(6.0, 16000, seed), 16000, 'PCM_16')
    return tmp_path / 'floe.wav', tmp_path / 'shelf.wav'


@pytest.fixture
def stage(ros, sounds, table):
    with contextlib.ExitStack() as stages:

        def make(**settings):
            settings = GrainsSettings(sound=str(sounds[0]), radius=0.1, **settings)
            return stages.enter_context(Stage(settings, table))

        yield make


def image(k, table=Table()):
    """The blocks in image k: half a second of motion in every second."""
    blocks = np.zeros(table.cells, BLOCK)
    moved = 0.12 * (k // 60 + min(k % 60, 30) / 30)
    blocks['x'], blocks['y'] = (table.rest + [0.5 * np.sin(moved * 6), 0.1 * moved]).T
    blocks['sigma'], blocks['seen'] = 2e-5, table.present
    blocks['seen'][k % table.cells] &= k % 3 > 0
    return START_NS + k * 16_666_667, blocks


def play(stage, images, state=1):
    codec = Codec(definition(TYPE), cells=stage.node.table.cells)
    for k in images:
        stamp_ns, blocks = image(k, stage.node.table)
        ticks = stage.node.health.ticks
        stage.probe.blocks.publish(codec.pack(stamp_ns, state, False, k, blocks))
        stage.until(lambda ticks=ticks: stage.node.health.ticks > ticks)
        Nodes.until(stage, lambda: len(stage.probe.triggers) == stage.node.sequence)


def test_the_corpus_is_told_whole(stage, sounds):
    stage = stage()
    message, corpus = stage.probe.corpora[0], build_cached([sounds[0]], Options())
    assert message.files == [str(sounds[0])] and message.sample_rate == 16000
    assert message.digest == corpus.digest and message.name == 'floe.wav'
    assert list(message.start) == corpus.grains['start_s'].tolist()
    assert list(message.duration) == corpus.grains['duration_s'].tolist()
    np.testing.assert_allclose(message.x, corpus.grains['x'], rtol=1e-6)
    assert message.descriptors == list(DESCRIPTORS)
    values = np.reshape(message.values, (len(corpus), len(DESCRIPTORS)))
    np.testing.assert_allclose(values[:, 1], corpus.grains['periodicity_mean'], rtol=1e-6)
    assert (message.x_name, message.y_name) == DESCRIPTORS[:2]
    assert list(message.bounds) == [-0.5, -0.5, 0.5, 0.5]
    assert message.radius == pytest.approx(0.1)


@on_tables
def test_triggers_are_those_of_the_selector_with_the_stamp_of_the_image(stage, sounds, table):
    stage = stage()
    play(stage, range(150))
    selector = Selector(stage.node.settings, build_cached([sounds[0]], Options()), table)
    expected = []
    for k in range(150):
        stamp_ns, b = image(k, table)
        rows = selector.update(stamp_ns * 1e-9, b['x'], b['y'], b['seen'], b['sigma'])
        expected += [(stamp_ns, row) for row in rows]
    assert len(expected) > 20
    assert len(stage.probe.triggers) == len(expected)
    for n, (message, (stamp_ns, row)) in enumerate(
        zip(stage.probe.triggers, expected, strict=True)
    ):
        assert to_ns(message.header.stamp) == stamp_ns and message.sequence == n
        got = (message.grain, message.block, message.gain, message.rate, message.pan,
               message.attack, message.release)  # fmt: skip
        names = ('grain', 'block', 'gain', 'rate', 'pan', 'attack_s', 'release_s')
        assert got == tuple(row[name] for name in names)


def test_a_slip_that_was_felt_sounds_with_the_stamp_of_its_knock(stage, sounds):
    stage = stage()
    corpus, settings = build_cached([sounds[0]], Options()), stage.node.settings
    selector, expected = Selector(settings, corpus), []
    for n, kind in enumerate(
        (FeltSlip.KIND_PROVISIONAL, FeltSlip.KIND_CONFIRMED, FeltSlip.KIND_PROVISIONAL)
    ):
        stamp_ns, grain = START_NS + n * NS, corpus.grains[n]
        x, y = ((float(grain[axis]) - 0.5) * settings.space_m for axis in 'xy')
        message = FeltSlip(kind=kind, block=7 + n, x=x, y=y, strength=2.5)
        message.header.stamp = to_msg(stamp_ns)
        stage.probe.felt.publish(message)
        if kind == FeltSlip.KIND_PROVISIONAL:
            rows = selector.felt(stamp_ns * 1e-9, 7 + n, x, y, 2.5)
            expected += [(stamp_ns, int(r['grain']), int(r['block']), r['gain']) for r in rows]
            assert len(rows)
        stage.until(lambda: len(stage.probe.by_knock) == len(expected))  # noqa: B023

    got = [(to_ns(m.header.stamp), m.grain, m.block, m.gain) for m in stage.probe.by_knock]
    assert got == expected
    assert [m.sequence for m in stage.probe.by_knock] == list(range(len(got)))
    assert not stage.probe.triggers


def test_nothing_sounds_while_the_tracker_does_not_know_who_is_who(stage):
    stage = stage()
    play(stage, range(60), state=0)
    assert not stage.probe.triggers


def test_settings_change_while_it_runs(stage, sounds):
    stage = stage()
    assert stage.put(radius=0.001, gain=0.5)
    play(stage, range(30))
    assert len(stage.probe.corpora) == 1  # the reach is no part of it
    assert stage.node.health.values['radius'] == 0.001
    few = len(stage.probe.triggers)
    assert stage.put(radius=0.2)
    play(stage, range(30, 90))
    assert len(stage.probe.triggers) > few + 20
    assert max(t.gain for t in stage.probe.triggers) <= 0.5
    assert not any(stage.put(**bad) for bad in ({'radius': -1.0}, {'mode': 'loud'}, {'gain': NAN}))
    assert stage.node.settings.radius == 0.2


def test_another_sound_while_it_runs(stage, sounds):
    stage = stage()
    stage.put(sound=str(sounds[1]))
    stage.until(lambda: stage.probe.corpora[-1].name == 'shelf.wav')
    told = len(stage.probe.corpora)
    stage.put(sound=str(sounds[1].with_name('no.wav')))
    stage.until(lambda: stage.node.health.level == 1)
    assert 'no such sound file' in stage.node.health.text
    assert 'plays on' in stage.node.health.text
    play(stage, range(60))
    assert stage.probe.triggers and len(stage.probe.corpora) == told


def test_a_grain_dragged_on_the_panel_is_kept_beside_the_sound(stage, sounds):
    stage = stage()
    play(stage, range(3))
    for values in ({'grain': 7, 'x': 0.125, 'y': 0.875}, {'grain': 7000, 'x': 0.5, 'y': 0.5},
                   {'grain': 3}):  # fmt: skip
        asked = Asked('move_grain', 'grains', values)
        stage.probe.asks.publish(request_to_msg(asked, now_ns()))
    stage.until(lambda: len(stage.probe.corpora) > 1 and len(stage.probe.results) > 2)
    results = stage.probe.results
    assert [r.accepted for r in results] == [True, False, False]
    assert 'has grains 0 to' in results[1].reason and results[2].reason == 'x: missing'
    moved = stage.probe.corpora[-1]
    assert (moved.x[7], moved.y[7]) == (0.125, 0.875)
    assert moved.digest != stage.probe.corpora[0].digest
    # Its grains are named from a second after the last image on, so that they can be read in.
    assert to_ns(moved.header.stamp) == pytest.approx(image(2)[0] + 1_000_000_000, abs=1000)
    kept = corpus_file.load_moved(sounds[0])
    assert kept[:, 1:].tolist() == [[0.125, 0.875]]  # the other two were refused
    again = stage.__class__(stage.node.settings)  # and the next run has it from the start
    assert tuple(again.node.corpus.grains[['x', 'y']][7]) == (0.125, 0.875)
    again.close()
    assert to_json(moved)['moved'] == [7] and 'moved_by_hand' not in to_json(moved)['descriptors']
    back = Asked('restore_grain', 'grains', {'grain': 7})
    stage.probe.asks.publish(request_to_msg(back, now_ns()))
    stage.until(lambda: len(stage.probe.results) > 3)
    assert stage.probe.results[3].accepted
    stage.until(lambda: to_json(stage.probe.corpora[-1])['moved'] == [])
    first, last = stage.probe.corpora[0], stage.probe.corpora[-1]
    assert (last.x[7], last.y[7]) == (first.x[7], first.y[7])


def test_every_setting_is_live():
    for field in dataclasses.fields(GrainsSettings):
        assert field.metadata['live'], field.name


def test_a_folder_has_a_region_before_it_has_sounds(stage, sounds, tmp_path):
    stage, folder = stage(), tmp_path / 'voices'
    folder.mkdir()
    assert stage.put(more_sounds=[str(folder)], regions=['voices near', 'floe far'])
    assert stage.node.health.values['folders'] == ['voices']
    shutil.copy(sounds[1], folder / 'take-1.wav')
    stage.until(lambda: stage.probe.corpora[-1].name == 'floe.wav + 1')
    y, file = np.array(stage.probe.corpora[-1].y), np.array(stage.probe.corpora[-1].file)
    assert np.nanmax(y[file == 1]) < 0.5 < np.nanmin(y[file == 0])


def test_several_sounds_weighed_and_placed_while_it_runs(stage, sounds):
    stage = stage()
    assert stage.put(more_sounds=[str(sounds[1])], regions=['shelf left', 'floe right'])
    stage.until(lambda: stage.probe.corpora[-1].name == 'floe.wav + 1')
    message = stage.probe.corpora[-1]
    assert [name.rpartition('/')[2] for name in message.files] == ['floe.wav', 'shelf.wav']
    assert set(message.file) == {0, 1}
    x, file = np.array(stage.probe.corpora[-1].x), np.array(stage.probe.corpora[-1].file)
    assert x[file == 1].max() < 0.5 < x[file == 0].min()
    assert stage.put(weights=['floe 0']) and not stage.put(weights=['floe'])
    assert stage.node.settings.weights == ('floe 0',)
    assert 'weights' not in stage.node.health.text
    assert stage.put(weights=['floe 0', 'shelve 0.5'])
    told = "weights 'shelve 0.5': no sound of this name; there are floe, shelf"
    assert stage.node.health.text.endswith(f' of floe.wav + 1; {told}')
    assert stage.put(weights=['floe 0'])
    assert 'weights' not in stage.node.health.text
    play(stage, range(150))
    heard = {int(file[t.grain]) for t in stage.probe.triggers}
    assert heard == {1}
    assert stage.put(more_sounds=[], regions=[])
    stage.until(lambda: stage.probe.corpora[-1].name == 'floe.wav')
