# SPDX-License-Identifier: Apache-2.0
"""eol board --flash: avrdude's command line, and what becomes of what it says."""

import json
import os
import re

import pytest
import yaml
from support.checkout import ROOT

from eol_ros import cli
from eol_ros.core import serial_protocol as protocol
from eol_ros.devices.board import programmer

NO_USB = 'avrdude: error: could not find USB device with vid=0x16c0 pid=0x5dc product=USBasp'


@pytest.fixture
def hexfile(tmp_path):
    file = tmp_path / 'block.hex'
    file.write_text(':00000001FF\n')
    return file


@pytest.fixture
def avrdude(tmp_path, monkeypatch):
    """Put a program in the place of avrdude that keeps its words, and says and does what is set."""

    def place(says='', code=0):
        folder = tmp_path / 'bin'
        folder.mkdir()
        program = folder / 'avrdude'
        program.write_text(
            f'#!/usr/bin/env python3\nimport json, sys\n'
            f'open({str(tmp_path / "told")!r}, "a").write(json.dumps(sys.argv[1:]) + "\\n")\n'
            f'sys.stderr.write({says!r})\nsys.exit({code})\n'
        )
        program.chmod(0o755)
        monkeypatch.setenv('PATH', f'{folder}:{os.environ["PATH"]}')

    place.told = lambda: [json.loads(line) for line in (tmp_path / 'told').read_text().splitlines()]
    return place


def test_a_block_gets_program_and_number(avrdude, hexfile, capsys):
    avrdude()
    assert cli.main(['board', '--flash', '7', '--program', str(hexfile)]) == 0
    (told,) = avrdude.told()
    assert told[:5] == ['-q', '-p', 'm328p', '-c', 'usbasp']
    assert told[5:] == ['-U', f'flash:w:{hexfile}:i', '-U', 'eeprom:w:7:m']
    assert 'block 7 has its firmware' in capsys.readouterr().out


def test_a_new_chip_gets_its_fuses_first_and_slowly(avrdude, hexfile):
    avrdude()
    words = ['--programmer', 'avrisp', '--programmer-port', '/dev/ttyUSB3', '--new']
    assert cli.main(['board', '--flash', '0', '--program', str(hexfile), *words]) == 0
    fuses, write = avrdude.told()
    assert fuses[3:9] == ['-c', 'avrisp', '-P', '/dev/ttyUSB3', '-B', '10']
    assert fuses[10::2] == ['lfuse:w:0xcf:m', 'hfuse:w:0xd1:m', 'efuse:w:0xfd:m']
    assert '-B' not in write and 'eeprom:w:0:m' in write


@pytest.mark.parametrize(
    ('says', 'code', 'line'),
    [
        (NO_USB, 69, 'could not find USB device'),
        ('avrdude: error: program enable: target does not answer (0x01)\n'
         'avrdude: initialization failed, rc=-1', 69, 'target does not answer'),
        ('avrdude: verification error, first mismatch at byte 0x0010', 1, 'verification error'),
        ('', 1, 'no word'),
    ],
)  # fmt: skip
def test_what_fails_is_one_line(avrdude, hexfile, capsys, says, code, line):
    avrdude(says, 1)
    assert cli.main(['board', '--flash', '7', '--program', str(hexfile)]) == code
    err = capsys.readouterr().err
    assert line in err and len(err.splitlines()) == 1


def test_without_avrdude_it_says_how_to_get_it(hexfile, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv('PATH', str(tmp_path))
    assert cli.main(['board', '--flash', '7', '--program', str(hexfile)]) == 69
    assert 'sudo apt-get install avrdude' in capsys.readouterr().err


def test_the_bridge_is_written_by_the_line_that_it_uses(capsys):
    assert cli.main(['board', '--flash', 'bridge', '--port', '/dev/ttyUSB7', '--dry-run']) == 0
    words = capsys.readouterr().out.split()
    assert words[0] == 'stm32flash' and words[-1] == '/dev/ttyUSB7'
    assert words[words.index('-w') + 1].endswith('firmware/build/bluepill.bin')
    assert cli.main(['board', '--flash', 'bridge', '--new', '--dry-run']) == 2
    assert 'no fuses' in capsys.readouterr().err


def test_fuses_are_those_of_the_circuit():
    said = yaml.safe_load((ROOT / 'docs' / 'build' / 'block.yaml').read_text())['fuses']
    assert {name: fuse['value'] for name, fuse in said.items()} == programmer.FUSES


def test_the_version_is_that_of_the_sources():
    for header, name in (('block/block.h', 'BLOCK'), ('bridge/bridge.h', 'BRIDGE')):
        text = (ROOT / 'firmware' / header).read_text()
        found = [int(re.search(rf'EOL_{name}_{n} = (\d+)', text)[1]) for n in ('MAJOR', 'MINOR')]
        assert tuple(found) == protocol.FIRMWARE, header
