# SPDX-License-Identifier: Apache-2.0
"""The real stm32flash writes the bridge through a loader that speaks as the part's ROM (AN3155)."""

import os
import shutil
import struct
import threading
import tty

import pytest
from support import needs
from support.emulated import built

from eol_ros import cli
from eol_ros.devices.board import programmer

pytestmark = [pytest.mark.firmware, needs.marker('stm32flash', 'gcc-arm-none-eabi', 'gcc-avr')]
ACK, NACK = b'\x79', b'\x1f'
GET, VERSION, GET_ID, READ, GO, WRITE, ERASE = 0x00, 0x01, 0x02, 0x11, 0x21, 0x31, 0x43
DEVICE = b'\x04\x10'  # medium density, AN2606


class Rom:
    """The loader of an STM32F103C8 whose flash is erased; `port` is its line."""

    def __init__(self):
        self._fd, slave = os.openpty()
        tty.setraw(slave)
        self.port, self.flash, self.started_at = os.ttyname(slave), bytearray(), None
        threading.Thread(target=self._run, daemon=True).start()

    def _take(self, count):
        data = b''
        while len(data) < count:
            data += os.read(self._fd, count - len(data))
        return data

    def _checked(self, count):
        """Take bytes and the exclusive or of them; acknowledge."""
        *data, check = self._take(count + 1)
        for byte in data:
            check ^= byte
        os.write(self._fd, NACK if check else ACK)
        return bytes(data)

    def _address(self):
        return struct.unpack('>I', self._checked(4))[0] - programmer.BRIDGE_AT

    def _run(self):
        while self._take(1) != b'\x7f':
            pass
        os.write(self._fd, ACK)
        while True:
            command, inverse = self._take(2)
            if command ^ inverse != 0xFF:
                os.write(self._fd, NACK)
                continue
            os.write(self._fd, ACK)
            self._do(command)

    def _do(self, command):
        known = bytes([GET, VERSION, GET_ID, READ, GO, WRITE, ERASE])
        if command == GET:
            os.write(self._fd, bytes([len(known), 0x22]) + known + ACK)
        elif command == VERSION:
            os.write(self._fd, b'\x22\0\0' + ACK)
        elif command == GET_ID:
            os.write(self._fd, b'\1' + DEVICE + ACK)
        elif command == ERASE:
            pages = self._take(1)[0]
            self._take(1 if pages == 0xFF else pages + 2)
            self.flash = bytearray(b'\xff' * 65536)
            os.write(self._fd, ACK)
        elif command == WRITE:
            at, count = self._address(), self._take(1)[0] + 1
            data = self._take(count + 1)[:-1]
            assert all(byte == 0xFF for byte in self.flash[at : at + count])
            self.flash[at : at + count] = data
            os.write(self._fd, ACK)
        elif command == READ:
            at, count = self._address(), self._take(2)[0] + 1
            os.write(self._fd, ACK + self.flash[at : at + count])
        elif command == GO:
            self.started_at = self._address()


@pytest.fixture
def without_parity(tmp_path, monkeypatch):
    """A pty knows no parity, which the loader of a real part wants."""
    program = tmp_path / 'stm32flash'
    program.write_text(f'#!/bin/sh\nexec {shutil.which("stm32flash")} -m 8n1 "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv('PATH', f'{tmp_path}:{os.environ["PATH"]}')


def test_the_bridge_gets_its_program(without_parity, capsys):
    rom, program = Rom(), programmer.BRIDGE_PROGRAM
    assert built() == program.parent
    assert cli.main(['board', '--flash', 'bridge', '--port', rom.port]) == 0
    assert 'put BOOT0 back to 0' in capsys.readouterr().out
    assert rom.flash[: program.stat().st_size] == program.read_bytes()
    assert rom.started_at == 0


def test_a_bridge_that_does_not_answer_is_one_line(without_parity, capsys):
    _, slave = os.openpty()
    built()
    assert cli.main(['board', '--flash', 'bridge', '--port', os.ttyname(slave)]) == 69
    err = capsys.readouterr().err
    assert 'put its jumper BOOT0 to 1' in err and len(err.splitlines()) == 1
