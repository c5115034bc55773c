# SPDX-License-Identifier: Apache-2.0
"""The software board on a pty, where a host opens it by name, and with faults.

python test/support/fake_board.py --link /tmp/board --taps 2
"""

import argparse
import contextlib
import itertools
import os
import signal
import sys
import time
import tty
from pathlib import Path

from eol_ros.core import serial_protocol as protocol
from eol_ros.devices.board import fake

WHOLE = (protocol.ANSWERS, 400, 400, 400, 1700, 100, 1350)  # of a self-test
SPOILT = ('noise', 'truncate', 'oversize')
NOISE = bytes(range(1, 200, 7)) + b'\0\xff\xff\0'


class FakeBoard(fake.FakeBoard):
    """A board on a pty at `port`; with `link` there is a symbolic link to it, a stable name."""

    def __init__(self, link: str | None = None, version: int = protocol.VERSION, **rest):
        super().__init__(**rest)
        self.link, self.version, self.port = link, version, ''
        self.detector = protocol.Detector()  # as the host has set it
        self.lattice: protocol.Lattice | None = None  # the same
        self.self_tests: dict[int, tuple[int, ...] | None] = {}  # but for WHOLE; None: no answer
        self._muted, self._spoil = False, ''

    def fault(self, what: str) -> None:
        """Spoil the next packet (SPOILT), fall silent, lose the plug, or start again."""
        if what in SPOILT:
            self._spoil = what
        elif what in ('mute', 'unmute'):
            self._muted = what == 'mute'
        elif what == 'reboot':
            self._boot, self._clock_us, self._sequence = time.monotonic(), 0, 0
            self._decoder, self.infrared_mask = protocol.Decoder(), (1 << self.count) - 1
        else:
            {'plug': self.plug, 'unplug': self.unplug}[what]()

    def unplug(self) -> None:
        super().unplug()
        if self.link:
            Path(self.link).unlink(missing_ok=True)

    def _line(self) -> tuple[int, int]:
        board_end, host_end = os.openpty()
        tty.setraw(host_end)
        self.port = os.ttyname(host_end)
        if self.link:
            fresh = Path(f'{self.link}.new')
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.port)
            fresh.replace(self.link)
        return board_end, host_end

    def _take(self, received: protocol.Received, now_ns: int) -> None:
        message = received.message
        if isinstance(message, protocol.Hello) and message.version != self.version:
            self._send(protocol.Refused(self.version, message.version))
            return
        super()._take(received, now_ns)
        if isinstance(message, protocol.Detector):
            self.detector = message
        elif isinstance(message, protocol.Lattice):
            self.lattice = message
        elif isinstance(message, protocol.SelfTest) and message.block in self.table.ids:
            found = self.self_tests.get(message.block, WHOLE)
            if found is not None:
                self._send(protocol.SelfTested(message.block, *found))

    def _send(self, message: protocol.Message) -> None:
        if not self._muted:
            super()._send(message)

    def _write(self, end: int, packet: bytes) -> None:
        spoil, self._spoil = self._spoil, ''
        spoilt = {
            'noise': NOISE + packet,
            'truncate': packet[: len(packet) // 2],
            'oversize': b'\x01' * 1000 + packet,
        }
        super()._write(end, spoilt.get(spoil, packet))


def main() -> int:
    """Run a board until Ctrl-C or SIGTERM; its port is the one line on stdout."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--link', metavar='PATH', help='stable name for the port')
    parser.add_argument('--taps', type=float, default=0.0, metavar='HZ', help='rate of taps')
    parser.add_argument('--log', default='', metavar='FILE', help='CSV file of all arrivals')
    args = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has it ignore the first
        signal.signal(number, signal.default_int_handler)
    with FakeBoard(args.link, log_file=args.log) as board, contextlib.suppress(KeyboardInterrupt):
        print(args.link or board.port, flush=True)
        for count in itertools.count():
            time.sleep(1 / args.taps if args.taps > 0 else 1.0)
            if args.taps > 0:
                board.knock(count * 7 % board.count, 5.0)
    return 0


if __name__ == '__main__':
    sys.exit(main())
