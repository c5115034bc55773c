# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C ends a command wherever it comes: in imports, in code that drops it, in what is put away.

Each script asks by itself at the place that is meant, so that nothing here depends on time.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

START = """
import os, signal, sys, time, types
from eol_ros import interrupts
interrupts.install()
ASK = lambda number=signal.SIGINT: os.kill(os.getpid(), number)
from eol_ros import cli
def eol(run):
    verb = types.SimpleNamespace(EXAMPLES=[], HELP='', run=run, add_arguments=id)
    sys.exit(cli.run_verb(verb, 'eol test', []))
def wait():
    while True:
        time.sleep(0.01)
"""
BADLY_MADE = """
import os, signal
try:
    os.kill(os.getpid(), signal.{number})
    sum(range(1000))  # the handler runs
except BaseException:
    raise ImportError('as the C code of an extension says')
"""
STOPPED = (0, 'eol test: stopped\n')


@pytest.fixture
def end(tmp_path):
    """Run a script; return its exit code and what it said."""

    def end(script, **options):
        done = subprocess.run(
            [sys.executable, '-c', START + script], stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, cwd=tmp_path, timeout=120, **options,
            env={**os.environ, 'PYTHONPATH': f'{Path(__file__).parents[1]}:{tmp_path}'},
        )  # fmt: skip
        return done.returncode, done.stdout

    return end


@pytest.mark.parametrize('number', ['SIGINT', 'SIGTERM'])
def test_before_the_verb_runs_it_ends_at_once(number, end):
    code = f'try:\n    ASK(signal.{number}); wait()\nexcept BaseException:\n    sys.exit(3)'
    assert end(code) == (0, 'eol: stopped\n')


@pytest.mark.parametrize('number', ['SIGINT', 'SIGTERM'])
def test_an_import_is_not_interrupted_and_what_follows_is(number, end, tmp_path):
    (tmp_path / 'badly_made.py').write_text(BADLY_MADE.format(number=number))
    assert end('def run(args):\n    import badly_made\n    wait()\neol(run)') == STOPPED


def test_a_terminated_benchmark_removes_its_folder(end, tmp_path):
    """It is a verb within the verb `bench`."""
    script = """
import tempfile
from eol_ros.verbs import bench
def run(args):
    with tempfile.TemporaryDirectory(dir=os.getcwd()):
        ASK(signal.SIGTERM); wait()
parts = dict(EXAMPLES=[], HELP='It ends.', run=run, add_arguments=id)
sys.modules['benchmarks.ends'] = types.SimpleNamespace(**parts)
bench.names = lambda: ['ends']
sys.exit(cli.main(['bench', 'ends']))
"""
    assert end(script) == (0, 'eol bench ends: stopped\n')
    assert not list(tmp_path.iterdir())


def test_llvmlite_is_not_interrupted_between_two_owners(end):
    """Freed by both, a module of machine code crashes the process."""
    script = """
from llvmlite import binding
binding.initialize_native_target()
binding.initialize_native_asmprinter()
class Asks(binding.ModuleRef):
    @property
    def _owned(self):
        return vars(self).get('owned', False)
    @_owned.setter
    def _owned(self, value):  # by an engine, which frees it: in C that is so already
        ASK()
        sum(range(1000))
        vars(self)['owned'] = value
def run(args):
    module = binding.parse_assembly('define i32 @one() { ret i32 1 }')
    module.__class__ = Asks
    machine = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(''), machine)
    engine.add_module(module)
    wait()
eol(run)
"""
    assert end(script) == STOPPED


def test_numpy_may_drop_it(end):
    """It asks an operand for attributes, and drops whatever that raises: the signal here."""
    script = """
import numpy
class Odd(type):
    def __getattr__(cls, name):
        if not asked:
            asked.append(name)
            ASK()
            sum(range(1000))
        raise AttributeError
class Operand(metaclass=Odd):
    pass
def run(args):
    numpy.arange(3) == Operand
    assert asked
    wait()
asked = []
eol(run)
"""
    assert end(script) == STOPPED


def test_a_destructor_may_drop_it_and_prints_nothing(end):
    script = """
class Left:
    def __del__(self):
        ASK()
        sum(range(1000))
def run(args):
    Left()
    wait()
eol(run)
"""
    assert end(script) == STOPPED


def test_what_is_put_away_meanwhile_is_not_interrupted_again(end):
    script = """
def run(args):
    try:
        ASK()
        wait()
    finally:
        for _ in range(10):
            time.sleep(interrupts.AGAIN_S)
            ASK()  # somebody who is impatient
        print('put away', flush=True)
eol(run)
"""
    assert end(script) == (0, 'put away\neol test: stopped\n')


def test_who_catches_it_goes_on_until_it_comes_again(end):
    script = """
def run(args):
    try:
        ASK()
        wait()
    except KeyboardInterrupt:
        interrupts.caught()
    time.sleep(10 * interrupts.AGAIN_S)
    print('summed up', flush=True)
    ASK()
    wait()
eol(run)
"""
    assert end(script) == (0, 'summed up\neol test: stopped\n')


def test_at_its_end_a_command_keeps_its_exit_code(end):
    script = """
import atexit, threading
atexit.register(ASK)
threading.Thread(target=lambda: [time.sleep(0.1), ASK()]).start()
eol(lambda args: 7)
"""
    assert end(script) == (7, '')


def test_what_a_shell_lets_a_command_ignore_stays_ignored(end):
    script = 'def run(args):\n    ASK()\n    sum(range(1000))\n    return 7\neol(run)'
    ignore = lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)  # noqa: E731
    assert end(script, preexec_fn=ignore) == (7, '')


def test_both_ways_to_start_it_take_it_over(end):
    """`python -m eol_ros` and the program `eol`, which `test_packaging` holds to the same."""
    script = """
from eol_ros import __main__
signal.signal(signal.SIGINT, signal.default_int_handler)
cli.main = lambda: ASK() or wait()
__main__.main()
"""
    assert end(script) == (0, 'eol: stopped\n')
