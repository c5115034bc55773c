# SPDX-License-Identifier: Apache-2.0
"""The real stm32flash takes the command line that `eol board --flash bridge` gives it."""

import os
import shutil

import pytest
from support import needs
from support.emulated import built

from eol_ros import cli

pytestmark = [pytest.mark.firmware, needs.marker('stm32flash', 'gcc-arm-none-eabi', 'gcc-avr')]


@pytest.fixture
def without_parity(tmp_path, monkeypatch):
    """A pty knows no parity, which the loader of a real part wants."""
    program = tmp_path / 'stm32flash'
    program.write_text(f'#!/bin/sh\nexec {shutil.which("stm32flash")} -m 8n1 "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv('PATH', f'{tmp_path}:{os.environ["PATH"]}')


def test_a_bridge_that_does_not_answer_is_one_line(without_parity, capsys):
    _, slave = os.openpty()
    built()
    assert cli.main(['board', '--flash', 'bridge', '--port', os.ttyname(slave)]) == 69
    err = capsys.readouterr().err
    assert 'put its jumper BOOT0 to 1' in err and len(err.splitlines()) == 1
