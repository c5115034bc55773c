# SPDX-License-Identifier: Apache-2.0
"""The real avrdude takes the command line that `eol board --flash` gives it."""

import pytest
from support import needs
from support.emulated import built

from eol_ros import cli
from eol_ros.devices.board import programmer

pytestmark = [pytest.mark.firmware, needs.marker('avrdude', 'gcc-avr')]


@pytest.mark.parametrize('new', [[], ['--new']])
def test_it_gets_as_far_as_to_miss_the_programmer(capsys, new):
    """There is none here. What avrdude does not understand would be its usage, and exit code 1."""
    assert built() == programmer.PROGRAM.parent and programmer.PROGRAM.exists()
    assert cli.main(['board', '--flash', '7', '--programmer', 'usbasp', *new]) == 69
    err = capsys.readouterr().err
    assert 'does not reach the chip by usbasp' in err and len(err.splitlines()) == 1
