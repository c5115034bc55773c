# SPDX-License-Identifier: Apache-2.0
"""The pure core runs on the oldest and on the newest wheels that setup.py allows."""

import os
import subprocess
import sys
from importlib import metadata

import pytest
from packaging.requirements import Requirement
from support.checkout import ROOT

TOOLS = ('pytest', 'pytest-timeout', 'hypothesis')  # as they are here


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize('resolution', ['lowest-direct', 'highest'])
def test_the_core_passes_on_wheels_that_setup_py_allows(resolution, tmp_path):
    pytest.importorskip('uv', reason='pip install uv')
    needs = [need for need in metadata.requires('eol_ros') if not Requirement(need).marker]
    assert len(needs) > 10
    python = tmp_path / 'venv' / 'bin' / 'python'
    uv(['venv', '--python', sys.executable, python.parents[1]])
    tools = [f'{name}=={metadata.version(name)}' for name in TOOLS]
    words = ['--python', python, '--only-binary', ':all:', '--resolution', resolution]
    uv(['pip', 'install', *words, *needs, *tools])

    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path / 'numba')}
    environment.pop('EOL_NO_SKIP', None)  # the oracles are not there
    done = subprocess.run(
        [python, ROOT / 'tools' / 'run_tests.py', '--quick'],
        cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    installed = uv(['pip', 'list', '--python', python]).stdout
    assert done.returncode == 0, f'{installed}\n{done.stdout[-5000:]}{done.stderr[-1000:]}'


def uv(words):
    return subprocess.run(
        [sys.executable, '-m', 'uv', *words], check=True, capture_output=True, text=True
    )
