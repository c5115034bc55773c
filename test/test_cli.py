# SPDX-License-Identifier: Apache-2.0
"""Every verb explains itself, and its examples are real command lines."""

import argparse
import importlib
import importlib.metadata
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy
import pytest

from eol_ros import cli
from eol_ros.errors import EolError, pip_install
from eol_ros.verbs import bench

SAMPLE = str(Path(__file__).parents[1] / 'bags/sample')


def test_every_verb_is_there():
    for verb in cli.VERBS:
        module = importlib.import_module(f'eol_ros.verbs.{verb}')
        assert module.HELP and module.EXAMPLES and module.run


@pytest.mark.parametrize('verb', cli.VERBS)
def test_examples_parse(verb):
    module = importlib.import_module(f'eol_ros.verbs.{verb}')
    parser = cli.Parser()
    module.add_arguments(parser)
    for example in module.EXAMPLES:
        words = shlex.split(re.split(r' >+ | \| ', example)[0], comments=True)
        start = 2 if words[0] == 'eol' else 3  # eol VERB ..., python -m MODULE ...
        try:
            parser.parse_args(words[start:])
        except (SystemExit, EolError) as error:
            pytest.fail(f'eol {verb} --help shows {example!r}, which it refuses: {error}')


@pytest.mark.parametrize('name', bench.names())
def test_every_benchmark_explains_itself(name, capsys):
    assert cli.main(['bench', name, '--help']) == 0
    told = capsys.readouterr().out
    assert 'examples:' in told and re.search(r'\n\n[A-Z].*\.\n\n', told)
    options = re.split(r'\n  (?=-)', told.partition('examples:')[0])[1:]
    assert [option for option in options if not re.search(r'\n? {2,}[^ -]', option)] == []


def test_unknown_verb(capsys):
    assert cli.main(['replya']) == 2
    assert 'Did you mean replay?' in capsys.readouterr().err


@pytest.mark.parametrize(
    'words', [['bench', 'vision', '--seed', '61'], ['bag', 'info', '--js', 'x']]
)
def test_half_of_an_option_is_refused(words, capsys):
    assert cli.main(words) == 2  # `--seed` is no option of it, but `--seeds` is
    told = capsys.readouterr().err
    assert f': {words[2]}' in told and 'no such option. Did you mean --' in told


@pytest.mark.parametrize(
    'words, said',
    [
        (['topics', '--seconds', '5s'], "--seconds: '5s' is not a number; units are left"),
        (
            ['lattice', '--size', '4m'],
            "--size: '4m' is not a whole number; units are left",
        ),
        (['bag', 'cut', 'x'], '-o/--output is missing (new bag folder'),
        (['simulate'], 'SCENE is missing (JSON file'),
        (['calibrate'], 'way is missing (blocks, points, board, print); FILE is missing (images'),
        (['measure', 'all'], "what: no such choice as 'all'. There are springs, friction"),
        (['topics', '--seconds'], '--seconds needs a value'),
        (['check', 'museum', 'lights'], 'lights: more words than it takes'),
        (['topics', '--seconds', '-1'], '--seconds: -1 is outside 0.1 to 3600'),
        (['topics', '--seconds', 'nan'], '--seconds: nan is outside 0.1 to 3600'),
    ],
)
def test_a_command_line_that_is_wrong_is_one_line(words, said, capsys):
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    prog = 'eol bag cut' if words[0] == 'bag' else f'eol {words[0]}'
    assert (out, err.count('\n')) == ('', 1)
    assert err.startswith(f'{prog}: {said}') and err.endswith(f'(`{prog} --help` helps)\n')


def test_a_scene_of_physics_that_is_not_there_names_those_that_are(capsys):
    assert cli.main(['simulate', 'S77']) == 69
    assert capsys.readouterr().err.startswith('eol simulate: S77: no such scene; give a JSON file')


def test_overview_names_every_verb(capsys):
    assert cli.main([]) == 0
    text = capsys.readouterr().out
    assert all(verb in text for verb in cli.VERBS)


def test_version_names_what_decides_what_a_run_computes(capsys):
    assert cli.main(['--version']) == 0
    own, *others = capsys.readouterr().out.splitlines()
    assert own.startswith(f'eol_ros {importlib.metadata.version("eol_ros")}')
    assert f'numpy {numpy.__version__}' in others


@pytest.mark.parametrize(
    'words, full',
    [
        (['report', SAMPLE, '--csv', 'blocks', '--output'], 'out/blocks.csv'),
        (['bundle', 'museum', '--output'], 'out'),
    ],
)
def test_a_full_disk_is_one_line(words, full, tmp_path, capsys):
    (tmp_path / full).parent.mkdir(exist_ok=True)
    (tmp_path / full).symlink_to('/dev/full')

    assert cli.main([*words, str(tmp_path / 'out')]) == 78
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == f'eol {words[0]}: {tmp_path}/out: No space left on device'


@pytest.mark.parametrize(
    ('words', 'buffered'),
    [
        ([], True),
        (['status', '--help'], True),
        *((['bag', 'info', SAMPLE], b) for b in (True, False)),
    ],
)
def test_a_pipe_without_a_reader_and_a_full_disk_are_no_traceback(words, buffered):
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONUNBUFFERED'}
    environment |= {} if buffered else {'PYTHONUNBUFFERED': '1'}
    command = [sys.executable, '-m', 'eol_ros', *words]
    read, written = os.pipe()
    os.close(read)
    with open(written, 'w') as pipe, open('/dev/full', 'w') as full:
        unread, no_room = (
            subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, env=environment)
            for out in (pipe, full)
        )

    assert (unread.returncode, unread.stderr) == (0, '')
    if words[1:] != ['--help']:  # which argparse prints, and does not care
        assert (no_room.returncode, no_room.stderr) == (78, 'eol: No space left on device\n')


@pytest.mark.parametrize('words', [['track', 'broken.mp4'], ['track', 'broken.npy']])
def test_libraries_say_nothing_of_a_fault_beside_our_line(words, tmp_path):
    for ending in ('mp4', 'npy'):
        (tmp_path / f'broken.{ending}').write_text('hello')
    result = subprocess.run(
        [sys.executable, '-m', 'eol_ros', *words], cwd=tmp_path, capture_output=True, text=True
    )

    assert result.returncode in (69, 78)
    *progress, line = result.stderr.splitlines()  # progress on a machine that takes 5 s for it
    assert all(re.fullmatch(r'[a-z ]+( \.\.\.|: \d+ %)', text) for text in progress)
    assert line.startswith(f'eol {words[0]}: ') and 'pickle' not in line


def test_a_line_begins_with_the_command_once(capsys):
    assert cli.main(['param', 'get', 'grains']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('eol param: ') and line.count('eol') == 1


def test_a_place_where_no_file_can_be_is_one_line(capsys):
    assert cli.main(['bag', 'cut', SAMPLE, '--end', '9', '--output', '/proc/x.mcap']) == 78
    [line] = capsys.readouterr().err.splitlines()
    assert line == 'eol bag: /proc/x.mcap: No such file or directory'


def test_a_place_that_is_not_there_is_one_line(tmp_path, capsys):
    (tmp_path / 'file').touch()
    words = ['service', 'install', 'museum', '--user', 'root', '--output', str(tmp_path / 'file')]

    assert cli.main(words) == 78
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f'eol service: {tmp_path}/file') and line.endswith('Not a directory')


def test_a_fault_of_a_connection_is_no_fault_of_a_disk():
    assert cli._explained(ConnectionResetError(104, 'reset'), argparse.Namespace(out='x')) is None


def test_a_warning_of_python_is_not_printed(tmp_path):
    script = (
        'import argparse, sys, types, warnings; from eol_ros import cli\n'
        'def run(args):\n'
        '    warnings.warn("divide by 0", RuntimeWarning)\n'
        'verb = types.SimpleNamespace(EXAMPLES=[], HELP="", run=run, add_arguments=id)\n'
        'sys.exit(cli.run_verb(verb, "eol test", []))'
    )
    result = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True,
        env={**os.environ, 'EOL_STATE': str(tmp_path), 'PYTHONWARNINGS': 'default'},
    )  # fmt: skip
    assert (result.returncode, result.stdout, result.stderr) == (0, '', '')


def test_light_verbs_are_light(tmp_path):
    """`eol check` loads what reads the files of a scene, and nothing where there are none."""
    scene = tmp_path / 'scene.yaml'
    scene.write_text('nodes: {twin: {}, tracker: {}, motion: {}, recorder: {}}')
    script = (
        f'import sys; from eol_ros import cli; cli.main(["check", {str(scene)!r}]);'
        'print([m for m in ("numpy", "rclpy", "cv2", "numba", "aiohttp", "rich", "scipy")'
        ' if m in sys.modules], file=sys.stderr)'
    )
    result = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)

    assert result.stderr.splitlines()[-1] == '[]'


def test_what_is_missing_is_installed_into_this_very_python():
    command = pip_install('python-rtmidi', 'a b')
    assert command == f"{shlex.quote(sys.executable)} -m pip install python-rtmidi 'a b'"


@pytest.mark.parametrize(
    'words', [['bag', 'info'], ['camera'], [], ['corpus'], ['board', '--port']]
)
def test_what_was_found_is_quoted_in_bounds(words, capsys):
    cli.main([*words, '\x1b[31m' + 'x' * 300_000])
    error = capsys.readouterr().err
    assert len(error) < 4000 and error.count('\n') == 1
    assert '\x1b' not in error and 'more characters' in error
