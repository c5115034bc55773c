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


@pytest.mark.parametrize('name', fuzz.names())
def test_seeds_are_good(name, tmp_path):
    """What is bent is good to begin with, else all of it would be refused at the first look."""
    found = fuzz.target(name, tmp_path)
    for seed in found.seeds:
        assert found.feed(seed) is None  # it raises what is wrong


@pytest.mark.slow
@pytest.mark.parametrize('name', fuzz.names())
def test_bent_inputs(name, tmp_path):
    found = fuzz.target(name, tmp_path)
    for data in fuzz.mutations(found.seeds, 120, 1):
        try:
            fuzz.tell(found.feed, data)
        except Exception as error:
            pytest.fail(f'{data!r}: {error!r}')


@pytest.mark.slow
@pytest.mark.parametrize('name', fuzz.names())
def test_readers_keep_nothing_of_what_they_have_read(name, tmp_path):
    """It is read for months: what 60 inputs leave in memory, the next 90 may not add to."""
    found = fuzz.target(name, tmp_path)
    inputs = list(fuzz.mutations(found.seeds, 150, 2))

    def feed(some):
        for data in some:
            fuzz.tell(found.feed, data)
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
