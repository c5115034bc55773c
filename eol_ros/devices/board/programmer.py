# SPDX-License-Identifier: Apache-2.0
"""Writes the firmware: avrdude into a block, by its six pins (J2); stm32flash into the bridge.

The bridge has the loader of its maker in ROM, at the line that it uses later (ST: AN3155).
"""

import shutil
import subprocess
from pathlib import Path

from eol_ros.errors import DeviceMissing, EolError

PART = 'm328p'
PROGRAMMER = 'usbasp'
NEW_BITCLOCK_US = 10  # a new chip runs at 1 MHz, and must be written to slower than a quarter of it
FUSES = {'lfuse': 0xCF, 'hfuse': 0xD1, 'efuse': 0xFD}  # docs/build/block.yaml says why
PROGRAM = Path(__file__).parents[3] / 'firmware' / 'build' / 'block.hex'
BRIDGE_PROGRAM = PROGRAM.with_name('bluepill.bin')
BRIDGE_BAUD, BRIDGE_AT = 115200, 0x08000000
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


def bridge_command(program: Path, port: str) -> list[str]:
    """Return what is to be run to write the bridge at `port`, whose jumper BOOT0 is at 1."""
    words = ['-b', str(BRIDGE_BAUD), '-w', str(program), '-v', '-g', f'{BRIDGE_AT:#010x}']
    return ['stm32flash', *words, port]


def flash_bridge(port: str, program: Path = BRIDGE_PROGRAM) -> None:
    """Write it and read it back; raises DeviceMissing without program, stm32flash or board."""
    done = _run(bridge_command(program, port), program, 'look at the cable of the bridge')
    if done.returncode:
        said = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        line = said[-1] if said else 'no word'
        if any(words in line for words in ('Failed to init', 'Failed to open', 'Cannot handle')):
            raise DeviceMissing(
                f'stm32flash does not reach the bridge on {port} ({line}): put its jumper BOOT0 to '
                '1, push its button, and let no other program have the port'
            )
        raise EolError(f'stm32flash failed: {line}')


def _run(command: list[str], program: Path, look: str) -> 'subprocess.CompletedProcess[str]':
    if not program.exists():
        raise DeviceMissing(f'{program}: no such file: run `make -C firmware` in a checkout')
    if shutil.which(command[0]) is None:
        raise DeviceMissing(f'{command[0]} is missing: sudo apt-get install {command[0]}')
    try:
        return subprocess.run(
            command, capture_output=True, text=True, errors='replace', timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        raise DeviceMissing(f'{command[0]} has not ended within {TIMEOUT_S:g} s: {look}') from None


def flash(
    block: int, program: Path = PROGRAM, programmer: str = PROGRAMMER, port: str = '',
    new: bool = False,
) -> None:  # fmt: skip
    """Write it; raises DeviceMissing without program, avrdude, programmer or chip."""
    for command in commands(block, program, programmer, port, new):
        done = _run(command, program, 'look at the cable to J2')
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
