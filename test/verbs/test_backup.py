# SPDX-License-Identifier: Apache-2.0
"""A backup holds what cannot be installed again and no secret; a restore writes all or none."""

import getpass
import gzip
import io
import json
import os
import sys
import tarfile
import threading
from pathlib import Path

import pytest

from eol_ros import cli, folders
from eol_ros.devices.files import sealed_file

PIN = 'kept-to-ourselves'
SCENE = f"""\
include: ../base.yaml
nodes:
  tracker: {{background: lamps.png}}
  grains: {{sound: sounds/ice.wav}}
  panel: {{host: 0.0.0.0, pin: {PIN}}}
  recorder: {{folder: bags}}
hours: []
"""


@pytest.fixture
def museum(tmp_path, monkeypatch, request):
    """Return the files of an installation, in its folder; keys are derived at low cost."""
    if request.function is not test_secrets_are_encrypted_and_for_the_owner_alone:
        monkeypatch.setitem(sealed_file.COST, 'n', 1 << 10)
    for name in ('state', 'cache', 'config'):
        monkeypatch.setenv(f'EOL_{name.upper()}', str(tmp_path / name))
    files = {
        'base.yaml': 'nodes: {twin: {}, motion: {}}\n',
        'museum/scene.yaml': SCENE.replace('hours: []\n', ''),
        'museum/lamps.png': 'lamps',
        'museum/sounds/ice.moved.csv': 'grain,x,y\n',
        'state/screens-museum.json': '{}',
        'state/presets/calm.yaml': 'sound: {}\n',
        'cache/audio/ice-2-1.moved.csv': 'grain,x,y\n7,0,0\n',
    }
    left = {
        'museum/sounds/ice.wav': 'much', 'museum/bags/monday/kept.txt': '', 'state/eol.log': 'long',
        'state/staff-museum.json': '["10.0.0.7"]', 'config/key': PIN,
        'state/machine-id': '1f0c',
    }  # fmt: skip
    for name, content in (files | left).items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    monkeypatch.chdir(tmp_path / 'museum')
    return files


def backup():
    assert cli.main(['backup', 'scene.yaml', '-o', 'out.tar.gz']) == 0
    return unpacked(Path('out.tar.gz').read_bytes())


def unpacked(data):
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        return {m.name: tar.extractfile(m).read().decode() for m in tar}


def test_a_lost_machine_comes_back(museum, tmp_path, capsys):
    found = backup()
    assert PIN not in json.dumps(found) and '10.0.0.7' not in json.dumps(found)
    manifest = json.loads(found.pop('manifest.json'))
    assert manifest['kept_bags'] == ['monday'] and len(found) == len(museum)
    Path('out.tar.gz').rename(tmp_path / 'out.tar.gz')
    for name in museum:
        (tmp_path / name).unlink()
    capsys.readouterr()
    assert cli.main(['restore', str(tmp_path / 'out.tar.gz')]) == 0
    said = capsys.readouterr()
    assert sorted(said.out.split()) == sorted(str(tmp_path / name) for name in museum)
    assert 'scene.yaml: enter the secrets' in said.err and 'monday' in said.err
    for name, content in museum.items():
        assert (tmp_path / name).read_text() == content.replace(PIN, "'***'")
    assert cli.main(['restore', str(tmp_path / 'out.tar.gz')]) == 0  # there is nothing to do
    assert not capsys.readouterr().out
    assert cli.main(['restore', str(tmp_path / 'out.tar.gz'), str(tmp_path / 'other')]) == 0
    assert (tmp_path / 'other/lamps.png').read_text() == 'lamps'


@pytest.fixture
def phrase(tmp_path):
    """Return the words that name a file with a password."""
    (tmp_path / 'phrase').write_text('correct horse\r\nbattery\n')
    return ['--password-file', str(tmp_path / 'phrase')]


def test_secrets_are_encrypted_and_for_the_owner_alone(museum, tmp_path, phrase, capsys):
    assert cli.main(['backup', 'scene.yaml', '--secrets', *phrase]) == 0
    [file] = Path().glob('eol-backup-*.sealed')
    data = file.read_bytes()
    assert file.stat().st_mode & 0o077 == 0
    found = unpacked(sealed_file.unseal(data, 'correct horse'))
    assert sealed_file.seal(b'x', 'y')[13:41] != sealed_file.seal(b'x', 'y')[13:41]  # salt, nonce
    assert PIN in found['scene/scene.yaml'] and found['config/key'] == PIN
    (tmp_path / 'config/key').unlink()
    assert cli.main(['restore', str(file), *phrase]) == 0
    assert (tmp_path / 'config/key').stat().st_mode & 0o077 == 0


@pytest.mark.parametrize('name', ['-', '/dev/stdin', 'fifo'])
def test_a_password_comes_through_a_pipe(museum, monkeypatch, name):
    os.mkfifo('fifo')
    for words in (['backup', 'scene.yaml', '-o', 'x', '--secrets'], ['restore', 'x', '--force']):
        fifo = os.open('fifo', os.O_RDWR | os.O_CLOEXEC)  # a writer before the reader, as of <( )
        reading, writing = os.pipe()
        os.write(fifo if name == 'fifo' else writing, b'\xef\xbb\xbfcorrect horse\n')
        os.close(writing)
        kept = os.dup(0)
        os.dup2(reading, 0)
        threading.Timer(1.0, os.close, [fifo]).start()
        try:
            assert cli.main([*words, '--password-file', name]) == 0
        finally:
            os.dup2(kept, 0)
            os.close(kept)
            os.close(reading)
    assert sealed_file.unseal(Path('x').read_bytes(), 'correct horse')


@pytest.mark.parametrize('change', ['password', 'salt', 'nonce', 'a bit', 'cut', 'head alone'])
def test_a_wrong_password_or_a_changed_bit_writes_nothing(museum, tmp_path, phrase, capsys, change):
    assert cli.main(['backup', 'scene.yaml', '-o', 'out.tar.gz', '--secrets', *phrase]) == 0
    data = bytearray(Path('out.tar.gz').read_bytes())
    at = {'salt': 15, 'nonce': 32, 'a bit': 500}.get(change)
    if at:
        data[at] ^= 1
    length = {'cut': -1, 'head alone': len(sealed_file.MAGIC)}.get(change, len(data))
    Path('out.tar.gz').write_bytes(data[:length])
    if change == 'password':
        (tmp_path / 'phrase').write_text('correct house')
    Path('lamps.png').unlink()
    capsys.readouterr()
    assert cli.main(['restore', 'out.tar.gz', *phrase]) == 78
    assert 'out.tar.gz: wrong password, or the file is damaged' in capsys.readouterr().err
    assert not Path('lamps.png').exists()


def test_a_password_is_typed_twice_and_long_enough(museum, tmp_path, phrase, monkeypatch, capsys):
    (tmp_path / 'phrase').write_text('short')
    words = ['backup', 'scene.yaml', '-o', 'out.tar.gz', '--secrets']
    monkeypatch.setattr(sys, 'stdin', io.StringIO())  # no terminal
    for more, said in ((phrase, 'at least 8 characters'), ([], 'name --password-file')):
        assert cli.main([*words, *more]) == 2
        assert said in capsys.readouterr().err
    typed = iter(['correct horse', 'correct house'])
    monkeypatch.setattr(sys.stdin, 'isatty', lambda: True)
    monkeypatch.setattr(getpass, 'getpass', lambda prompt: next(typed))
    assert cli.main(words) == 2
    assert 'passwords differ' in capsys.readouterr().err
    assert not Path('out.tar.gz').exists()


def test_what_is_there_stays_unless_it_is_forced(museum, tmp_path, capsys):
    backup()
    Path('lamps.png').write_text('newer')
    (tmp_path / 'base.yaml').unlink()
    capsys.readouterr()
    assert cli.main(['restore', 'out.tar.gz']) == 2
    said = capsys.readouterr().err
    assert 'lamps.png' in said and 'and 1 more' in said and '--force' in said  # the masked scene
    assert Path('lamps.png').read_text() == 'newer' and not (tmp_path / 'base.yaml').exists()
    assert cli.main(['restore', 'out.tar.gz', '--force']) == 0
    assert Path('lamps.png').read_text() == 'lamps' and (tmp_path / 'base.yaml').exists()


def holding(name):
    """Return a backup with one empty file of that name."""
    files = {name: 'e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855'}
    about = {'folder': '.', 'secrets': False, 'kept_bags': [], 'files': files}
    content, packed = json.dumps(about).encode(), io.BytesIO()
    with tarfile.open(fileobj=packed, mode='w:gz') as tar:
        member = tarfile.TarInfo('manifest.json')
        member.size = len(content)
        tar.addfile(member, io.BytesIO(content))
        tar.addfile(tarfile.TarInfo(name))
    return packed.getvalue()


def test_a_damaged_or_foreign_file_writes_nothing(museum, tmp_path, capsys):
    backup()
    whole = Path('out.tar.gz').read_bytes()
    raw = gzip.decompress(whole)
    assert raw.count(b'lamps') > 1
    wrong = gzip.compress(raw.replace(b'lamps\0', b'lumps\0'))
    Path('lamps.png').unlink()
    for content, words in (
        (whole[: len(whole) // 2], 'not a backup of eol, or damaged'),
        (b'', 'not a backup of eol, or damaged'),
        (wrong, 'scene/lamps.png is not what was backed up'),
        (holding('scene/../../x'), 'scene/../../x: no place of a backup'),
        (holding(''), '(no name): no place of a backup'),
    ):
        Path('bad.tar.gz').write_bytes(content)
        capsys.readouterr()
        assert cli.main(['restore', 'bad.tar.gz', '--force']) == 78
        err = capsys.readouterr().err
        assert words in err and err.count('\n') == 1
        assert not Path('lamps.png').exists()
    assert cli.main(['restore', 'none.tar.gz']) == 69
    assert folders.state_path().joinpath('presets/calm.yaml').exists()
