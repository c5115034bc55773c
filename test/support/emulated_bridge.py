# SPDX-License-Identifier: Apache-2.0
"""The bridge in emulation, as the twin has it, with QEMU's monitor and debugger beside it."""

import re
import socket
import struct
import subprocess
import time
from pathlib import Path

from eol_ros.devices.board import firmware
from support.emulated import built

PC = 15


class Bridge(firmware.Bridge):
    """A bridge with power. `port` is the pty of its host line."""

    def __init__(self, folder: Path):
        built()
        self._debug_path, self._monitor_path = folder / 'debug', folder / 'monitor'
        super().__init__(
            '-monitor', f'unix:{self._monitor_path},server=on,wait=off',
            '-gdb', f'unix:{self._debug_path},server=on,wait=off',
        )  # fmt: skip

    def __enter__(self) -> 'Bridge':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def sent(self, seconds: float) -> list[bytes]:
        """Return the frames that the bridge has sent since the last call, and within some time."""
        time.sleep(seconds)
        found = []
        while self.frames:
            found.append(self.frames.popleft())
        return found

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
