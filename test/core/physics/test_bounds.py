# SPDX-License-Identifier: Apache-2.0
"""Compiled loops check no index; here they do, in the tests of physics and of bent inputs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
CHECKED = ('test/core/physics', 'test/lab', 'test/test_fuzz.py')


@pytest.mark.soak
@pytest.mark.timeout(3 * 3600)
def test_no_index_is_out_of_bounds():
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '--timeout', '900',
         *CHECKED],
        cwd=ROOT, env={**os.environ, 'NUMBA_BOUNDSCHECK': '1'}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-5000:]
