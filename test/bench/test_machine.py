# SPDX-License-Identifier: Apache-2.0
import json
import os
import platform
import subprocess
import sys

import pytest

from benchmarks.machine import line
from eol_ros.core.compiled import TARGET

ASK = 'import json; from benchmarks.machine import machine; print(json.dumps(machine()))'


@pytest.mark.skipif(platform.machine() != 'x86_64', reason='names processors of x86-64')
def test_says_what_is_compiled_for_and_how_wide():
    """It is asked of the compiler, which the environment does not change."""
    environment = {**os.environ, 'NUMBA_CPU_NAME': 'nehalem', 'NUMBA_CPU_FEATURES': ''}
    words = [sys.executable, '-c', ASK]
    found = json.loads(subprocess.run(words, env=environment, capture_output=True).stdout)
    if found['compiled_for'] == TARGET:
        assert (found['vector_bits'], found['vectors']) == (256, 'AVX2')
    assert f'compiled for {found["compiled_for"]}' in line(found)
