# SPDX-License-Identifier: Apache-2.0
"""Settings of the sound kept by name, recalled in a running graph and glided to."""

import unicodedata

import pytest

from eol_ros import scene as scenes
from eol_ros.cli import main
from eol_ros.streams.requests import KINDS, Word
from eol_ros.verbs import call

NO_NAMES = (
    '../etc', 'a/b', '.a', '_a', 'a b', 'a.b', 65 * 'a', 67 * '氷', 'a\n', '\udc84', '\u0301a'
)  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    (tmp_path / 'presets').mkdir()
    return tmp_path / 'presets'


def test_save_and_recall_are_requests_to_the_node_sound(folder, monkeypatch):
    asked = []
    monkeypatch.setattr(call, 'answer', lambda request, args: asked.append(request) or 0)
    assert main(['preset', 'save', 'calm']) == 0
    assert main(['preset', 'recall', 'storm', '--over', '30']) == 0
    found = [(one.kind, one.node, one.values) for one in asked]
    assert found == [
        ('save_preset', 'sound', {'preset': 'calm'}),
        ('recall_preset', 'sound', {'preset': 'storm', 'over_s': 30.0}),
    ]
    assert all(KINDS[one.kind].check(one.values) == one.values for one in asked)


def test_no_preset_is_said(folder, capsys):
    assert main(['preset', 'list']) == 0
    told = f'no presets in {folder}; `eol preset save NAME` keeps one\n'
    assert capsys.readouterr() == ('', told)


@pytest.mark.parametrize('name', ['Möwe', '冰山', 'हिम', '1-a_b', 'e' * 64, '氷' * 60])
def test_a_preset_has_a_name_of_any_letters(folder, capsys, name):
    for form in ('NFC', 'NFD'):  # NFD: as a Mac writes it
        file = folder / f'{unicodedata.normalize(form, name)}.yaml'
        file.write_text('nodes: {grains: {radius: 0.031}}\n')
        for typed in ('NFC', 'NFD'):
            given = unicodedata.normalize(typed, name)
            assert main(['preset', 'show', given]) == 0
            assert '0.031' in capsys.readouterr().out
            assert Word('name').check(given) == unicodedata.normalize('NFC', name)
        assert main(['preset', 'list']) == 0
        assert capsys.readouterr().out == f'{unicodedata.normalize("NFC", name)}\n'
        file.unlink()


def test_a_preset_can_be_part_of_a_scene(tmp_path):
    (tmp_path / 'calm.yaml').write_text('nodes: {grains: {radius: 0.031}}\n')
    (tmp_path / 's.yaml').write_text('scene: s\ninclude: calm.yaml\nnodes: {twin: , tracker: }\n')
    assert scenes.load(tmp_path / 's.yaml').settings('grains').radius == 0.031


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        (['recall'], 2, 'name the preset'),
        *((['recall', name], 2, 'name the preset') for name in NO_NAMES),
        (['recall', 'a', '--over', '-1'], 2, '-1 is outside 0 to 3600'),
        (['show', 'none'], 69, 'no such preset'),
        (['show', 'empty'], 78, 'not a preset'),
        (['show', 'text'], 78, 'not a preset'),
        (['show', 'other'], 78, 'not a preset'),
        (['show', 'dead'], 78, 'sound: channels is read when sound starts'),
        (['show', 'wide'], 78, 'grains: radius: 9 is out of range'),
    ],
)
def test_what_is_no_preset_is_one_line(folder, capfd, words, code, said):
    for name, text in {
        'empty': '', 'text': 'nodes', 'other': 'nodes: {motion: {rest_s: 1}}',
        'dead': 'nodes: {sound: {channels: 2}}', 'wide': 'nodes: {grains: {radius: 9}}',
    }.items():  # fmt: skip
        (folder / f'{name}.yaml').write_text(text)
    assert main(['preset', *words]) == code
    err = capfd.readouterr().err
    assert said in err and len(err.strip().splitlines()) == 1
