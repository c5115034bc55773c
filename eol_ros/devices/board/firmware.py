# SPDX-License-Identifier: Apache-2.0
"""The twin's blocks and their bridge, each with its own firmware; the bridge is emulated.

The samples of the twin's accelerometers go to the blocks, whose firmware is compiled for this
machine. Their frames go through the bridge's program on an emulated STM32F103, whose line is a
pty. It needs a checkout in which `make firmware` has run.

    python -m eol_ros.devices.board.firmware        # prints the pty of the bridge
"""

import argparse
import contextlib
import ctypes
import random
import select
import signal
import subprocess
import sys
import threading
import time
from collections import deque

import numpy as np

from eol_ros import parent_death
from eol_ros.core import serial_protocol as protocol
from eol_ros.core.serial_protocol import GROUP
from eol_ros.devices.board.block import library
from eol_ros.devices.board.bluepill import BUILT, FRAME, Bridge
from eol_ros.devices.board.twin import REST, WOKEN, Chunk, board_address, sent, unix_socket
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.streams.graph import NAMESPACE

AIR_US = 550  # firmware/link.h
TURN_S = 1e-3
TOLD_S = 0.01  # from one telling of the levels to the next


def needed() -> None:
    """Raise DeviceMissing where the bridge's firmware or its emulator is missing."""
    for name in ('bluepill.bin', 'bluepill.so'):
        if not (BUILT / name).exists():
            raise DeviceMissing(f'{BUILT / name} is missing: run `make firmware` in a checkout')


class NativeBlocks:
    """The firmware of `count` blocks, compiled for this machine; times are in s."""

    def __init__(self, count: int = 25) -> None:
        lib, self.count = library(), count
        self._lib = lib
        size = lib.eol_block_size()
        self._memory = ctypes.create_string_buffer(size * count)
        self._at = [ctypes.addressof(self._memory) + k * size for k in range(count)]
        self._levels = (ctypes.c_uint8 * count)()
        self._frames = ctypes.create_string_buffer(FRAME * count)
        self._ticked_ms = 0
        self._chunks: list[deque[tuple[Chunk, float]]] = [deque() for _ in range(count)]
        lib.eol_blocks_begin(self._memory, ctypes.c_size_t(count))

    def feel(self, chunk: Chunk, first_s: float) -> None:
        """Give a block samples to come."""
        if chunk.kind == REST:
            self._give(chunk.block, 0.0, chunk.period_s, chunk.xy, False)
        else:
            self._chunks[chunk.block].append((chunk, first_s))

    def _give(
        self, block: int, first_s: float, period_s: float, xy: np.ndarray, woken: bool
    ) -> None:
        xy = np.ascontiguousarray(xy, np.int16)
        self._lib.eol_blocks_feel(
            ctypes.c_void_p(self._at[block]), ctypes.c_double(first_s * 1e6),
            ctypes.c_double(period_s * 1e6), ctypes.c_void_p(xy.ctypes.data),
            ctypes.c_size_t(len(xy)), ctypes.c_uint8(woken),
        )  # fmt: skip

    def run(self, now_s: float, lost: bytes) -> tuple[bytes, list[bytes]]:
        """Go on to `now_s`; return the levels, and the frames but of blocks that are `lost`."""
        for block, chunks in enumerate(self._chunks):
            while chunks:
                chunk, first_s = chunks[0]
                due = int((now_s - first_s) / chunk.period_s) + 1
                if due <= 0:
                    break
                woken = chunk.kind == WOKEN
                self._give(block, first_s, chunk.period_s, chunk.xy[:due], woken)
                if due >= len(chunk.xy):
                    chunks.popleft()
                    continue
                left = chunk._replace(kind=-1, xy=chunk.xy[due:])
                chunks[0] = left, first_s + due * chunk.period_s
                break
        ms, self._ticked_ms = int(now_s * 1e3) - self._ticked_ms, int(now_s * 1e3)
        count = self._lib.eol_blocks_tick(
            self._memory, ctypes.c_size_t(self.count), ctypes.c_uint32(ms),
            ctypes.c_double(now_s * 1e6 - AIR_US), lost, self._levels, self._frames,
        )  # fmt: skip
        raw = self._frames.raw
        return bytes(self._levels), [raw[k * FRAME : (k + 1) * FRAME] for k in range(count)]

    def hear(self, frame: bytes, deaf: bytes) -> None:
        """The bridge sends, to all but those that are `deaf`, a byte each."""
        self._lib.eol_blocks_heard(self._memory, ctypes.c_size_t(self.count), frame, deaf)


class Table:
    """Blocks, bridge and the air between them, in real time, until `close`."""

    def __init__(self, namespace: str = NAMESPACE, loss: float = 0.0, count: int = 25):
        needed()
        self.bridge, self.blocks = Bridge(), NativeBlocks(count)
        self._random, self._loss = random.Random(1), loss
        self._samples = unix_socket(board_address(namespace, 'firmware'))
        self._twin = board_address(namespace, 'blocks')
        self._packets: deque[bytes] = deque(maxlen=1000)
        self._begun_s = time.monotonic()
        threading.Thread(target=self._listen, name='twin', daemon=True).start()

    @property
    def port(self) -> str:
        """The pty of the bridge's host line."""
        return self.bridge.port

    def _lost(self) -> bytes:
        """Return for each block whether its frame is lost."""
        if not self._loss:
            return bytes(self.blocks.count)
        return bytes(self._random.random() < self._loss for _ in range(self.blocks.count))

    def turn(self, now_s: float) -> bytes:
        """Go on to `now_s`, since the start; return the levels of all."""
        ahead_s = self._begun_s - (time.monotonic() - time.time())
        while self._packets:
            for chunk in Chunk.unpack(self._packets.popleft()):
                self.blocks.feel(chunk, chunk.first_ns * 1e-9 - ahead_s)
        while self.bridge.frames:
            self.blocks.hear(self.bridge.frames.popleft(), self._lost())
        levels, frames = self.blocks.run(now_s, self._lost())
        for frame in frames:
            self.bridge.say(frame)
        return levels

    def _listen(self) -> None:
        """Take what the twin sends as it comes: the system keeps ten datagrams."""
        with contextlib.suppress(OSError, ValueError):  # closed
            while select.select([self._samples], [], [])[0]:
                with contextlib.suppress(BlockingIOError):
                    packet = self._samples.recv(1 << 18)
                    if packet:  # an empty one asks whether somebody is here
                        self._packets.append(packet)

    def run(self, stop: threading.Event) -> None:
        """Go on in real time until `stop`; where it gets no processor, in longer turns."""
        told_s = 0.0
        while not stop.wait(TURN_S):
            now_s = time.monotonic() - self._begun_s
            levels = self.turn(now_s)
            if now_s - told_s >= TOLD_S:
                told_s = now_s
                packets = [
                    protocol.encode(protocol.Levels(k, levels[k : k + GROUP]), 0)
                    for k in range(0, len(levels), GROUP)
                ]
                sent(self._samples, b''.join(packets), self._twin)

    def close(self) -> None:
        """Cut the power."""
        self.bridge.close()
        self._samples.close()


class FirmwareBoard:
    """A process with such a table; `port` is the pty of its bridge."""

    def __init__(self, namespace: str = NAMESPACE, loss: float = 0.0, count: int = 25):
        needed()
        words = ['--namespace', namespace, '--loss', str(loss), '--blocks', str(count)]
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'eol_ros.devices.board.firmware', *words],
            stdout=subprocess.PIPE, text=True, preexec_fn=parent_death.following(),
        )  # fmt: skip
        assert self._process.stdout is not None
        self.port = self._process.stdout.readline().strip()
        if not self.port:
            raise DeviceMissing('the emulated bridge did not start: see the log')

    def close(self) -> None:
        """Cut the power."""
        self._process.terminate()
        self._process.communicate()


def main(argv: list[str] | None = None) -> int:
    """Run a table until Ctrl-C or SIGTERM; its port is the one line on stdout."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--namespace', default=NAMESPACE, help='of the graph whose twin it serves')
    parser.add_argument('--loss', type=float, default=0.0, help='share of lost frames of the radio')
    parser.add_argument('--blocks', type=int, default=25, help='number of places of the table')
    args = parser.parse_args(argv)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        table = Table(args.namespace, args.loss, args.blocks)
    except EolError as error:
        print(f'firmware: {error}', file=sys.stderr)
        return error.exit_code
    print(table.port, flush=True)
    try:
        table.run(stop)
    finally:
        table.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
