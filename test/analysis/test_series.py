# SPDX-License-Identifier: Apache-2.0
"""The series of a bag that are asked whether they are 1/f: each against what was put into it."""

import functools
import json

import numpy as np
import pytest
from eol_msgs.msg import Block, Blocks, Cascade, GrainTrigger, LedCommand, Slip, Truth
from support.bag_samples import T0, bag_of

from eol_ros.analysis import bag as bag_module
from eol_ros.analysis import report, series, uncoupled
from eol_ros.core.physics.result import Limits
from eol_ros.lab import choose
from eol_ros.lab.science import spectra
from eol_ros.ros.stamps import to_msg
from eol_ros.settings import TwinSettings

S = 1_000_000_000


def trigger(at_s):
    message = GrainTrigger()
    message.header.stamp = to_msg(T0 + round(at_s * S))
    return 'grain_triggers', message, at_s


def test_triggers_light_and_kinetic_energy(tmp_path):
    messages = [trigger(t) for t in (0.0, 1.01, 1.02, 3.0, 10.0)]
    for at_s, level in ((0.0, 0), (1.025, 255), (2.0, 51), (4.0, 0)):
        white = np.zeros(25, np.uint8)
        white[:5] = level
        light = LedCommand(white=white, sent=to_msg(T0 + round(at_s * S)))
        messages.append(('led_commands', light, at_s))
    for k in range(601):  # 60/s; block 3 goes at 0.1 m/s from 2 to 3 s; at 5 s block 4 jumps
        at_s = k / 60
        blocks = [Block(id=i) for i in range(25)]
        blocks[3].x = 0.06 * float(np.clip(at_s - 2, 0, 1))
        blocks[3].y = 0.08 * float(np.clip(at_s - 2, 0, 1))
        blocks[4].x = 0.174 * (at_s > 5)
        message = Blocks(image=k, blocks=blocks)
        message.header.stamp = to_msg(T0 + round(at_s * S))
        messages.append(('blocks', message, at_s))
    bag = bag_of(tmp_path / 'run', messages)

    triggers, light, energy, power, loudness = series.of(bag)
    assert len(triggers.values) == len(light.values) == len(energy.values) == 200
    assert np.flatnonzero(triggers.values).tolist() == [0, 20, 60]
    assert (triggers.values[20], triggers.values.sum()) == (2, 4)  # the last begins after the end
    np.testing.assert_allclose(light.values[:20], 0)
    assert light.values[20] == pytest.approx(0.5 * 5 / 25, abs=0.021)  # lit for half of its 50 ms
    np.testing.assert_allclose(light.values[21:40], 5 / 25)
    np.testing.assert_allclose(light.values[40:80], 1 / 25)
    np.testing.assert_allclose(light.values[80:], 0)
    np.testing.assert_allclose(energy.values[41:59], 0.5 * 0.25 * 0.1**2, rtol=1e-6)
    np.testing.assert_allclose(energy.values[:39], 0, atol=1e-12)
    np.testing.assert_allclose(energy.values[61:], 0, atol=1e-12)  # a jump is no motion
    assert isinstance(power, series.Absent) and 'cannot be rendered' in power.why
    assert loudness.name == 'loudness'


def test_kinetic_energy_does_not_depend_on_how_the_bag_is_read(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    messages = []
    for k in range(300):
        blocks = [Block(id=i, x=float(rng.normal(0, 1e-3))) for i in range(25)]
        message = Blocks(image=k, blocks=blocks)
        message.header.stamp = to_msg(T0 + k * S // 60)
        messages.append(('blocks', message, k / 60))
    bag = bag_of(tmp_path / 'run', messages)
    whole = bag.gathered(series.KineticEnergy).series().values
    light = bag_of(tmp_path / 'light', messages, settings='nodes: {twin: {block_kg: 0.1}}')
    energy = light.gathered(series.KineticEnergy)
    np.testing.assert_allclose(energy.series().values, whole * 0.1 / 0.25)
    assert energy.series().rest == pytest.approx(series.REST_J * 0.1 / 0.25)
    assert energy.series(TwinSettings(block_kg=1.0)).rest == pytest.approx(4 * series.REST_J)
    bag.release()
    monkeypatch.setattr(bag_module, 'BATCH', 7)

    assert whole.max() > 0
    np.testing.assert_array_equal(bag.gathered(series.KineticEnergy).series().values, whole)


def twin_bag(folder, rim_of, seconds=300, table=''):
    """A bag of a twin whose rim goes where `rim_of` (s -> x, y, yaw) says."""
    messages = []
    for k in range(seconds * 20 + 1):
        truth = Truth()
        truth.header.stamp = to_msg(T0 + k * S // 20)
        truth.rim_x, truth.rim_y, truth.rim_yaw = rim_of(k / 20)
        messages.append(('truth', truth, k / 20))
    scene = 'nodes:\n  twin: {seed: 3}\n  leds: {decay_s: 0.5}\n  grains: {}\n' + table
    return bag_of(folder, messages, settings=scene)


def test_a_bag_of_a_twin_has_the_same_rim_without_coupling_as_a_control(tmp_path):
    """It slips only where the rim moves, and a series that is 1/f is held against it."""
    bag = twin_bag(tmp_path / 'run', lambda t: (0.05 * np.sin(0.4 * max(t - 100, 0)), 0.0, 0.0))
    control = uncoupled.of(bag)

    for name in series.NAMES:
        values = control.series(name)
        assert 5998 <= len(values) <= 6000
        assert np.ptp(values[:1990]) == 0 < np.ptp(values[2100:]), name
    noise = spectra.coloured_noise(1.0, 6000, np.random.default_rng(5))
    assert control.NAME in series.ask(series.Series('light', noise), control).controls
    control.series = lambda name: noise
    said = series.ask(series.Series('light', noise), control)
    assert said.answer == 'no' and control.NAME in said.sentence


def test_only_a_twin_with_the_path_of_its_rim_has_a_control(tmp_path):
    assert uncoupled.of(bag_of(tmp_path / 'real', [trigger(0.0), trigger(9.0)])) is None


def test_a_control_that_cannot_be_simulated_leaves_no_verdict(tmp_path, monkeypatch):
    bag = twin_bag(tmp_path / 'run', lambda t: (0.05 * np.sin(t), 0.0, 0.0), 20)
    monkeypatch.setattr(
        uncoupled.choose, 'simulate',
        functools.partial(choose.simulate, limits=Limits(events=9)),
    )  # fmt: skip
    noise = spectra.coloured_noise(1.0, 6000, np.random.default_rng(5))
    said = series.ask(series.Series('light', noise), uncoupled.of(bag))

    assert said.answer == 'undecided' and 'the uncoupled table stopped at' in said.sentence


def test_loudness_of_the_reference_tone():
    """BS.1770: 997 Hz at full scale in one channel is -3.01 LUFS; two channels add."""
    tone = np.sin(2 * np.pi * 997 * np.arange(48_000) / 48_000)
    sound = np.stack([tone, tone], axis=1).astype('f4')
    pieces = (sound[a : a + 1111] for a in range(0, len(sound), 1111))
    power = series.mean_squares(pieces, 48_000)

    assert len(power) == 20
    np.testing.assert_allclose(series.lufs(power[10:]), -3.01 + 3.01, atol=0.05)


def test_the_report_says_of_each_series_what_it_found_or_lacks(tmp_path):
    times = np.sort(np.random.default_rng(1).random(3000) * 600)
    bag = bag_of(tmp_path / 'run', [trigger(t) for t in (0.0, *times, 600.0)])
    found = report.numbers(bag, list(report.spectra(bag)))
    said = found['one_over_f']

    assert [v['answer'] for v in said.values()] == ['no'] + ['undecided'] * 4
    assert abs(said['triggers']['beta']) < 0.15
    assert 'it is ' in said['triggers']['sentence']
    assert 'no led_commands in this bag' in said['light']['sentence']
    assert said['triggers']['sentence'] in report.summary(found)


def test_a_bag_of_one_message_each_has_a_report(tmp_path):
    messages = [trigger(0.0), ('blocks', Blocks(blocks=[Block(id=i) for i in range(25)]), 0.0)]
    for topic, message in (('slips', Slip(kind=Slip.KIND_START)), ('cascades', Cascade(area=1)),
                           ('led_commands', LedCommand(white=[0] * 25))):  # fmt: skip
        messages.append((topic, message, 0.0))
    bag = bag_of(tmp_path / 'run', messages)
    found = report.write(bag, tmp_path / 'out')

    json.dumps(found, allow_nan=False)
    words = report.summary(found)
    assert words.count('undecided: the bag is of 0.0 s') == 1
    assert f'{", ".join(series.NAMES)}: 1/f is undecided: the bag' in words
    assert '1 cascade is too few for a power law of areas: 200 are needed' in words


SMALL = 'table: {rows: 3, columns: 4, absent: [5]}\n'


def test_light_is_the_mean_of_the_blocks_that_there_are(tmp_path):
    white = np.full(12, 255, np.uint8)
    white[5] = 0
    lit = [('led_commands', LedCommand(white=white, sent=to_msg(T0 + k * S)), k) for k in range(3)]
    assert series.light(bag_of(tmp_path / 'run', lit, settings=SMALL)).values[-1] == 1.0


@pytest.mark.slow
def test_the_control_is_of_the_table_of_its_bag(tmp_path):
    rim = twin_bag(tmp_path / 'run', lambda t: (0.05 * np.sin(t), 0.0, 0.0), 20, SMALL)
    control = uncoupled.of(rim)
    assert control._shape.count == 11
    assert control.series('triggers').sum() > 5 and control.series('light').max() > 0
