# SPDX-License-Identifier: Apache-2.0
"""eol simulate can be stopped."""

import json
import subprocess
import sys

import pytest

from eol_ros.lab import presets

STOPPED = """
import signal, sys
from eol_ros import cli

def interrupt(*_):
    raise KeyboardInterrupt

_, path, scene = sys.argv
assert cli.main(['simulate', 'S3L', '--path', path]) == 0  # what is compiled is compiled now
signal.signal(signal.SIGALRM, interrupt)
signal.setitimer(signal.ITIMER_REAL, 0.05)
sys.exit(cli.main(['simulate', scene, '--path', path, '--sample', '1000']))
"""


@pytest.mark.slow
@pytest.mark.parametrize(('path', 'seconds'), [('event', 1e3), ('exact', 5e3)])
def test_an_interrupt_ends_a_run(path, seconds, tmp_path):
    """As soon as the compiled loop returns, some seconds later."""
    (tmp_path / 'long.json').write_text(json.dumps(presets.scene('S3L') | {'T': seconds}))
    command = [sys.executable, '-c', STOPPED, path, str(tmp_path / 'long.json')]
    result = subprocess.run(command, capture_output=True, text=True)

    assert result.returncode == 0, result.stderr
    assert result.stderr.splitlines()[-1] == 'eol simulate: stopped'
