# SPDX-License-Identifier: Apache-2.0
"""Scenes and sweeps are read by one reader, which says each mistake with its place."""

import pytest

from eol_ros import cli

SCENE = 'nodes: {{camera: {{fps: {}}}}}\n'
SWEEP = 'model: plate\nvary: {{travel_m: [{}]}}\n'
WRONG = {  # a number as people write it: what is said of it
    '012': 'octal',
    '1:30': 'minutes',
    '2026-13-45': 'month must be in',
    '!foo 3': "tag '!foo'",
    '!!int x': 'invalid literal',
    '!!binary aGk=': 'binary data',
    '1' + 5000 * '0': 'Exceeds the limit',
}
TEXTS = {
    'deep': (b'a: ' + 5000 * b'[', 'without end'),
    'zeros': (bytes(200), 'not YAML'),
    'list as key': (b'? [a]\n: b\n', "key ['a'] is not a name"),
    'merge': (b'a: &a {b: 1}\nc: {<<: *a}\n', 'merge keys'),
    'no-break': ('nodes:\xa0{}\n'.encode(), 'U+00A0'),
    'cp1252': ('scene: Küche\n'.encode('cp1252'), 'UTF-8'),
    'UTF-16 cut': ('scene: x\n'.encode('utf-16')[:-1], 'UTF-8'),
    'twice': (b'a: 1\na: 2\n', 'a: stands twice'),
    'line break in a key': (b'"a\\nb": 1\n', r'error a\nb: '),
}


def said(verb, path, capsys):
    """Return what a verb prints of a file with mistakes."""
    assert cli.main([verb, str(path)]) == 78
    error = capsys.readouterr().err
    assert error.startswith(f'{path}:') and max(map(len, error.splitlines())) < 1200
    return error


@pytest.mark.parametrize('verb', ['check', 'sweep'])
@pytest.mark.parametrize('number', WRONG, ids=lambda text: text[:12])
def test_numbers_that_yaml_reads_otherwise(tmp_path, capsys, verb, number):
    path = tmp_path / 'x.yaml'
    path.write_text((SCENE if verb == 'check' else SWEEP).format(number))
    assert WRONG[number] in said(verb, path, capsys)


@pytest.mark.parametrize('verb', ['check', 'sweep'])
@pytest.mark.parametrize('kind', TEXTS)
def test_texts_that_are_no_mapping(tmp_path, capsys, verb, kind):
    path = tmp_path / 'x.yaml'
    path.write_bytes(TEXTS[kind][0])
    assert TEXTS[kind][1] in said(verb, path, capsys)
