# SPDX-License-Identifier: Apache-2.0
"""What is recomputed from a recording has the same bits on every processor with AVX2 and FMA.

Other processors are stood in for by what their libraries would choose: BLAS kernels, NumPy's code
for wider or narrower vectors, and the target that numba is asked to compile for.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import config

from eol_ros.core.compiled import TARGET

ROOT = Path(__file__).parents[2]
OWN = {name: '' for name in ('OPENBLAS_CORETYPE', 'NPY_DISABLE_CPU_FEATURES', 'NUMBA_CPU_NAME')}
WITHOUT_512, WITHOUT_256 = 'X86_V4 AVX512_ICL', 'X86_V3 X86_V4 AVX512_ICL'
EVERY_RUN = {'OPENBLAS_CORETYPE': 'Sandybridge', 'NPY_DISABLE_CPU_FEATURES': WITHOUT_256}
SOAKED = [
    {'OPENBLAS_CORETYPE': 'Haswell', 'NPY_DISABLE_CPU_FEATURES': WITHOUT_512},
    *({'OPENBLAS_CORETYPE': name} for name in ('SkylakeX', 'Cooperlake', 'Zen')),
    *({'NUMBA_CPU_NAME': name} for name in ('haswell', 'skylake-avx512', 'znver4')),
]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(config.CPU_NAME != TARGET, reason='needs a processor with AVX2 and FMA'),
]


def started(more, cache=None):
    """Start `support.recomputed` on a processor that libraries take for another."""
    environment = {**os.environ, **OWN, **more, 'PYTHONPATH': f'{ROOT}:{ROOT / "test"}'}
    environment = {name: value for name, value in environment.items() if value}
    if cache:
        environment['NUMBA_CACHE_DIR'] = str(cache)
    words = [sys.executable, '-W', 'ignore', '-m', 'support.recomputed']
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)


def result(process):
    out, _ = process.communicate()
    assert process.returncode == 0
    return json.loads(out)


@pytest.fixture(scope='module')
def here():
    """The digests with all that this processor offers."""
    return result(started({}))


def test_the_sample_is_recomputed_to_the_last_bit(here):
    assert {name: verdict for name, (verdict, _) in here['sample'].items()} == dict.fromkeys(
        here['sample'], 'equal'
    )


def test_the_bits_are_the_same_whatever_a_library_chooses(here):
    assert result(started(EVERY_RUN)) == here


@pytest.mark.soak
@pytest.mark.timeout(1200)
@pytest.mark.parametrize('more', SOAKED, ids=str)
def test_the_bits_are_the_same_on_a_processor_of_another_name(here, more, tmp_path):
    assert result(started(more, tmp_path if 'NUMBA_CPU_NAME' in more else None)) == here
