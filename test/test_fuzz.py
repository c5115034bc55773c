# SPDX-License-Identifier: Apache-2.0
"""Whatever comes from outside, no reader crashes, hangs, or raises what is no error of ours."""

import gc
import os
import subprocess
import sys
import tracemalloc

import pytest
from support import fuzz

ROOT = os.path.dirname(__file__)


@pytest.mark.slow
@pytest.mark.parametrize('name', fuzz.names())
def test_bent_inputs_raise_no_other_error_and_leave_nothing_in_memory(name, tmp_path):
    """It is read for months: what 60 inputs leave in memory, the next 90 may not add to."""
    found = fuzz.target(name, tmp_path)
    for seed in found.seeds:  # inputs are valid before mutation
        assert found.feed(seed) is None  # raises if not
    inputs = list(fuzz.mutations(found.seeds, 150, 1))

    def feed(some):
        for data in some:
            try:
                fuzz.tell(found.feed, data)
            except Exception as error:
                pytest.fail(f'{data!r}: {error!r}')
        gc.collect()

    feed(inputs[:60])  # what is loaded and cached at first use
    tracemalloc.start()
    try:
        feed(inputs[60:])
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 180_000


@pytest.mark.soak
@pytest.mark.timeout(6 * 3600)
@pytest.mark.parametrize('name', fuzz.names())
def test_a_million_inputs_guided_by_coverage(name, tmp_path):
    pytest.importorskip('atheris', reason='pip install atheris')
    done = subprocess.run(
        [sys.executable, '-m', 'support.fuzz', name, '-runs=1000000', '-timeout=20',
         '-rss_limit_mb=4096'],
        cwd=tmp_path, env={**os.environ, 'PYTHONPATH': f'{ROOT}:{os.path.dirname(ROOT)}'},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
