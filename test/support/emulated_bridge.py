# SPDX-License-Identifier: Apache-2.0
"""The bridge in emulation: firmware/bridge for a Cortex-M3 in QEMU, its host line a pty."""

import re
import socket
import struct
import subprocess
import threading
import time
from collections import deque
from pathlib import Path

from eol_ros.core.serial_protocol import ProtocolError, cobs_decode, cobs_encode, crc16
from support.emulated import FRAME, built
from support.waiting import wait_until

AIR = 0x7E  # a frame of the radio on its serial line
PC = 15


class Bridge:
    """A bridge with power. `port` is the pty of its host line."""

    def __init__(self, folder: Path):
        self._air_path, self._debug_path = folder / 'air', folder / 'debug'
        self._monitor_path = folder / 'monitor'
        self._qemu = subprocess.Popen(
            [
                'qemu-system-arm', '-M', 'mps2-an385', '-display', 'none',
                '-kernel', str(built() / 'bridge.elf'),
                '-serial', 'pty',
                '-serial', f'unix:{self._air_path},server=on,wait=on',
                '-monitor', f'unix:{self._monitor_path},server=on,wait=off',
                '-gdb', f'unix:{self._debug_path},server=on,wait=off',
            ],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert self._qemu.stdout is not None
        self.port = ''
        while not self.port:
            line = self._qemu.stdout.readline()
            assert line, 'QEMU has ended'
            found = re.search(r'/dev/pts/\d+', line)
            self.port = found.group() if found else ''
        wait_until(self._air_path.exists)
        self._air = socket.socket(socket.AF_UNIX)
        self._air.connect(str(self._air_path))
        self._frames: deque[bytes] = deque(maxlen=2000)  # 4 s
        self._sequence = 0
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def __enter__(self) -> 'Bridge':
        return self

    def __exit__(self, *_: object) -> None:
        self._qemu.kill()
        self._qemu.communicate()
        self._thread.join()
        self._air.close()

    def say(self, frame: bytes) -> None:
        """A block sends."""
        packet = bytes([AIR, self._sequence]) + frame.ljust(FRAME, b'\0')
        self._sequence = (self._sequence + 1) & 0xFF
        packet += struct.pack('<H', crc16(packet))
        self._air.sendall(b'\0' + cobs_encode(packet) + b'\0')

    def noise(self, data: bytes) -> None:
        """Bytes on the line of the radio, whatever they are."""
        self._air.sendall(data)

    def frames(self, seconds: float) -> list[bytes]:
        """Return the frames that the bridge has sent since the last call, and within some time."""
        time.sleep(seconds)
        found = []
        while self._frames:
            found.append(self._frames.popleft())
        return found

    def _listen(self) -> None:
        pending = b''
        while data := self._received():
            *whole, pending = (pending + data).split(b'\0')
            for part in filter(None, whole):
                try:
                    packet = cobs_decode(part)
                except ProtocolError:
                    continue
                if crc16(packet[:-2]) == struct.unpack('<H', packet[-2:])[0] and packet[0] == AIR:
                    self._frames.append(packet[2:-2])

    def _received(self) -> bytes:
        try:
            return self._air.recv(4096)
        except ConnectionResetError:  # it has no power any more
            return b''

    def monitor(self, command: str) -> None:
        """Give QEMU a command, `system_reset` say."""
        with socket.socket(socket.AF_UNIX) as line:
            line.connect(str(self._monitor_path))
            line.sendall(command.encode() + b'\n')
            heard = b''
            while heard.count(b'(qemu)') < 2:
                heard += line.recv(4096)

    def hang(self) -> None:
        """Let the processor run in an endless loop, with its interrupts, by the debugger."""
        names = subprocess.run(
            ['arm-none-eabi-nm', str(built() / 'bridge.elf')],
            check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
        at = int(next(line.split()[0] for line in names.splitlines() if 'on_fault' in line), 16)
        with socket.socket(socket.AF_UNIX) as line:
            line.connect(str(self._debug_path))  # stops it
            line.settimeout(60.0)
            told = 'qXfer:features:read:target.xml:0,ffb'  # it then lets registers be written to
            for words in (told, f'P{PC:x}={struct.pack("<I", at & ~1).hex()}', 'D'):
                line.sendall(f'+${words}#{sum(words.encode()) & 0xFF:02x}'.encode())
                wanted = rb'\$l<' if words == told else rb'\$OK#'  # beside it, that it has stopped
                answer = b''
                while not re.search(wanted, answer):
                    answer += line.recv(4096)
            line.sendall(b'+')
