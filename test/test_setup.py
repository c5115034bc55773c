# SPDX-License-Identifier: Apache-2.0
"""The set-up finds the Python that PYTHON asks for, and gives each version its own environment."""

import os
import subprocess
import sys

import pytest
from support.checkout import ROOT

OTHER = '3.12' if sys.version_info[:2] != (3, 12) else '3.13'


@pytest.fixture
def machine(tmp_path):
    """A machine on which pyenv has OTHER, and a command on the PATH that does not run."""
    place = tmp_path / 'pyenv' / 'versions' / f'{OTHER}.1' / 'bin'
    script(place / 'python', 'exit 0')
    script(tmp_path / 'bin' / f'python{OTHER}', 'echo "pyenv: command not found" >&2; exit 127')
    return {
        'PATH': f'{tmp_path / "bin"}:/usr/bin:/bin',
        'HOME': str(tmp_path),
        'PYENV_ROOT': str(tmp_path / 'pyenv'),
    }


def script(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'#!/bin/sh\n{text}\n')
    path.chmod(0o755)


def run(words, environment):
    return subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True)


def test_a_version_is_taken_from_where_it_runs(machine, tmp_path):
    found = run(['tools/find_python.sh'], machine | {'PYTHON': OTHER})
    assert found.stdout == str(tmp_path / 'pyenv' / 'versions' / f'{OTHER}.1' / 'bin' / 'python')

    asked = f'python find --system --no-python-downloads {OTHER}'
    script(tmp_path / 'bin' / 'uv', f'[ "$*" = "{asked}" ] && echo {tmp_path}/of_uv')
    script(tmp_path / 'of_uv', 'exit 0')
    assert run(['tools/find_python.sh'], machine | {'PYTHON': OTHER}).stdout == f'{tmp_path}/of_uv'

    script(tmp_path / 'bin' / f'python{OTHER}', 'exit 0')
    assert run(['tools/find_python.sh'], machine | {'PYTHON': OTHER}).stdout == f'python{OTHER}'


def test_another_version_than_asked_for_is_not_taken(machine, tmp_path):
    place = tmp_path / 'pyenv' / 'versions' / '3.9.1' / 'bin'
    place.mkdir(parents=True)
    os.symlink(sys.executable, place / 'python')
    assert run(['tools/find_python.sh'], machine | {'PYTHON': '3.9'}).stdout == ''


def test_a_version_that_is_not_there_is_one_line():
    result = run(['tools/setup_env.sh', 'core'], {**os.environ, 'PYTHON': '3.9'})
    assert result.returncode == 1
    assert result.stdout == ''
    assert result.stderr.startswith('no Python 3.9 ') and result.stderr.count('\n') == 1


@pytest.mark.parametrize('python', ['', '3.12', 'python3.11', '/usr/bin/python3'])
def test_each_version_has_its_own_environment(python):
    result = run(['make', '--dry-run', 'quick', f'PYTHON={python}'], os.environ)
    folder = '.venv-3.12' if python == '3.12' else '.venv'
    assert f'{folder}/bin/python tools/run_tests.py --quick' in result.stdout
