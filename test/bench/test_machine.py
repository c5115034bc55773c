# SPDX-License-Identifier: Apache-2.0
import importlib
import inspect
import json
import os
import platform
import subprocess
import sys

import pytest

from benchmarks.machine import line, machine, tell
from eol_ros.core.compiled import TARGET
from eol_ros.verbs.bench import names

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


def test_figures_carry_their_machine(capsys):
    tell({'rows': [1]}, True, str)
    told = json.loads(capsys.readouterr().out)
    assert told == {'machine': machine(), 'rows': [1]}
    tell({'rows': [1]}, False, lambda result: f'rows {result["rows"]}')
    assert capsys.readouterr().out.splitlines() == [line(machine()), 'rows [1]']


@pytest.mark.parametrize('name', names())
def test_every_benchmark_names_it(name):
    source = inspect.getsource(importlib.import_module(f'benchmarks.{name}').run)
    # held_out.measure tells what it has measured
    assert 'tell(' in source or 'held_out.measure(' in source
    assert 'print(json' not in source
