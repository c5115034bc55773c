# SPDX-License-Identifier: Apache-2.0
"""The real avrdude takes the command lines of `make flash` and `make fuses`."""

import subprocess

import pytest
from support import needs
from support.emulated import built

pytestmark = [pytest.mark.firmware, needs.marker('avrdude', 'gcc-avr')]


@pytest.mark.parametrize('target', ['flash', 'fuses'])
def test_it_gets_as_far_as_to_miss_the_programmer(target):
    """There is none here. What avrdude does not understand would be its usage."""
    command = ['make', '-C', str(built().parent), target, 'NUMBER=7']
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode and 'usage' not in done.stderr.lower()
    assert 'usbasp' in done.stderr.lower()
