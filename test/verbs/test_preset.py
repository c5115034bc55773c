# SPDX-License-Identifier: Apache-2.0
"""Settings of the sound kept by name, recalled in a running graph and glided to."""

import unicodedata

import pytest
import yaml
from support.spinning import spinning_in

from eol_ros import scene as scenes
from eol_ros.cli import main
from eol_ros.core.sound.ice import ice
from eol_ros.devices.audio import audio_file
from eol_ros.nodes.grains import GrainsNode
from eol_ros.settings import GrainsSettings
from eol_ros.streams.requests import Word

NO_NAMES = (
    '../etc', 'a/b', '.a', '_a', 'a b', 'a.b', 65 * 'a', 67 * '氷', 'a\n', '\udc84', '\u0301a'
)  # fmt: skip


@pytest.fixture
def grains(ros, tmp_path, monkeypatch):
    """The node grains and what is asked of it."""
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    audio_file.write(tmp_path / 'floe.wav', ice(2.0, 16000, 1), 16000, 'PCM_16')
    seen = []

    def make(context):
        node = GrainsNode(GrainsSettings(sound=str(tmp_path / 'floe.wav')), context=context)
        told = node.on_settings
        monkeypatch.setattr(node, 'on_settings', lambda new: (seen.append(new), told(new)))
        return node

    with spinning_in(make) as node:
        yield node, seen


@pytest.mark.slow
def test_a_preset_is_kept_recalled_and_glided_to(grains, tmp_path, capfd):
    node, seen = grains
    assert main(['preset', 'save', 'calm']) == 0
    path = tmp_path / 'state' / 'presets' / 'calm.yaml'
    assert capfd.readouterr().out == f'{path}\n'
    kept = yaml.safe_load(path.read_text())['nodes']
    assert set(kept) == {'grains'} and kept['grains']['radius'] == 0.045
    assert main(['preset', 'list']) == 0 and capfd.readouterr().out == 'calm\n'
    storm = tmp_path / 'storm.yaml'
    storm.write_text('nodes: {grains: {radius: 0.28, mode: chain, match: [flatness 1 x]}}\n')
    here = ['--folder', str(tmp_path)]
    assert main(['preset', 'recall', 'storm', *here]) == 0
    assert 'grains: 3 of' in capfd.readouterr().out
    assert (node.settings.radius, node.settings.mode) == (0.28, 'chain')
    assert node.settings.match == ('flatness 1 x',) and len(seen) == 1
    assert main(['preset', 'recall', 'calm', '--over', '0.8']) == 0
    reaches = [settings.radius for settings in seen[1:]]
    assert reaches == sorted(reaches, reverse=True) and reaches[-1] == 0.045
    assert len(set(reaches)) >= 3  # it glided
    assert node.settings == seen[-1] and node.settings.match == ()
    assert [s.mode for s in seen] == sorted(s.mode for s in seen)  # chain, then fence, once
    assert main(['preset', 'recall', 'calm']) == 0
    assert 'grains: 0 of' in capfd.readouterr().out


def test_no_preset_is_said(tmp_path, capsys):
    assert main(['preset', 'list', '--folder', str(tmp_path)]) == 0
    assert capsys.readouterr() == (
        '',
        f'no presets in {tmp_path}; `eol preset save NAME` keeps one\n',
    )


@pytest.mark.parametrize('name', ['Möwe', '冰山', 'हिम', '1-a_b', 'e' * 64, '氷' * 60])
def test_a_preset_has_a_name_of_any_letters(tmp_path, capsys, name):
    for form in ('NFC', 'NFD'):  # NFD: as a Mac writes it
        file = tmp_path / form / f'{unicodedata.normalize(form, name)}.yaml'
        file.parent.mkdir()
        file.write_text('nodes: {grains: {radius: 0.031}}\n')
        for typed in ('NFC', 'NFD'):
            given = unicodedata.normalize(typed, name)
            assert main(['preset', 'show', given, '--folder', str(file.parent)]) == 0
            assert '0.031' in capsys.readouterr().out
            assert Word('name').check(given) == unicodedata.normalize('NFC', name)
        assert main(['preset', 'list', '--folder', str(file.parent)]) == 0
        assert capsys.readouterr().out == f'{unicodedata.normalize("NFC", name)}\n'


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
        (['recall', 'none'], 69, 'no such preset'),
        (['recall', 'empty'], 78, 'not a preset'),
        (['recall', 'text'], 78, 'not a preset'),
        (['recall', 'other'], 78, 'not a preset'),
        (['recall', 'dead'], 78, 'sound: channels is read when sound starts'),
        (['recall', 'wide'], 78, 'grains: radius: 9 is out of range'),
    ],
)
def test_what_is_no_preset_is_one_line(tmp_path, capfd, words, code, said):
    for name, text in {
        'empty': '', 'text': 'nodes', 'other': 'nodes: {motion: {rest_s: 1}}',
        'dead': 'nodes: {sound: {channels: 2}}', 'wide': 'nodes: {grains: {radius: 9}}',
    }.items():  # fmt: skip
        (tmp_path / f'{name}.yaml').write_text(text)
    assert main(['preset', *words, '--folder', str(tmp_path)]) == code
    err = capfd.readouterr().err
    assert said in err and len(err.strip().splitlines()) == 1
