# SPDX-License-Identifier: Apache-2.0
"""eol bench: what a benchmark has started ends with it."""

import os
import signal
import subprocess
import sys

BENCHMARK = """
import subprocess, sys

HELP, EXAMPLES = 'Start a process and wait for it.', []

def add_arguments(parser):
    pass

def run(args):
    child = subprocess.Popen([sys.executable, '-c', 'input()'], stdin=subprocess.PIPE)
    try:
        print(child.pid, flush=True)
        child.wait()
    finally:
        child.kill()
        child.wait()
"""
BENCH = """
import sys
from pathlib import Path
from eol_ros import cli, interrupts
from eol_ros.verbs import bench

interrupts.install()
bench.ROOT = Path(sys.argv[1])
bench.FOLDER = bench.ROOT / 'benchmarks'
sys.exit(cli.main(['bench', 'waiting']))
"""


def test_a_benchmark_that_is_terminated_ends_what_it_has_started(tmp_path):
    (tmp_path / 'benchmarks').mkdir()
    (tmp_path / 'benchmarks' / '__init__.py').touch()
    (tmp_path / 'benchmarks' / 'waiting.py').write_text(BENCHMARK)
    command = [sys.executable, '-c', BENCH, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as it:
        child = int(it.stdout.readline())
        it.send_signal(signal.SIGTERM)
        _, said = it.communicate()

    assert (it.returncode, said) == (0, 'eol bench waiting: stopped\n')
    assert not os.path.exists(f'/proc/{child}')
