# SPDX-License-Identifier: Apache-2.0
"""Messages as text."""

import json
import types

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from eol_msgs.msg import Cascade, SoundMeter, Truth

from eol_ros.ros.echo import DISCOVERY_S, Absence, plain, to_json, to_yaml


def test_yaml_is_that_of_ros2_topic_echo():
    message = Cascade(cascade=3, nucleus=12, blocks=[12, 13], distance=0.5)
    message.header.stamp.sec, message.header.frame_id = 7, 'table'
    assert to_yaml(message) == (
        'header:\n  stamp:\n    sec: 7\n    nanosec: 0\n  frame_id: table\n'
        'cascade: 3\nonset:\n  sec: 0\n  nanosec: 0\nduration: 0.0\nnucleus: 12\narea: 0\n'
        'size: 0\nblocks:\n- 12\n- 13\ndistance: 0.5\n'
    )


def test_long_arrays_end_in_dots_unless_all_is_asked_for():
    message = SoundMeter(wave_min=np.linspace(-1, 0, 1024, dtype=np.float32))
    short = yaml.safe_load(to_yaml(message))['wave_min']
    assert len(short) == 129
    assert short[-1] == '...'
    assert yaml.safe_load(to_yaml(message, full=True))['wave_min'] == message.wave_min.tolist()


def test_arrays_bytes_and_nested_messages():
    truth = Truth()
    truth.moving = [block == 3 for block in range(25)]
    assert plain(truth)['moving'][:5] == [False, False, False, True, False]
    status = DiagnosticStatus(level=b'\2', values=[KeyValue(key='a', value='ü')])
    assert plain(status)['level'] == '\2'
    assert 'value: ü' in to_yaml(status)


def test_json_has_no_nan():
    line = to_json(Cascade(distance=float('nan'), duration=float('inf')))
    assert '\n' not in line
    data = json.loads(line)
    assert (data['distance'], data['duration']) == (None, None)


def test_a_topic_that_nothing_publishes_is_said_once_each_time():
    now, publishers = [100.0], {'/eol/slips': 0}
    context = types.SimpleNamespace(get_domain_id=lambda: 7)
    node = types.SimpleNamespace(count_publishers=publishers.get, context=context)
    absence = Absence(node, '/eol/slips', lambda: now[0])

    def told(seconds):
        lines = []
        for _ in range(round(10 * seconds)):
            now[0] += 0.1
            lines.append(absence.look())
        return [line for line in lines if line]

    assert told(DISCOVERY_S - 0.5) == []
    [line] = told(60.0)
    assert line.startswith('nothing publishes /eol/slips in domain 7 now; waiting')
    publishers['/eol/slips'] = 1
    assert told(60.0) == []
    publishers['/eol/slips'] = 0  # the graph has ended
    assert told(60.0) == [line]
