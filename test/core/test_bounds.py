# SPDX-License-Identifier: Apache-2.0
"""Compiled loops check no index; here they do: core, laboratory, bent inputs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHECKED = ('test/core', 'test/lab', 'test/test_fuzz.py')


@pytest.mark.soak
@pytest.mark.timeout(3 * 3600)
def test_no_index_is_out_of_bounds(tmp_path):
    more = {'NUMBA_BOUNDSCHECK': '1', 'NUMBA_CACHE_DIR': str(tmp_path)}
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '--timeout', '900',
         '--ignore=test/core/test_compile_cache.py', *CHECKED],
        cwd=ROOT, env={**os.environ, **more}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-5000:]
