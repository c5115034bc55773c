# SPDX-License-Identifier: Apache-2.0
"""Compiled loops: no more is compiled than is called."""

import importlib
import os
import pkgutil
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
from numba.core import config as settings
from numba.core.dispatcher import Dispatcher

from eol_ros.core import motion, sound, vision
from eol_ros.core.compiled import FIXED, NEEDED, TARGET, _read_by, fix_target


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Give started processes a cache of this test alone: equal sources are the same objects."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))


FIRST = """
import sys
if len(sys.argv) > 1:
    import numba
    numba.njit(lambda x: x)
from eol_ros.core.physics.series import add_exactly as function
from numba import float64
from numba.core.registry import cpu_target
cache = function._cache
print(cache._named((float64, float64, float64), cpu_target.target_context.codegen())[0])
"""


@pytest.mark.slow
@pytest.mark.skipif(not FIXED, reason='code for this processor is for it alone anyway')
def test_code_made_for_this_processor_is_not_taken_for_that_of_all(own_cache):
    """numba keeps the target of its first use: librosa, imported before, would decide it."""
    usual, other = (
        subprocess.run([sys.executable, '-c', FIRST, *more], capture_output=True, text=True,
                       check=True).stdout
        for more in ([], ['numba first'])
    )  # fmt: skip
    assert usual.startswith('series.add_exactly-') and other.startswith('series.add_exactly-')
    assert usual != other


CALLS = """
import sys
from eol_ros.core.compiled import njit

@njit(cache=True, inner=True)
def half(x):
    return 0.5 * x

@njit(cache=True)
def once(x):
    return half(x)

@njit(cache=True)
def twice(x):
    return half(half(x))

print(getattr(sys.modules[__name__], sys.argv[1])(12.0), sum(half.stats.cache_hits.values()))
kinds = [cres.library.serialize_using_object_code()[1] for cres in half.overloads.values()]
print(*kinds, *(cres.library.get_pointer_to_function('half') for cres in half.overloads.values()))
"""


@pytest.mark.slow
def test_what_others_call_has_no_machine_code_and_is_taken_from_the_cache(tmp_path, own_cache):
    script = tmp_path / 'calls.py'
    script.write_text(CALLS)
    command = [sys.executable, str(script)]
    told = [
        subprocess.run([*command, name], capture_output=True, text=True, check=True).stdout.split()
        for name in ('once', 'twice', 'twice')
    ]
    code = ['intermediate', 'code', '0']
    assert told == [['6.0', '0', *code], ['3.0', '1', *code], ['3.0', '0']]


FILES = {
    'caller.py': """
import above, constants
from eol_ros.core.compiled import njit

@njit(cache=True)
def run(x):
    return above.middle(x) + constants.LAST

print(run(10.0), sum(run.stats.cache_hits.values()))
""",
    'above.py': """
import below
from eol_ros.core.compiled import njit

@njit(cache=True, inner=True)
def middle(x):
    return below.advance(x)
""",
    'below.py': """
from constants import STEP
from eol_ros.core.compiled import njit

@njit(cache=True, inner=True)
def advance(x):
    return x + STEP
""",
    'constants.py': 'STEP, LAST, OTHER = 1.0, 100.0, 0',
}


@pytest.mark.slow
def test_a_cache_is_stale_when_anything_has_changed_that_it_was_made_from(tmp_path, own_cache):
    def told():
        command = [sys.executable, '-B', str(tmp_path / 'caller.py')]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()

    def edit(name, old, new):
        text = FILES[name].replace(old, new)
        assert text != FILES[name]
        (tmp_path / name).write_text(text)

    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    assert [told(), told()] == [['111.0', '0'], ['111.0', '1']]
    edit('below.py', 'x + STEP', 'x - STEP')  # a function two files away
    assert told() == ['109.0', '0']
    edit('constants.py', 'STEP, LAST, OTHER = 1.0', 'STEP, LAST, OTHER = 2.0')
    assert told() == ['108.0', '0']
    edit('constants.py', '1.0, 100.0', '2.0, 300.0')  # read as an attribute of its module
    assert told() == ['308.0', '0']
    edit('constants.py', '1.0, 100.0, 0', '2.0, 300.0, 7')  # which no compiled function reads
    assert told() == ['308.0', '1']


def test_code_that_has_no_file_is_not_taken_from_a_cache(own_cache):
    code = (
        'from eol_ros.core.compiled import njit\n'
        '@njit(cache=True)\n'
        'def add(x):\n'
        '    return x + %d\n'
        'print(add(1))\n'
    )
    told = [
        subprocess.run([sys.executable, '-c', code % number], capture_output=True, check=True)
        for number in (1, 2)
    ]
    assert [done.stdout for done in told] == [b'2\n', b'3\n']


RECORD = """
from typing import NamedTuple
from eol_ros.core.compiled import njit

class Pair(NamedTuple):
    one: float
    other: float

@njit(cache=True)
def total(pair):
    return pair.one + pair.other

print(total(Pair(1.0, 2.0)))
"""


@pytest.mark.slow
def test_a_record_that_is_no_longer_there_makes_a_cache_stale(tmp_path, own_cache):
    (tmp_path / 'caller.py').write_text('import record')
    for name in ('Pair', 'Both'):
        (tmp_path / 'record.py').write_text(RECORD.replace('Pair', name))
        command = [sys.executable, '-B', str(tmp_path / 'caller.py')]
        result = subprocess.run(command, capture_output=True, text=True)
        assert result.stdout == '3.0\n', result.stderr


def test_the_target_is_fixed_where_the_processor_can_run_it_and_left_alone_elsewhere():
    named = SimpleNamespace(CPU_NAME='znver4', CPU_FEATURES='+avx512f')
    assert fix_target(dict.fromkeys(NEEDED, True), named)
    assert (named.CPU_NAME, named.CPU_FEATURES) == (TARGET, '')
    older = SimpleNamespace(CPU_NAME=None, CPU_FEATURES=None)
    assert not fix_target(dict.fromkeys(NEEDED, True) | {'fma': False}, older)
    assert older.CPU_NAME is None


def test_machine_code_is_the_same_whatever_processor_the_environment_names():
    """Bits follow from machine code and from nothing else of the processor."""
    code = (
        'import numpy as np\n'
        'from eol_ros.core.compiled import njit\n'
        '@njit(fastmath=True)\n'
        'def total(x):\n'
        '    s = 0.0\n'
        '    for v in x:\n'
        '        s += v * v\n'
        '    return s\n'
        'total(np.ones(8))\n'
        'print(next(iter(total.inspect_asm().values())))\n'
    )
    named = [{}, {'NUMBA_CPU_NAME': 'znver4'}, {'NUMBA_CPU_NAME': 'nehalem'}]
    told = [
        subprocess.run([sys.executable, '-c', code], env={**os.environ, **more}, check=True,
                       capture_output=True, text=True).stdout
        for more in named
    ]  # fmt: skip
    told = [re.sub(r'B16v\d{15}', '', text) for text in told]  # each process numbers its symbols
    assert told[0] and set(told) == {told[0]}
    if settings.CPU_NAME == TARGET:
        assert 'ymm' in told[0] and 'zmm' not in told[0]


def called_by(function):
    return [value for _, value in _read_by(function.py_func) if isinstance(value, Dispatcher)]


def rounds_freely(function, within=()):
    """Return whether a function, or one that it calls, may be rounded as the compiler likes."""
    return bool(function.targetoptions.get('fastmath')) or any(
        rounds_freely(other, (*within, function))
        for other in called_by(function)
        if other not in within and other is not function
    )


def test_what_rounds_freely_has_one_machine_code():
    """A process that compiles has machine code of all that is called, one that loads has not.

    The bits of a function that is called were those of its own code in the first, and of the code
    of its caller in the second.
    """
    found = {}
    for package in (motion, sound, vision):
        for module in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
            found |= {
                id(value): value
                for value in vars(importlib.import_module(module.name)).values()
                if isinstance(value, Dispatcher)
            }
    called = {id(other) for function in found.values() for other in called_by(function)}
    exact = {'_peak', 'limit', 'render'}  # of maxima, in any order: core/sound/limiter.py
    for key in called & found.keys():
        options, name = found[key].targetoptions, found[key].py_func.__name__
        alone = options.get('no_cpython_wrapper') or options.get('inline') == 'always'
        assert alone or name in exact or not rounds_freely(found[key]), f'{name} must be inner'
