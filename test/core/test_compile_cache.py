# SPDX-License-Identifier: Apache-2.0
"""One cache of compiled loops, many processes: what is loaded is right, whatever happens to it."""

import os
import shutil
import subprocess
import sys

import pytest
from support.checkout import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]  # a busy machine compiles for minutes
KERNELS = """
import numpy as np
from eol_ros.core.compiled import njit

@njit(cache=True, inner=True)
def term(value, scale):
    return value * scale

@njit(cache=True)
def total(values, scale):
    sum = values[0] * 0
    for value in values:
        sum += term(value, scale)
    return sum

@njit(cache=True)
def mean(values, scale):
    return total(values, scale) / len(values)
"""
# `work` compiles or loads in an order of its own: two processes then number their types otherwise.
WORK = """
import json, os, signal, sys, time
import numpy as np
import kernels
from eol_ros import compiled

KINDS = [np.float64, np.int32]

def work(first):
    for k in range(len(KINDS)):
        values = np.arange(10, dtype=KINDS[(first + k) % len(KINDS)])
        assert kernels.total(values, values[2]) == 90 and kernels.mean(values, values[2]) == 9
    stats = (kernels.total.stats, kernels.mean.stats)
    return sum(sum(row.cache_misses.values()) for row in stats)

def fork(first=0, allowed=99):
    child = os.fork()
    if not child:
        code = 2
        try:
            code = int(work(first) > allowed)
        finally:
            os._exit(code)
    return child

def ended(child):
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
"""
TOGETHER = """
for k in range(3):
    os.environ['NUMBA_CACHE_DIR'] = f'{sys.argv[1]}/{k}'
    assert [ended(child) for child in [fork(first) for first in range(8)]] == [0] * 8
    assert [ended(fork(first, allowed=0)) for first in range(2)] == [0] * 2
"""
KILLED = """
os.environ['NUMBA_CACHE_DIR'] = f'{sys.argv[1]}/whole'
start = time.monotonic()
assert ended(fork()) == 0
took = time.monotonic() - start
os.environ['NUMBA_CACHE_DIR'] = f'{sys.argv[1]}/killed'
for k in range(20):
    child = fork(k)
    time.sleep(0.05 * took * (k + 0.5) if k % 2 else 0.3 * took)
    os.kill(child, signal.SIGKILL)
    ended(child)
    names = [path.name for path in compiled.folders()[0].glob('*.object')]
    assert all(map(compiled._is_whole, names))
assert [ended(fork()), ended(fork(allowed=0))] == [0, 0]
"""
# Two processes compile one function. A third loads an object, replaces it by the other one, and
# compiles a caller.
REPLACED = """
values = np.arange(10.0)
for place in 'ab':
    os.environ['NUMBA_CACHE_DIR'] = f'{sys.argv[1]}/{place}'
    if not os.fork():
        kernels.total(values, 2.0)
        os._exit(0)
    os.wait()
other = compiled.folders()[0]
os.environ['NUMBA_CACHE_DIR'] = f'{sys.argv[1]}/a'
kernels.total(values, 2.0)
for path in other.glob('*.object'):
    path.replace(compiled.folders()[0] / path.name)
kernels.mean(values, 2.0)
"""
ONCE = 'print(work(0))'


@pytest.fixture
def run(tmp_path):
    """Return a function that runs a script with the kernels and returns the ended process."""
    (tmp_path / 'kernels.py').write_text(KERNELS)

    def run(script, *before, python=sys.executable, **environment):
        path = tmp_path / 'script.py'
        path.write_text(WORK + script)
        return subprocess.run(
            [*before, python, str(path), str(tmp_path)], capture_output=True, text=True,
            env={**os.environ, 'PYTHONPATH': str(ROOT), 'PYTHONWARNINGS': 'ignore',
                 'NUMBA_CACHE_DIR': str(tmp_path / 'cache'), **environment},
        )  # fmt: skip

    return run


def objects(tmp_path):
    return sorted((tmp_path / 'cache').rglob('*.object'))


@pytest.mark.parametrize('caches', [1, pytest.param(3, marks=pytest.mark.soak)])
def test_eight_processes_on_one_cold_cache(run, caches):
    done = run(TOGETHER.replace('range(3)', f'range({caches})'))
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


def test_two_processes_never_give_one_symbol_to_two_functions(run):
    code = (
        'symbol = "print(kernels.total.overloads.popitem()[1].fndesc.mangled_name, flush=True)"\n'
        'for k in range(3):\n'
        '    if not os.fork():\n'
        '        kernels.total(np.arange(3), 1)\n'
        '        exec(symbol)\n'
        '        os._exit(0)\n'
        '    os.wait()\n'
        '    compiled.forget(everything=True)\n'
    )
    symbols = run(code).stdout.split()
    assert len(symbols) == len(set(symbols)) == 3
    assert len({len(symbol) for symbol in symbols}) == 1


def test_what_was_compiled_with_a_replaced_object_runs_in_other_processes(run, tmp_path):
    assert run(REPLACED).returncode == 0
    done = run('print(kernels.mean(np.arange(10.0), 2.0))', NUMBA_CACHE_DIR=str(tmp_path / 'a'))
    assert (done.returncode, done.stdout) == (0, '9.0\n')


@pytest.mark.soak
def test_eight_processes_with_the_oldest_numba_that_is_allowed(run, tmp_path):
    requires = (ROOT / 'setup.py').read_text()
    oldest = requires.partition("'numba>=")[2].partition("'")[0]
    subprocess.run([sys.executable, '-m', 'venv', str(tmp_path / 'venv')], check=True)
    python = str(tmp_path / 'venv' / 'bin' / 'python')
    wanted = [f'numba=={oldest}.*', 'numpy', 'scipy']
    install = [python, '-m', 'pip', 'install', '--quiet', '--only-binary=:all:', *wanted]
    made = subprocess.run(install, capture_output=True, text=True)
    if made.returncode:
        pytest.skip(f'numba {oldest} cannot be installed: {made.stderr.splitlines()[-1]}')
    done = run(TOGETHER, python=python)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')
    both = [run(ONCE, python=each).stdout for each in (python, sys.executable) * 2]
    assert both == ['4\n', '4\n', '0\n', '0\n']  # one folder; neither loads the other's code


@pytest.mark.parametrize('times', [5, pytest.param(20, marks=pytest.mark.soak)])
def test_a_compilation_is_killed(run, times):
    done = run(KILLED.replace('range(20)', f'range({times})'))
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('damage', [
    lambda data: data[: len(data) // 2],
    lambda data: bytes([*data[:60], data[60] ^ 16, *data[61:]]),
], ids=['halved', 'flipped'])  # fmt: skip
def test_a_damaged_object_is_compiled_again_and_said(run, tmp_path, damage):
    """What is damaged is told by test/verbs/test_compile.py, without a compiler."""
    assert run(ONCE).stdout == '4\n'
    files = objects(tmp_path)
    assert len(files) == 6
    used = [path for path in files if '.term-' not in path.name]  # within these
    for path in files:
        path.write_bytes(damage(path.read_bytes()))
    done = run(ONCE)
    assert (done.returncode, done.stdout) == (0, '4\n'), done.stderr
    assert all(f'{path} is damaged; compiling it again' in done.stderr for path in used)
    done = run(ONCE)
    assert (done.returncode, done.stdout, done.stderr) == (0, '0\n', '')


def mounted(folder, then):
    """Return the command that runs another with a small file system of its own in `folder`."""
    own = ['unshare', '--user', '--map-root-user', '--mount']
    able = shutil.which('unshare') and not subprocess.run([*own, 'true']).returncode
    if not able:
        pytest.skip('no mount namespace of its own can be made here')
    folder.mkdir()
    script = f'mount -t tmpfs -o size=16k tmpfs {folder} && {then} && exec "$@"'
    return [*own, 'sh', '-c', script, 'sh']


def test_a_full_cache(run, tmp_path):
    done = run(ONCE, *mounted(tmp_path / 'small', 'true'), NUMBA_CACHE_DIR=str(tmp_path / 'small'))
    assert (done.returncode, done.stdout) == (0, '4\n'), done.stderr
    (line,) = done.stderr.splitlines()
    assert 'compiled loops are not stored' in line and 'No space left on device' in line


def test_a_cache_that_cannot_be_written(run, tmp_path):
    small = tmp_path / 'small'
    empty = mounted(small, f'mount -o remount,ro {small}')
    done = run(ONCE, *empty, NUMBA_CACHE_DIR=str(small))
    assert done.returncode == 1 and 'Read-only file system; set NUMBA_CACHE_DIR' in done.stderr
    run(ONCE)
    small.rmdir()
    filled = mounted(small, f'mount -o remount,size=9m {small} && cp -r {tmp_path}/cache/. {small} '
                            f'&& mount -o remount,ro {small}')  # fmt: skip
    done = run(ONCE, *filled, NUMBA_CACHE_DIR=str(small))
    assert (done.returncode, done.stdout, done.stderr) == (0, '0\n', '')
    later = 'kernels.total(np.arange(3, dtype=np.uint8), 1)\nprint(work(0))'
    done = run(later, *filled[:-1], 'sh', NUMBA_CACHE_DIR=str(small))
    assert (done.returncode, done.stdout) == (0, '1\n')
    assert 'compiled loops are not stored' in done.stderr
