# SPDX-License-Identifier: Apache-2.0
"""Aravis' own simulated GigE Vision camera, which speaks the real protocol over real sockets.

Tests draw its images and wind its clock. As a program it shows a film on the loopback until it is
killed, as a camera whose cable can be pulled:

    python test/support/gige.py FILM
"""

import contextlib
import ctypes
import itertools
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from eol_ros.devices.camera import aravis

LIBRARY = 'libaravis-0.8-0'
CLONE_NEWNET = 0x40000000
GREY = 20
NAME = 'EOL01'
LATCHED = 0x0948  # bootstrap register: time stamp value
FILL = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)
# Features that real cameras have and the simulated one's description lacks
CLOCK = """
<Command Name="GevTimestampControlLatch" NameSpace="Standard">
  <pValue>LatchRegister</pValue><CommandValue>2</CommandValue></Command>
<IntReg Name="LatchRegister" NameSpace="Custom"><Address>0x944</Address><Length>4</Length>
  <AccessMode>WO</AccessMode><pPort>Device</pPort><Endianess>BigEndian</Endianess></IntReg>
<Integer Name="GevTimestampValue" NameSpace="Standard"><pValue>StampRegister</pValue></Integer>
<IntReg Name="StampRegister" NameSpace="Custom"><Address>0x948</Address><Length>8</Length>
  <AccessMode>RO</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>
  <Cachable>NoCache</Cachable><Endianess>BigEndian</Endianess></IntReg>
"""


class Gige:
    """A simulated camera; `plug` and `unplug` it.

    describe: changes the GenICam description that it hands out. clock(monotonic_ns): its own time
    in ns; latch: whether that can be asked for. An image has its number in its first four bytes, is
    stamped where its exposure begins, and goes out `readout_ns` after that has ended. lost: share
    of packets that never arrive. images: what it shows, one after another, in place of grey with
    those numbers.
    """

    def __init__(
        self,
        folder: Path,
        describe: Callable[[str], str] | None = None,
        clock: Callable[[int], int] | None = None,
        latch: bool = False,
        readout_ns: int = 5_000_000,
        lost: float = 0,
        images: list[np.ndarray] | None = None,
    ):
        self._images = itertools.cycle(images) if images else None
        self.library = aravis.load().library
        self.glib = aravis.load().gobject
        self.number = 0
        self.exposed: list[
            tuple[int, int]
        ] = []  # (begin, duration) of each image, in ns of the host
        self.latched: list[
            tuple[int, int, int]
        ] = []  # (from, to, value): what the register held, when
        self._lost, self._readout_ns = lost, readout_ns
        self._clock, self._latch = clock or (lambda ns: ns), latch
        self._fill = FILL(self._on_image)
        self._handle: Any = None
        for name in ('new_full', 'get_fake_camera'):
            getattr(self.library, f'arv_gv_fake_camera_{name}').restype = aravis.Handle
        text = description()
        if latch:
            text = text.replace('</RegisterDescription>', f'{CLOCK}</RegisterDescription>')
        self._xml = folder / 'camera.xml'
        self._xml.write_text(describe(text) if describe else text)
        self._stop = threading.Event()

    def plug(self) -> None:
        self._handle = self.library.arv_gv_fake_camera_new_full(
            b'127.0.0.1', NAME.encode(), str(self._xml).encode()
        )
        assert self._handle
        self.glib.g_object_set(self._handle, b'gvsp-lost-ratio', ctypes.c_double(self._lost), None)
        self.memory = self.library.arv_gv_fake_camera_get_fake_camera(self._handle)
        self.library.arv_fake_camera_set_fill_pattern(self.memory, self._fill, None)
        self._stop.clear()
        if self._latch:
            self._ticker = threading.Thread(target=self._tick)
            self._ticker.start()

    def unplug(self) -> None:
        self._stop.set()
        if self._latch:
            self._ticker.join()
        if self._handle:
            self.glib.g_object_unref(self._handle)
        self._handle = None

    def __enter__(self) -> 'Gige':
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def _tick(self) -> None:
        """Keep its time in the register; it knows no latch, so it holds the last millisecond."""
        while not self._stop.is_set():
            now_ns = time.monotonic_ns()
            value = self._clock(now_ns)
            self.library.arv_fake_camera_write_memory(
                self.memory, LATCHED, 8, value.to_bytes(8, 'big')
            )
            self.latched.append((now_ns, value))
            self._stop.wait(0.001)

    def _on_image(
        self, buffer: int, _data: Any, exposure_us: int, _gain: int, _format: int
    ) -> None:
        arv, buffer = aravis.load(), aravis.Handle(buffer)
        began_ns = time.monotonic_ns() - exposure_us * 1000 - self._readout_ns
        self.exposed.append((began_ns, exposure_us * 1000))
        pixels = self.library.arv_fake_camera_get_payload(self.memory)
        self.library.arv_buffer_set_timestamp(buffer, ctypes.c_uint64(self._clock(began_ns)))
        size = ctypes.c_size_t()  # of what has been received: nothing here
        data = arv.call('buffer_get_data', buffer, ctypes.byref(size))
        if self._images:
            image = next(self._images)
            ctypes.memmove(data, image.ctypes.data, min(image.nbytes, pixels))
        else:
            ctypes.memset(data, GREY, pixels)
            ctypes.memmove(data, self.number.to_bytes(4, 'little'), 4)
        self.number += 1


@contextlib.contextmanager
def own_network():
    """Put this thread and those that it starts into a network of its own, where that is allowed."""
    from support import needs

    needs.system(LIBRARY, 'iproute2')
    libc = ctypes.CDLL(None, use_errno=True)
    with open('/proc/thread-self/ns/net') as before:
        if libc.unshare(CLONE_NEWNET):
            yield  # no rights: the machine's own loopback does, too
            return
        try:
            subprocess.run(['ip', 'link', 'set', 'lo', 'up'], check=True)
            yield
        finally:
            assert libc.setns(before.fileno(), CLONE_NEWNET) == 0


def description() -> str:
    """Return the GenICam description of the simulated camera."""
    library = aravis.load().library
    for name in ('new', 'get_genicam_xml'):
        getattr(library, f'arv_fake_camera_{name}').restype = aravis.Handle
    camera, size = library.arv_fake_camera_new(b'description'), ctypes.c_size_t()
    data = library.arv_fake_camera_get_genicam_xml(camera, ctypes.byref(size))
    text = ctypes.string_at(data, size.value).decode().rstrip('\0')
    aravis.load().release(camera)
    return text


def without(text: str, *names: str) -> str:
    """Return a description without these features."""
    for name in names:
        text, n = re.subn(rf'<(\w+) Name="{name}".*?</\1>', '', text, flags=re.DOTALL)
        assert n, name
    return text


def main() -> None:
    """Show a film, over and over, until killed; says `ready` when it can be found."""
    film, images = cv2.VideoCapture(sys.argv[1]), []
    while (taken := film.read())[0]:
        images.append(np.ascontiguousarray(taken[1][..., 0]))
    with tempfile.TemporaryDirectory() as folder, Gige(Path(folder), images=images):
        print('ready', flush=True)
        threading.Event().wait()


if __name__ == '__main__':
    main()
