# SPDX-License-Identifier: Apache-2.0
"""Inputs that no verb expects: each ends in one line, in bounded time and memory.

The tables are generated: every option that takes a number meets hostile numbers, and every place
of a file meets hostile files.
"""

import argparse
import contextlib
import gzip
import importlib
import io
import os
import re
import resource
import shutil
import signal
import struct
import threading
from pathlib import Path
from zlib import compress, crc32

import numpy as np
import pytest
import soundfile
from support.bag_samples import write_bag

from assets.covers import __main__ as covers
from eol_ros import cli
from eol_ros.devices.audio import audio_file
from eol_ros.errors import ConfigError
from eol_ros.verbs import check, progress

SAMPLE = Path(__file__).parents[1] / 'bags/sample'
SPARE = 300 << 20  # bytes of memory beside twice the input
LONGEST_S = 60  # of a command: it tells what hangs, on the busiest machine

NUMBERS = ['nan', 'inf', '-1e300', '', '0x10', '9' * 400]


def options():
    """Yield (words before it, option, count of values) for each option that takes a number."""
    for verb in cli.VERBS:
        parser = cli.Parser(prog=verb)
        importlib.import_module(f'eol_ros.verbs.{verb}').add_arguments(parser)
        yield from _options([verb], parser)


def _options(words, parser):
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                yield from _options([*words, name], sub)
        elif action.type and action.option_strings:
            yield words, action.option_strings[-1], action.nargs or 1


OPTIONS = [(w, o, n if isinstance(n, int) else 1) for w, o, n in options()]


@pytest.mark.parametrize(
    ('words', 'option', 'count'), OPTIONS, ids=[' '.join([*w, o]) for w, o, _ in OPTIONS]
)
def test_every_number_of_a_command_line_has_a_range(words, option, count, capsys):
    for number in NUMBERS:
        assert cli.main([*words, f'{option}={number}', *[number] * (count - 1)]) == 2, number
        error = capsys.readouterr().err
        assert error.count('\n') == 1 and option in error and len(error) < 2500


def packed(write):
    """Return what `write` puts into a file."""
    file = io.BytesIO()
    write(file)
    return file.getvalue()


def sound(rate=8000, samples=None, subtype='FLOAT'):
    """Return a WAV."""
    samples = 0.3 * np.sin(0.3 * np.arange(8000)) if samples is None else samples
    return packed(lambda f: soundfile.write(f, samples, rate, subtype, format='WAV'))


def png(width, height, rows=b''):
    """Return a grey PNG whose header says a size, whatever `rows` hold."""

    def part(name, body):
        return struct.pack('>I', len(body)) + name + body + struct.pack('>I', crc32(name + body))

    head = part(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0))
    return b'\x89PNG\r\n\x1a\n' + head + part(b'IDAT', compress(rows)) + part(b'IEND', b'')


def npy(shape, dtype='|u1', data=b''):
    """Return a .npy file whose header says a shape, whatever `data` holds."""
    head = repr({'descr': dtype, 'fortran_order': False, 'shape': shape}).ljust(117) + '\n'
    return b'\x93NUMPY\x01\0' + struct.pack('<H', len(head)) + head.encode() + data


# nine to the power of eleven values, at each place where a value is looked at
ANCHORS = 'a0: &a0 [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'a{k}: &a{k} [{", ".join(9 * [f"*a{k - 1}"])}]\n' for k in range(1, 12)
)
ANCHORS += (
    'nodes: {grains: {radius: *a11}, twin: *a11}\nimage_width: *a11\ncamera_matrix: *a11\n'
    'model: *a11\nvary: {alpha: *a11}\n'
)
FILES = {
    'sound.wav': sound(),
    'triggers.csv': b'time_s,grain\n0.1,0\n0.2,1\n',
    'points.csv': b'10,10,-0.7,0.7\n1200,10,0.7,0.7\n1200,700,0.7,-0.7\n10,700,-0.7,-0.7\n',
    'labels.txt': b'0.1\t0.4\tcrack\n0.5\t0.9\tgroan\n',
    'scene.yaml': b'nodes: {twin: {}, tracker: {}, motion: {}}\n',
    'sweep.yaml': b'model: ofc\nfixed: {events: 100}\nvary: {alpha: [0.1, 0.2]}\n',
    'stack.npy': npy((2, 400, 640), data=bytes(2 * 400 * 640)),
    'stamps.txt': b'0.0\n0.1\n',
    'image.png': png(64, 40, bytes(65 * 40)),
    'laptop.conf': b'[Interface]\n',
}
MADE = [
    'simulate S1 --write-scene G/physics.json',
    'corpus G/sound.wav -o G/corpus.json',
    'calibrate points G/points.csv --size 1280x800 -o G/table.yaml',
    'backup G/scene.yaml -o G/backup.tar.gz',
]
# Each place of a file: the good file of that kind, and the command. X is the hostile file.
PLACES = {
    'check': ('scene.yaml', 'check X'),
    'run': ('scene.yaml', 'run X --for 0.1'),
    'backup': ('scene.yaml', 'backup X -o out.tar.gz'),
    'restore': ('backup.tar.gz', 'restore X there --force'),
    'notify': ('scene.yaml', 'notify X'),
    'service': ('scene.yaml', 'service install X -o out'),
    'camera scene': ('scene.yaml', 'camera focus --scene X --device none'),
    'camera film': ('stack.npy', 'camera focus --device X --seconds 0.1'),
    'keys': ('laptop.conf', 'keys join X'),
    'bag info': ('bag.mcap', 'bag info X'),
    'bag index': ('bag.mcap', 'bag info X --index'),
    'bag verify': ('bag.mcap', 'bag verify X'),
    'bag recover': ('bag.mcap', 'bag recover X -o out.mcap'),
    'bag repair': ('bag.mcap', 'bag recover X'),
    'bag cut': ('bag.mcap', 'bag cut X --end 0.2 -o out.mcap'),
    'bag keep': ('bag.mcap', 'bag keep X'),
    'report': ('bag.mcap', 'report X --csv point -o out'),
    'report all': ('bag.mcap', 'report --all X G/bag.mcap -o out'),
    'report measured': ('scene.yaml', 'report SAMPLE --measured X -o out'),
    'render bag': ('bag.mcap', 'render X -o out.wav'),
    'render list': ('triggers.csv', 'render X --corpus G/corpus.json -o out.wav'),
    'render corpus': ('corpus.json', 'render G/triggers.csv --corpus X -o out.wav'),
    'render scene': ('scene.yaml', 'render G/triggers.csv --scene X -o out.wav'),
    'points': ('points.csv', 'calibrate points X --size 1280x800'),
    'lens': ('table.yaml', 'calibrate points G/points.csv --lens X'),
    'cover': ('covers/cover-03.stl', 'calibrate points G/points.csv --size 1280x800 --covers C'),
    'blocks': ('image.png', 'calibrate blocks X'),
    'board': ('image.png', 'calibrate board X'),
    'calibrate scene': ('scene.yaml', 'calibrate points G/points.csv --size 1280x800 --scene X'),
    'measure bag': ('bag.mcap', 'measure friction --stiffness 80 --mass 250 --bag X'),
    'measure scene': ('scene.yaml', 'measure friction X --bag SAMPLE'),
    'corpus': ('sound.wav', 'corpus X'),
    'labels': ('labels.txt', 'corpus G/sound.wav --segment labels --labels X'),
    'corpus move': ('corpus.json', 'corpus move X 1 0.5 0.5'),
    'track': ('stack.npy', 'track X'),
    'stamps': ('stamps.txt', 'track G/stack.npy --stamps X'),
    'calibration': ('table.yaml', 'track G/stack.npy --calibration X'),
    'track scene': ('scene.yaml', 'track G/stack.npy --scene X'),
    'simulate': ('physics.json', 'simulate X'),
    'sweep': ('sweep.yaml', 'sweep X --workers 1'),
}
CONTENTS = {
    'empty': lambda good: b'',
    'half': lambda good: good[: len(good) // 2],
    'zeros': lambda good: bytes(len(good)),
    'half zeros': lambda good: good[: len(good) // 2] + bytes(len(good) - len(good) // 2),
    'binary': lambda good: np.random.default_rng(2).bytes(5000),
    'page': lambda good: b'<!DOCTYPE html>\n<html><body>404 Not Found</body></html>\n',
    'JSON': lambda good: b'{"version": 1, "grains": NaN, "data": {"0": [1e400]}}',
    'nested': lambda good: 1200 * b'[',
    'anchors': lambda good: ANCHORS.encode(),
    'UTF-16': lambda good: 'nodes: {}\n'.encode('utf-16'),
    'long line': lambda good: 300_000 * b'x',
    'sound': lambda good: sound(),
    'image': lambda good: png(64, 40, bytes(65 * 40)),
    'great image': lambda good: png(60000, 60000),
    'great array': lambda good: npy((10**6, 800, 1280)),
    'objects': lambda good: npy((1,), '|O', b'cos\nsystem\n'),
    'gone': None,
    'folder': None,
    'huge': None,  # the good one, and a gigabyte of zeros behind it
    'pipe': None,
}

CUT = 'half', 'half zeros', 'huge'
OTHERS = {  # codes of files that are good enough: bags and sounds are read as far as they go
    (place, kind): codes
    for place, kinds, codes in (
        ('bag info', CUT, (0,)),
        ('bag index', ('half',), (0,)),
        ('bag verify', ('half',), (1,)),
        ('bag recover', CUT, (0,)),
        ('bag repair', ('half',), (0, 1)),
        ('bag cut', ('half',), (0,)),
        ('bag keep', ('half',), (2,)),
        ('report', ('half',), (0,)),
        ('corpus', (*CUT, 'sound'), (0,)),
        ('labels', ('half',), (0,)),
        ('track', ('half zeros', 'huge'), (0,)),
    )
    for kind in kinds
}


@pytest.fixture(scope='module')
def good(tmp_path_factory):
    """Return a folder with a good file of each kind."""
    root = tmp_path_factory.mktemp('good')
    for name, data in FILES.items():
        (root / name).write_bytes(data)
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv('EOL_STATE', str(root / 'state'))
        for line in MADE:
            assert cli.main(line.replace('G/', f'{root}/').split()) == 0, line
    assert cli.run_verb(covers, 'assets.covers', ['-o', f'{root}/covers', '--cells', '1']) == 0
    write_bag(root / 'bag', count=50).close()
    shutil.copy(next((root / 'bag').glob('*.mcap')), root / 'bag.mcap')
    return root


@pytest.fixture
def bounded():
    """Return a function that bounds the memory of what follows to so many bytes more than now."""
    before = resource.getrlimit(resource.RLIMIT_DATA)

    def bound(most):
        now = int(re.search(r'VmData:\s*(\d+)', Path('/proc/self/status').read_text())[1])
        resource.setrlimit(resource.RLIMIT_DATA, (1024 * now + most, before[1]))

    signal.signal(signal.SIGALRM, lambda *_: pytest.fail(f'no end after {LONGEST_S} s'))
    signal.alarm(LONGEST_S)
    yield bound
    signal.alarm(0)
    resource.setrlimit(resource.RLIMIT_DATA, before)


def put(path, kind, data):
    """Write the hostile file of a kind to a path."""
    if path.exists():
        path.unlink()
    if kind == 'folder':
        path.mkdir()
    elif kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'huge':
        path.write_bytes(data)
        os.truncate(path, 1 << (29 if path.suffix == '.wav' else 30))  # sounds are read to the end
    elif CONTENTS[kind]:
        path.write_bytes(CONTENTS[kind](data))


ABSENT = re.compile('no such (file|scene|sound|label|corpus|preset|bag)')
PROGRESS = r' \d+ %$| \.\.\.$|^x.mcap has no end: '


def said(error):
    """Return the lines of stderr without progress and notes of bags."""
    return [s for s in error.splitlines() if not re.search(PROGRESS, s)]


# All commands read scenes by one function, bags by another and corpora by a third: these meet what
# is left out of FEW.
READERS = {
    'scene.yaml': ('check',),
    'bag.mcap': ('bag info', 'bag recover'),
    'corpus.json': ('corpus move',),
}
FEW = 'empty', 'half', 'gone', 'folder'


@pytest.mark.parametrize(
    ('place', 'kind'),
    [
        (p, k)
        for p, (name, _) in PLACES.items()
        for k in CONTENTS
        if (p, k) != ('blocks', 'image')  # that is no harm
        and (p in READERS.get(name, PLACES) or k in FEW)
    ],
)
def test_a_hostile_file_ends_in_one_line(good, bounded, tmp_path, monkeypatch, capfd, place, kind):
    name, line = PLACES[place]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('EOL_CONFIG', str(tmp_path / 'config'))
    path = tmp_path / f'x{Path(name).suffix}'
    if place == 'cover':
        shutil.copytree(good / 'covers', 'covers')
        path = tmp_path / name
    put(path, kind, (good / name).read_bytes())
    words = [{'X': str(path), 'SAMPLE': str(SAMPLE), 'C': 'covers'}.get(w, w) for w in line.split()]
    bounded(SPARE + (2 * path.stat().st_size if path.is_file() and kind != 'huge' else 0))
    code = cli.main([word.replace('G/', f'{good}/') for word in words])
    error = said(capfd.readouterr().err)
    assert code in OTHERS.get((place, kind), (69, 78)), (code, error)
    if code in (69, 78) and not error[-1].endswith(('was started.', 'was computed.')):
        assert len(error) == 1 and error[0].startswith('eol '), error
        assert kind in ('gone', 'folder') or not ABSENT.search(error[0]), error


ONCE = {  # places that are read once, from front to back
    'check', 'restore', 'notify', 'camera scene', 'keys',
    'render list', 'render scene', 'points', 'lens', 'calibrate scene',
    'stamps', 'calibration', 'track scene', 'simulate',
    'sweep',
}  # fmt: skip


@pytest.mark.parametrize(
    'place', [p for p in PLACES if p not in ('run', 'cover', 'report measured')]
)
def test_a_pipe_is_read_as_its_file_or_refused(good, tmp_path, monkeypatch, capfd, place):
    name, line = PLACES[place]
    monkeypatch.setenv('EOL_CONFIG', str(tmp_path / 'config'))
    monkeypatch.chdir(tmp_path)
    reading, writing = os.pipe()

    def write():
        with contextlib.suppress(BrokenPipeError), open(writing, 'wb') as file:
            file.write((good / name).read_bytes())

    def code(path):
        words = [{'X': path, 'SAMPLE': str(SAMPLE)}.get(w, w) for w in line.split()]
        capfd.readouterr()
        return cli.main([w.replace('G/', f'{good}/') for w in words])

    threading.Thread(target=write).start()
    found = code(f'/dev/fd/{reading}')
    error = said(capfd.readouterr().err)
    os.close(reading)
    if place in ONCE:
        shutil.rmtree(tmp_path / 'out', ignore_errors=True)
        assert found == code(str(good / name)), error
    else:
        assert found == 78 and len(error) == 1 and 'a pipe or device; write it to' in error[0]
        assert code('-') in (69, 78) and len(said(capfd.readouterr().err)) == 1


CROSSED = b'10,10,-0.7,0.7\n1200,10,0.7,-0.7\n1200,700,0.7,0.7\n10,700,-0.7,-0.7\n'
# A name, its content, a command with it, its exit code, and what is said.
VALUES = [
    ('x.wav', sound(1), 'corpus X', 78, '1 samples a second; sounds have 1000'),
    ('x.wav', sound(8000, np.full(8000, 3e38)), 'corpus X', 78, 'beyond 16 times full scale'),
    ('x.wav', sound(8000, np.full(8000, np.nan)), 'corpus X', 78, 'beyond 16 times full scale'),
    ('x.tar.gz', gzip.compress(bytes(110_000_000), 1), 'restore X there', 78, 'than 100 MB in it'),
    ('x.csv', b'time_s,grain\n', 'render X --corpus G/corpus.json -o o.wav', 78, 'no triggers'),
    ('x.csv', b'time_s,grain\n1.7e9,0\n', 'render X --corpus C -o o.wav', 78, 'an epoch time?'),
    ('x.csv', b'time_s,grain\n1,1e30\n', 'render X --corpus C -o o.wav', 78, 'must lie in'),
    ('x.txt', b'1e400\n2\n', 'track G/stack.npy --stamps X', 78, 'is not a time'),
    ('x.txt', b'-1e300\n2.0\n', 'track G/stack.npy --stamps X', 78, 'is not a time'),
    ('x.txt', b'1' + 5000 * b'0', 'track G/stack.npy --stamps X', 78, 'is not a time'),
    ('x.txt', b'1.7e9\t1.8e9\tx\n', 'corpus G/sound.wav --segment labels --labels X', 78, 'lie in'),
    ('x.txt', b'nan\tnan\tx\n', 'corpus G/sound.wav --segment labels --labels X', 78, 'a number'),
    ('x.csv', CROSSED, 'calibrate points X --size 1280x800', 78, 'so: check their order'),
    ('x.txt', b'4800\t9600\tx', 'corpus G/sound.wav --segment labels --labels X', 78, 'seconds'),
    ('x.npy', npy((0, 400, 640)), 'track X', 78, 'no image in it'),
    ('x.json', b'{"n": 1000000000}', 'simulate X', 78, 'lacks the key'),
    ('', b'', 'lattice --fit 5:2', 2, 'two rising sizes'),
    ('', b'', 'lattice --fit 0:0', 2, 'two rising sizes'),
    ('', b'', f'lattice --fit 1:{10**30}', 2, 'two rising sizes'),
    ('', b'', 'lattice --alpha nan', 2, 'nan is outside 0 to 0.25'),
    ('', b'', f'lattice --alpha 1/{"9" * 5000}', 2, 'is not a number'),
    ('', b'', 'measure springs --weights nan,inf --bag G/bag.mcap', 2, 'nan g is not'),
    ('', b'', 'calibrate points G/points.csv --size 0x0', 2, 'two numbers like'),
    ('', b'', f'calibrate points G/points.csv --size {"9" * 5000}x9', 2, 'two numbers like'),
    ('', b'', 'calibrate print b.png --board 9999x9999', 78, 'DICT_4X4_100 has 100'),
    ('', b'', 'camera focus --device none --size 99999999999x9', 2, 'is out of range'),
    ('', b'', 'corpus move G/corpus.json 1 nan inf', 78, 'must lie in 0..1'),
    ('', b'', f'corpus move G/corpus.json {10**22} 0.5 0.5', 78, 'the corpus has grains 0 to 3'),
    ('', b'', 'bag cut G/bag.mcap --topics , -o o.mcap', 2, 'names no topic'),
    ('', b'', 'simulate S1 --sample 1e-9', 2, 'too many samples'),
]


@pytest.mark.parametrize(
    ('name', 'data', 'line', 'code', 'words'), VALUES, ids=[v[2][:50] for v in VALUES]
)
def test_numbers_that_cannot_be_meant_are_refused(
    good, bounded, tmp_path, monkeypatch, capfd, name, data, line, code, words
):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / (name or 'x')
    path.write_bytes(data)
    given = {'X': str(path), 'C': str(good / 'corpus.json')}
    bounded(SPARE + 2 * len(data))
    assert cli.main([given.get(w, w.replace('G/', f'{good}/')) for w in line.split()]) == code
    (error,) = said(capfd.readouterr().err)
    assert words in error and len(error) < 2500


@pytest.mark.parametrize(
    ('vary', 'words'),
    [
        ('events: {from: 1, to: 1000000000}', 'more than 1000000 values'),
        ('alpha: {from: 0.1, to: 0.2, steps: 1000000000}', 'steps'),
        ('events: {from: 1, to: 900000}, seed: {from: 1, to: 900000}', '810000000000 tasks'),
        ('alpha: {from: .nan, to: 0.2, steps: 3}', 'nan is out of range'),
        ('alpha: {from: 0.1, to: .inf, steps: 3}', 'inf is out of range'),
    ],
)
def test_a_sweep_without_end_is_refused(bounded, tmp_path, capsys, vary, words):
    (tmp_path / 's.yaml').write_text(f'model: ofc\nvary: {{{vary}}}\n')
    bounded(SPARE)
    assert cli.main(['sweep', str(tmp_path / 's.yaml'), '--count']) == 78
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(('rate', 'words'), [(1000, 'MB of memory'), (999_983, 'no usual rate')])
def test_sounds_whose_rate_asks_for_memory_are_refused(bounded, tmp_path, rate, words):
    path = tmp_path / 'x.wav'
    path.write_bytes(sound(rate, np.zeros(8), 'PCM_16'))
    count = 100_000_000 if rate == 1000 else 1000  # 48 times as many at 48 kHz, in a sparse file
    head = path.read_bytes()[:44]
    sizes = struct.pack('<I', 36 + 2 * count), struct.pack('<I', 2 * count)
    path.write_bytes(head[:4] + sizes[0] + head[8:40] + sizes[1])
    os.truncate(path, 44 + 2 * count)
    bounded(SPARE)
    with pytest.raises(ConfigError, match=words):
        audio_file.read_mono(path, 48000)


def test_one_bad_image_of_many_is_left_out(good, tmp_path, capsys):
    (tmp_path / 'cut.png').write_bytes(FILES['image.png'][:50])
    images = [str(good / 'image.png'), str(tmp_path / 'cut.png')]
    assert cli.main(['calibrate', 'board', *images]) == 78
    first, *rest = capsys.readouterr().err.splitlines()
    assert first.startswith(f'{tmp_path}/cut.png: cut off') and first.endswith('; left out')
    assert rest and 'cut.png' not in rest[-1]


def test_a_command_asks_for_no_more_memory_than_is_free(monkeypatch, capsys):
    def asks(args):
        np.ones(1 << 40, np.uint8)

    monkeypatch.setattr(check, 'run', asks)
    before = resource.getrlimit(resource.RLIMIT_DATA)
    assert cli.main(['check']) == 1
    assert 'needs more memory than this machine has' in capsys.readouterr().err
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


@pytest.mark.parametrize('verb', ['check', 'calibrate'])
def test_a_verb_that_takes_long_says_what_it_does(monkeypatch, capsys, verb):
    monkeypatch.setattr(progress, 'SILENT_S', 0.01)
    module = importlib.import_module(f'eol_ros.verbs.{verb}')
    monkeypatch.setattr(module, 'run', lambda args: progress.Progress._active[0]._timer.join(5.0))
    assert cli.main([verb, *(['blocks', 'x'] if verb == 'calibrate' else [])]) == 0
    assert capsys.readouterr().err == f'eol {verb}: {cli.VERBS[verb]} ...\n'
