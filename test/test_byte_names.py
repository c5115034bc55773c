# SPDX-License-Identifier: Apache-2.0
"""Names of files are bytes: those of a Windows archive, of Macs, and with blanks."""

import io
import json
import os
import shutil
import sys
import unicodedata

import cv2
import numpy as np
import pytest

from eol_ros import cli
from eol_ros import scene as scenes
from eol_ros.devices.audio import audio_file
from eol_ros.devices.camera.image_sequence import open_source
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.devices.corpus.corpus_file import Options
from eol_ros.devices.files import names
from eol_ros.devices.files.media_folder import MediaFolder, Pictures
from eol_ros.errors import EolError
from eol_ros.verbs import service

ODD = os.fsdecode(b'eis\x84')  # `eisä` in code page 437


@pytest.fixture
def folder(tmp_path):
    image = np.random.default_rng(1).integers(0, 255, (400, 640)).astype(np.uint8)
    (tmp_path / ODD).mkdir()
    for k in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f'{k}.png'), image)
        os.rename(tmp_path / f'{k}.png', tmp_path / ODD / f'{k}.png')
    writer = cv2.VideoWriter(
        str(tmp_path / 'v.avi'), cv2.VideoWriter.fourcc(*'FFV1'), 60, (640, 400), False
    )
    for _ in range(3):
        writer.write(image)
    writer.release()
    os.rename(tmp_path / 'v.avi', tmp_path / f'{ODD}.avi')
    audio_file.write(tmp_path / f'{ODD}.wav', np.full(8000, 0.1, 'f4'), 8000)
    shutil.copytree('bags/sample', tmp_path / f'{ODD}-bag')
    (tmp_path / f'{ODD}.yaml').write_text('nodes: {grains: {}}\n')  # has mistakes
    return tmp_path


@pytest.mark.parametrize(
    ('words', 'code'),
    [
        (('track', f'{ODD}.avi'), 0),
        (('calibrate', 'blocks', f'{ODD}/1.png'), 78),
        (('corpus', f'{ODD}.wav'), 78),
        (('bag', 'cut', f'{ODD}-bag', '--end', '2', '--output', f'{ODD}.mcap'), 0),
        (('report', f'{ODD}-bag', '--output', f'{ODD}-report'), 0),
        (('bundle', f'{ODD}.yaml', '--output', f'{ODD}.zip'), 0),
        (('render', f'{ODD}-bag', '--seconds', '1', '--output', f'{ODD}.flac'), 0),
    ],
)
def test_a_name_that_is_no_text_ends_no_verb(folder, words, code, monkeypatch):
    """Where stdout takes UTF-8 alone, as that of a process does."""
    out = io.TextIOWrapper(io.BytesIO(), 'utf-8', 'strict')
    error = io.TextIOWrapper(io.BytesIO(), 'utf-8', 'backslashreplace')
    monkeypatch.setattr(sys, 'stdout', out)
    monkeypatch.setattr(sys, 'stderr', error)
    monkeypatch.chdir(folder)
    found = cli.main(list(words))
    error.flush()
    said = error.buffer.getvalue().decode()
    assert found == code, said
    assert 'Traceback' not in said
    if words[0] == 'report':  # of the sample that ships
        told = json.loads((folder / f'{ODD}-report' / 'report.json').read_text())
        assert told['slips']['count'] >= 200 and told['cascades']['count'] >= 20
        assert told['light']['flash']['flashes'] > 0
        assert 'too short' in told['one_over_f']['light']['sentence']


def test_a_sound_without_a_name_in_text_is_left_out(folder):
    audio_file.write(folder / 'good.wav', np.full(8000, 0.1, 'f4'), 8000)
    options = Options()
    sounds = corpus_file.all_sounds(str(folder), options)
    corpus = corpus_build.build(sounds, options)
    assert [source.name for source in corpus.sources] == ['good']
    assert 'its name is not UTF-8' in corpus.notes[0]


def test_images_of_a_list_are_found_whatever_system_wrote_it(tmp_path):
    image = cv2.imencode('.png', np.zeros((30, 40, 3), np.uint8))[1].tobytes()
    (tmp_path / 'Bilder').mkdir()
    for name in (b'eis\x84.png', b'Hafen.PNG', unicodedata.normalize('NFD', 'Möwe.png').encode()):
        (tmp_path / 'Bilder' / os.fsdecode(name)).write_bytes(image)
        (tmp_path / 'Bilder' / os.fsdecode(b'._' + name)).write_bytes(b'\0\5\x16\7')
    listed = 'bilder/eisä.png,Bilder/hafen.png\nBilder\\MÖWE.png,Bilder/Hafen.PNG\n'
    (tmp_path / 'Pairs.csv').write_text(listed)
    media = MediaFolder(tmp_path)
    assert (len(media.pairs), media.skipped) == (2, [])
    pictures = Pictures(str(tmp_path))
    assert all(pictures.file(name).is_file() for pair in media.pairs for name in pair.files)


def test_images_are_read_in_natural_order_and_without_hidden_ones(folder):
    (folder / ODD / '._1.png').write_bytes(b'\0\5\x16\7')
    assert [p.name for p in names.visible(folder / ODD)] == ['1.png', '2.png', '10.png']
    source = open_source(str(folder / ODD))
    assert (source.count, len(list(source.read())), source.notes) == (3, 3, [])


@pytest.mark.parametrize('folder_name', ['with blank', 'per%cent', 'quo"te', "it's", 'back\\slash'])
def test_units_quote_the_folders_that_they_open(tmp_path, monkeypatch, folder_name):
    bags = tmp_path / folder_name / 'bags'
    (tmp_path / 's.yaml').write_text(
        f"nodes:\n  recorder: {{folder: '{str(bags).replace(chr(39), chr(39) * 2)}'}}\n"
    )
    monkeypatch.setenv('EOL_STATE', str(tmp_path / folder_name / 'state'))
    found = service.units(scenes.load(tmp_path / 's.yaml'), 'museum', tmp_path, tmp_path)
    lines = found[service.WORK_PATH].splitlines()
    for key, path in (('ReadWritePaths', f'-{bags}'), ('Environment', f'EOL_STATE={bags.parent}')):
        line = '\n'.join(line for line in lines if line.startswith(f'{key}='))
        escaped = path.replace('\\', '\\\\').replace('"', '\\"').replace('%', '%%')
        assert escaped in line
        assert f'"{escaped}' in line or folder_name == 'per%cent'


def test_units_refuse_what_systemd_cannot_name(tmp_path):
    with pytest.raises(EolError, match='cannot name this path'):
        service._quoted(f'-{tmp_path}/two\nlines')
