# SPDX-License-Identifier: Apache-2.0
"""The budget of power: shares of time from the emulated block, mA from the circuit's file."""

import json

import pytest
import yaml
from support import needs
from support.emulated import built

from benchmarks import power
from eol_ros import cli
from eol_ros.devices.board.firmware import LOADS

pytestmark = [pytest.mark.firmware, needs.marker('gcc-avr', 'avr-libc', 'libsimavr-dev')]


@pytest.fixture(scope='module')
def shares():
    built()
    return power.measure(4.5, 40.0)


def test_the_processor_is_in_one_state_at_a_time(shares):
    for share in shares.values():
        assert share['active'] + share['idle'] + share['power_down'] == pytest.approx(1, abs=1e-3)
        assert share['listening'] + share['sending'] <= 1
        assert share['sensor_fast'] + share['sensor_slow'] <= 1.0001


def test_states_differ_in_what_the_firmware_switches_off(shares):
    rest, played, asleep, night = (shares[n] for n in ('at rest', 'played', 'asleep', 'night'))
    assert rest['listening'] > 0.99 and rest['sensor_fast'] == pytest.approx(1, abs=1e-3)
    assert rest['white'] == 0
    for share in (asleep, night):
        assert share['power_down'] > 0.99 and share['sensor_slow'] > 0.99
        assert 0 < share['listening'] < 0.01  # its looks for a word
    assert asleep['infrared'] == pytest.approx(1, abs=1e-3) and night['infrared'] == 0
    # three flashes in 4.5 s, each as long as full light for its time constant of 0.35 s
    assert played['white'] == pytest.approx(3 * 0.35 / 4.5, rel=0.1)
    assert played['sending'] > rest['sending']


def test_the_sum_is_right():
    currents = dict.fromkeys(LOADS, 0.0) | {'radio_rest': 0.5, 'always': 0.25}
    currents |= {'active': 4.0, 'idle': 1.0, 'infrared': 16.0}
    share = dict.fromkeys(LOADS, 0.0) | {'active': 0.25, 'idle': 0.75, 'infrared': 0.5}
    assert power.milliamps(share, currents) == pytest.approx(0.75 + 1.0 + 0.75 + 8.0)
    shares = {name: share for name in ('at rest', 'played', 'asleep', 'night')}
    told = power.budget(shares, currents, 1000.0, 10.0, 0.5)
    assert told['mAh_a_day'] == pytest.approx(24 * 10.5)
    assert told['hours']['played'] == pytest.approx(800 / 10.5)


def test_each_part_has_a_current_with_its_source():
    currents = yaml.safe_load(power.CIRCUIT.read_text())['currents']
    assert currents.keys() == {*LOADS, 'radio_rest', 'always'}
    assert all(entry['mA'] > 0 and entry['source'] for entry in currents.values())


def test_the_command_tells_hours(capsys, monkeypatch, shares):
    monkeypatch.setattr(power, 'measure', lambda seconds, slips: shares)
    monkeypatch.setattr(power, 'needed', built)
    assert cli.main(['bench', 'power', '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['hours']['night'] > 1000 > told['hours']['asleep'] > told['hours']['played'] > 24
    assert cli.main(['bench', 'power', '--slips', '0']) == 2
    assert '--slips 0' in capsys.readouterr().err
