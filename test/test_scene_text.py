# SPDX-License-Identifier: Apache-2.0
"""Settings are changed in scene files, and nothing else is."""

import pytest
import yaml

from eol_ros import scene, scene_text
from eol_ros.errors import ConfigError

VALUES = {'stiffness': 81.25, 'stiffness_error': 0.00005}
REST = """
  tracker: {}    # of the table in the hall
  panel:
    port: 8081   # not the usual one
"""
TWINS = {
    'flow': '  twin: {hands: nobody}  # mine',
    'empty flow': '  twin: {}  # mine',
    'block': '  twin:  # mine\n    # who?\n    hands: nobody  # not you\n',
    'nothing': '  twin:  # mine',
    'there before': '  twin: {stiffness: 12, hands: nobody, stiffness_error: 3.5}  # mine',
    'there before, block': '  twin:\n    stiffness: 12  # mine\n    hands: nobody',
    'flow on lines': '  twin: {\n    hands: nobody,  # mine\n    seed: 3,\n  }',
}


@pytest.mark.parametrize('twin', TWINS.values(), ids=TWINS)
@pytest.mark.parametrize('newline', ['\n', '\r\n'])
def test_only_what_is_asked_for_changes(tmp_path, twin, newline):
    text = f'# my table\nscene: mine\nnodes:\n{twin}{REST}'.replace('\n', newline)
    path = tmp_path / 'mine.yaml'
    path.write_text(text, newline='')
    path.chmod(0o640)
    before = scene.load(path)
    wanted = scene.plain(before)
    wanted['nodes']['twin'] |= VALUES

    scene_text.write(path, 'twin', VALUES)

    with path.open(newline='') as file:
        after = file.read()
    assert scene.plain(scene.load(path)) == wanted
    comments = [line.partition('#')[2] for line in text.splitlines() if '#' in line]
    assert [line.partition('#')[2] for line in after.splitlines() if '#' in line] == comments
    assert yaml.safe_load(after)['nodes']['panel'] == {'port': 8081}
    assert after.endswith(REST.replace('\n', newline)) and after.startswith(f'# my table{newline}')
    assert after.count('\n') == after.count(newline)
    assert path.stat().st_mode & 0o777 == 0o640 and [p.name for p in tmp_path.iterdir()] == [
        path.name
    ]

    scene_text.write(path, 'twin', VALUES)

    with path.open(newline='') as file:
        assert file.read() == after


def test_what_an_included_file_says_is_said_anew_in_this_one(tmp_path):
    (tmp_path / 'table.yaml').write_text('nodes:\n  twin: {seed: 4}\n  tracker: {}\n')
    path = tmp_path / 'mine.yaml'
    for text in ('include: table.yaml\n', 'include: table.yaml\nnodes:\n  panel: {}  # seen\n'):
        path.write_text(text)
        scene_text.write(path, 'twin', VALUES)
        assert scene.load(path).nodes['twin'].seed == 4
        assert scene.load(path).nodes['twin'].stiffness == 81.25
        assert path.read_text().startswith('include: table.yaml\nnodes:\n  twin: {stiffness: 81.25')
    assert (tmp_path / 'table.yaml').read_text() == 'nodes:\n  twin: {seed: 4}\n  tracker: {}\n'


def test_a_value_that_others_share_is_not_changed_for_them(tmp_path):
    text = 'nodes:\n  tracker: &both {mirror: true}\n  twin: *both\n'
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match='stiffness: 81.25'):
        scene_text.write(path, 'twin', VALUES)
    assert path.read_text() == text and len(list(tmp_path.iterdir())) == 1


def test_refusals(tmp_path):
    with pytest.raises(ConfigError, match='copy it'):
        scene_text.write(scene.find('rehearsal'), 'twin', VALUES)
    path = tmp_path / 'lights.yaml'
    path.write_text('nodes:\n  camera: {}\n  tracker: {}\n')
    with pytest.raises(ConfigError, match='has no twin'):
        scene_text.write(path, 'twin', VALUES)
    with pytest.raises(ConfigError, match='no such file'):
        scene_text.write(tmp_path / 'none.yaml', 'twin', VALUES)
    path.write_text('nodes:\n  twin: {}\n')
    with pytest.raises(ConfigError, match='out of range'):
        scene_text.write(path, 'twin', {'stiffness': 1e9})
    assert path.read_text() == 'nodes:\n  twin: {}\n'
