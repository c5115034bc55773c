# SPDX-License-Identifier: Apache-2.0
"""Presets as files: names of any letters, and what is no preset."""

import unicodedata

import pytest

from eol_ros import scene as scenes
from eol_ros.errors import EolError
from eol_ros.ros import presets
from eol_ros.streams.requests import Word

NO_NAMES = (
    '../etc', 'a/b', '.a', '_a', 'a b', 'a.b', 65 * 'a', 67 * '氷', 'a\n', '\udc84', '\u0301a', ''
)  # fmt: skip


@pytest.mark.parametrize('name', ['Möwe', '冰山', 'हिम', '1-a_b', 'e' * 64, '氷' * 60])
def test_a_preset_has_a_name_of_any_letters(tmp_path, name):
    for form in ('NFC', 'NFD'):  # NFD: as a Mac writes it
        file = tmp_path / f'{unicodedata.normalize(form, name)}.yaml'
        file.write_text('nodes: {grains: {radius: 0.031}}\n')
        for typed in ('NFC', 'NFD'):
            given = unicodedata.normalize(typed, name)
            found = presets.load(presets.path_of(given, tmp_path))
            assert found == {'grains': {'radius': 0.031}}
            assert Word('name').check(given) == unicodedata.normalize('NFC', name)
        assert presets.names(tmp_path) == [unicodedata.normalize('NFC', name)]
        file.unlink()


def test_a_preset_can_be_part_of_a_scene(tmp_path):
    (tmp_path / 'calm.yaml').write_text('nodes: {grains: {radius: 0.031}}\n')
    (tmp_path / 's.yaml').write_text('scene: s\ninclude: calm.yaml\nnodes: {twin: , tracker: }\n')
    assert scenes.load(tmp_path / 's.yaml').settings('grains').radius == 0.031


@pytest.mark.parametrize(
    ('name', 'text', 'code', 'said'),
    [
        *((name, '', 2, 'name the preset') for name in NO_NAMES),
        ('none', None, 69, 'no such preset'),
        ('empty', '', 78, 'not a preset'),
        ('text', 'nodes', 78, 'not a preset'),
        ('other', 'nodes: {motion: {rest_s: 1}}', 78, 'not a preset'),
        ('dead', 'nodes: {sound: {channels: 2}}', 78, 'sound: channels is read when sound starts'),
        ('wide', 'nodes: {grains: {radius: 9}}', 78, 'grains: radius: 9 is out of range'),
    ],
)
def test_what_is_no_preset_is_one_line(tmp_path, name, text, code, said):
    if code == 78:
        (tmp_path / f'{name}.yaml').write_text(text)
    with pytest.raises(EolError) as told:
        presets.load(presets.path_of(name, tmp_path))
    assert told.value.exit_code == code
    assert said in str(told.value) and '\n' not in str(told.value)
