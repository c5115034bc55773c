# SPDX-License-Identifier: Apache-2.0
"""What words of `eol call`, `eol param` and cues mean."""

import argparse
import socket

import pytest
from support.domains import next_domain

from eol_ros import cli
from eol_ros.bringup import status
from eol_ros.errors import DeviceMissing, UsageError
from eol_ros.ros import network
from eol_ros.ros.request_words import asked_of, value_of
from eol_ros.streams.requests import Asked
from eol_ros.streams.work_state import DOWN
from eol_ros.verbs import reach


@pytest.mark.parametrize(
    ('text', 'kind', 'value'),
    [
        ('off', str, 'off'),  # a filter; YAML has it for false
        ('', str, ''),  # no sound: the ice
        ('120', str, '120'),
        ("'low-pass'", str, 'low-pass'),
        ('off', bool, False),
        ('3', float, 3.0),
        ('3', int, 3),
        ('true', float, True),  # refused by the node, not made 1.0 here
        ('[a 0.5, b 0]', tuple, ['a 0.5', 'b 0']),
        ('a: b: c', str, 'a: b: c'),
    ],
)
def test_text_is_taken_as_it_stands(text, kind, value):
    found = value_of(text, kind)
    assert found == value and type(found) is type(value)


def test_the_types_are_those_of_the_settings_and_requests():
    values = asked_of(['set', 'sound', 'filter=off', 'gain_db=-3', 'filter_q=2']).values
    assert values == {'filter': 'off', 'gain_db': -3.0, 'filter_q': 2.0}
    assert type(values['gain_db']) is float
    assert asked_of(['save_preset', 'preset=on']).values == {'preset': 'on'}
    assert asked_of(['sleep', 'sound']) == Asked('sleep', 'sound')


@pytest.mark.parametrize(
    'text', ['[0,0 1,1]', '', '{a: 1}', '[1, 2.5]', '2026-01-01', '99999999999999999999']
)
def test_a_value_that_no_message_can_carry_is_refused_before_it_is_sent(text):
    with pytest.raises(UsageError, match='paths: .* is not a number, text or list of texts'):
        asked_of(['set', 'grains', f'paths={text}'])


@pytest.mark.parametrize(
    ('node', 'lan', 'words'),
    [
        ('sound', False, 'sound does not answer; it is down: exit code 69; again in 8 s'),
        ('camera', False, 'camera is not in the scene lights, which runs here'),
        ('', False, 'they do not run here'),  # more than one is meant
        ('sound', True, 'they do not run here'),  # on the network there may be another supervisor
    ],
)
def test_of_a_node_that_cannot_be_asked_the_supervisor_tells(monkeypatch, node, lan, words):
    down = {'node': 'sound', 'level': DOWN, 'text': 'exit code 69; again in 8 s'}
    found = {'scene': 'lights', 'nodes': [down]}
    monkeypatch.setattr(status, 'ask', lambda domain, namespace: found)
    args = argparse.Namespace(lan=lan, secure=False, namespace=None)
    with pytest.raises(DeviceMissing) as told, reach.asking(node, args):
        raise DeviceMissing('they do not run here')
    assert str(told.value) == words


def test_where_no_supervisor_runs_the_error_stays(monkeypatch):
    def none(domain, namespace):
        raise DeviceMissing('no graph runs')

    monkeypatch.setattr(status, 'ask', none)
    args = argparse.Namespace(lan=False, secure=False, namespace=None)
    with pytest.raises(DeviceMissing, match='^it does not run$'), reach.asking('sound', args):
        raise DeviceMissing('it does not run')


@pytest.mark.parametrize(
    'words',
    [
        'topics',
        'echo /no/such',
        'param list tracker',
        'call wake',
        'measure friction --stiffness 80',
    ],
)
def test_verbs_that_need_a_graph_say_at_once_that_there_is_none(
    words, monkeypatch, tmp_path, capsys
):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(next_domain()))
    monkeypatch.setattr(status, 'UNIT', tmp_path / 'eol.service')
    monkeypatch.setattr('eol_ros.ros.session.session', None)  # it does not go and look
    monkeypatch.setattr('eol_ros.ros.requests.visiting', None)
    assert cli.main(words.split()) == 69
    assert 'no graph runs on domain' in capsys.readouterr().err.splitlines()[-1]


def test_the_hint_is_the_start_that_this_machine_uses(monkeypatch, tmp_path):
    unit = tmp_path / 'eol.service'
    monkeypatch.setattr(status, 'UNIT', unit)
    assert status.how_to_start() == '`eol run` starts the rehearsal, `eol run SCENE` another scene'
    unit.write_text('[Service]\nExecStart=/opt/eol/bin/python -m eol_ros.bringup /etc/my.yaml\n')
    assert status.how_to_start() == '`sudo systemctl start eol` starts scene /etc/my.yaml'


def test_a_participant_is_known_by_a_port_of_its_domain(monkeypatch):
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE', raising=False)
    domain = int(next_domain())
    assert network.participants(domain) is False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(('127.0.0.1', 7400 + 250 * domain + 12))
        assert network.participants(domain) is True
        monkeypatch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', '/etc/shm-only.xml')
        assert network.participants(domain) is None
