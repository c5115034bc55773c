# SPDX-License-Identifier: Apache-2.0
"""The real stm32flash takes the command line of `make flash-bridge`."""

import os
import shutil
import subprocess

import pytest
from support import needs
from support.emulated import built

pytestmark = [pytest.mark.firmware, needs.marker('stm32flash', 'gcc-arm-none-eabi', 'gcc-avr')]


def test_it_gets_as_far_as_to_miss_the_bridge(tmp_path):
    """A pty knows no parity, which the loader of a real part wants."""
    program = tmp_path / 'stm32flash'
    program.write_text(f'#!/bin/sh\nexec {shutil.which("stm32flash")} -m 8n1 "$@"\n')
    program.chmod(0o755)
    _, slave = os.openpty()
    command = ['make', '-C', str(built().parent), 'flash-bridge', f'PORT={os.ttyname(slave)}']
    path = f'{tmp_path}:{os.environ["PATH"]}'
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, 'PATH': path})
    assert done.returncode and 'Failed to init device' in done.stdout + done.stderr
