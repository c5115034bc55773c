# SPDX-License-Identifier: Apache-2.0
"""Writes the firmware into a block: avrdude with a programmer at its six pins (J2)."""

import shutil
import subprocess
from pathlib import Path

from eol_ros.errors import DeviceMissing, EolError

PART = 'm328p'
PROGRAMMER = 'usbasp'
NEW_BITCLOCK_US = 10  # a new chip runs at 1 MHz, and must be written to slower than a quarter of it
FUSES = {'lfuse': 0xCF, 'hfuse': 0xD1, 'efuse': 0xFD}  # docs/build/block.yaml says why
PROGRAM = Path(__file__).parents[3] / 'firmware' / 'build' / 'block.hex'
TIMEOUT_S = 120.0
# What avrdude says where it has found no programmer, or that no chip.
ABSENT = ('could not find', 'cannot find', "can't open", 'cannot open', 'unable to open',
          'no device present', 'initialization failed', 'not responding', 'no such file',
          'programmer is not')  # fmt: skip


def commands(
    block: int, program: Path, programmer: str = PROGRAMMER, port: str = '', new: bool = False
) -> list[list[str]]:
    """Return what is to be run to make a chip block `block`; `new`: it comes from the factory."""
    avrdude = ['avrdude', '-q', '-p', PART, '-c', programmer, *(['-P', port] if port else [])]
    fuses = [word for name, value in FUSES.items() for word in ('-U', f'{name}:w:{value:#04x}:m')]
    write = ['-U', f'flash:w:{program}:i', '-U', f'eeprom:w:{block}:m']
    first = [[*avrdude, '-B', str(NEW_BITCLOCK_US), *fuses]] if new else []
    return [*first, [*avrdude, *write]]


def flash(
    block: int, program: Path = PROGRAM, programmer: str = PROGRAMMER, port: str = '',
    new: bool = False,
) -> None:  # fmt: skip
    """Write it; raises DeviceMissing without program, avrdude, programmer or chip."""
    if not program.exists():
        raise DeviceMissing(f'{program}: no such file: run `make -C firmware` in a checkout')
    if shutil.which('avrdude') is None:
        raise DeviceMissing('avrdude is missing: sudo apt-get install avrdude')
    for command in commands(block, program, programmer, port, new):
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors='replace', timeout=TIMEOUT_S
            )
        except subprocess.TimeoutExpired:
            raise DeviceMissing(
                f'avrdude has not ended within {TIMEOUT_S:g} s: look at the cable to J2'
            ) from None
        if done.returncode:
            raise _failure(done.stderr, programmer)


def _failure(said: str, programmer: str) -> EolError:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    told = [line for line in lines if 'error' in line.lower()] or lines[-1:] or ['no word']
    line = told[0].removeprefix('avrdude: ').removeprefix('error: ')
    if any(words in said.lower() for words in ABSENT):
        return DeviceMissing(
            f'avrdude does not reach the chip by {programmer} ({line}): look at USB, at the six '
            'pins, and whether the block is switched on; a chip from the factory needs --new'
        )
    return EolError(f'avrdude failed: {line}')
