# SPDX-License-Identifier: Apache-2.0
"""eol simulate can be stopped."""

import subprocess
import sys

import pytest

STOPPED = """
import signal, sys
from eol_ros import cli

def interrupt(*_):
    raise KeyboardInterrupt

words = ['simulate', 'S3L', '--path', sys.argv[1]]
assert cli.main(words) == 0  # what is compiled is compiled now
signal.signal(signal.SIGALRM, interrupt)
signal.setitimer(signal.ITIMER_REAL, 0.2)
sys.exit(cli.main([*words, '--repeat', '10000000']))
"""


@pytest.mark.slow
@pytest.mark.parametrize('path', ['event', 'exact', 'stepping'])
def test_an_interrupt_ends_a_run(path):
    result = subprocess.run([sys.executable, '-c', STOPPED, path], capture_output=True, text=True)

    assert result.returncode == 0, result.stderr
    assert result.stderr.splitlines()[-1] == 'eol simulate: stopped'
