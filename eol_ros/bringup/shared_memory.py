# SPDX-License-Identifier: Apache-2.0
"""What killed DDS processes leave in /dev/shm, and how it is kept from holding up the others.

Fast DDS keeps a port, the queue of what is meant for one participant, in a file that its reader or
its first writer makes. A process that is killed between making the file and giving it a size leaves
it empty, and a process that opens it then waits for the size: 300 s, in C, deaf to signals
(Boost.Interprocess, managed_open_or_create_impl.hpp). The reader would not start, and the writers
would stand in `publish`.

A reader that takes the port of a killed one removes its file and makes another, but does not mark
the old one, into which all writers go on writing (SharedMemGlobal.hpp, open_port_internal). They
notice after 2 to 3 s that nobody reads there; never, if the killed reader stood between two
messages, or had been stopped so long that they had made its port again themselves. So the ports of
a process are marked when it has ended: every writer then opens at its next message what is there.
Bringup marks the ports of its nodes; if it was killed with them, the next bringup marks them.
"""

import contextlib
import fcntl
import os
import re
import struct
import subprocess
import sys
import time
from pathlib import Path

FOLDER = Path('/dev/shm')
UNFINISHED_S = 1.0  # making a port takes microseconds
_PORT = re.compile(r'fastrtps_port\d+')
_CORRUPTED = (3).to_bytes(4, sys.byteorder)  # Boost.Interprocess: the first word of a segment
_SIZE = 4096
# Of the node of a port (SharedMemGlobal.hpp, PortNode, ABI 5): its number, listeners, two timeouts
# in ms, capacity and who waits; then bits, of which the lowest says that the port is in order.
_TIMEOUTS = struct.pack('=II', 1000, 333)
_BITS = 24  # bytes from its number to these
_IN_ORDER = 1


def release_unfinished(folder: Path = FOLDER, now_s: float | None = None) -> list[str]:
    """Remove ports that were left without a size; return their names.

    Each is marked as corrupted first, so that those who wait for it give up and make another.
    """
    now_s = time.time() if now_s is None else now_s
    released = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if not _PORT.fullmatch(entry.name):
                continue
            with contextlib.suppress(OSError):  # somebody else's, or it has just gone
                state = entry.stat()
                if state.st_size or now_s - state.st_ctime < UNFINISHED_S:
                    continue
                with open(entry.path, 'r+b', buffering=0) as file:
                    file.write(_CORRUPTED)
                    file.truncate(_SIZE)
                os.unlink(entry.path)
                released.append(entry.name)
    return sorted(released)


class Ports:
    """The ports that one process reads, kept open, so that they can be marked when it has ended."""

    def __init__(self, folder: Path = FOLDER):
        self._folder = folder
        self._held: dict[int, int] = {}  # a descriptor of each port

    def look(self, pid: int) -> None:
        """Take hold of the ports of process `pid`; again of those that are others by now."""
        for port in list(self._held) or _read_by(pid, self._folder):
            with contextlib.suppress(OSError):
                path = self._path(port)
                held = self._held.get(port)
                if held is None or os.fstat(held).st_ino != os.stat(path).st_ino:
                    self._held[port] = os.open(path, os.O_RDWR | os.O_CLOEXEC)
                    if held is not None:
                        os.close(held)

    def end(self) -> list[int]:
        """Mark the ports, whose reader has ended; return the numbers of those that were in order.

        One that a living process has taken over since stays as it is.
        """
        marked = []
        for port, held in self._held.items():
            with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
                stack.callback(os.close, held)
                files = {os.fstat(held).st_ino: held}
                with contextlib.suppress(FileNotFoundError):
                    named = os.open(self._path(port), os.O_RDWR | os.O_CLOEXEC)
                    stack.callback(os.close, named)
                    inode = os.fstat(named).st_ino
                    files[inode] = named
                    if _locked(self._path(port, '_el')):
                        del files[inode]
                if any([_mark(file, port) for file in files.values()]):
                    marked.append(port)
        self._held = {}
        return marked

    def _path(self, port: int, suffix: str = '') -> Path:
        return self._folder / f'fastrtps_port{port}{suffix}'


def _read_by(pid: int, folder: Path) -> list[int]:
    """Return the ports that process `pid` reads: it holds a lock on a file beside each."""
    found = []
    with contextlib.suppress(OSError):
        for file in os.listdir(f'/proc/{pid}/fd'):
            with contextlib.suppress(OSError):
                path = os.readlink(f'/proc/{pid}/fd/{file}')
                if lock := re.fullmatch(rf'{folder}/fastrtps_port(\d+)_el', path):
                    found.append(int(lock[1]))
    return found


def _locked(path: Path) -> bool:
    """Tell whether a living process holds a lock on a file, without trying to lock it."""
    try:
        inode = os.stat(path).st_ino
        return any(f':{inode} ' in line for line in Path('/proc/locks').read_text().splitlines())
    except OSError:
        return False


def _mark(file: int, port: int) -> bool:
    """Mark a port as out of order; return whether it was in order."""
    content = os.pread(file, os.fstat(file).st_size, 0)
    number = re.escape(port.to_bytes(4, sys.byteorder))
    node = re.compile(number + b'.{4}' + re.escape(_TIMEOUTS), re.DOTALL)
    places = [found.start() + _BITS for found in node.finditer(content)]
    if len(places) != 1:  # not the Fast DDS that we know: its ports are left alone
        return False
    (bits,) = struct.unpack_from('=I', content, places[0])
    os.pwrite(file, struct.pack('=I', bits & ~_IN_ORDER), places[0])
    return bool(bits & _IN_ORDER)


def mark_unread(folder: Path = FOLDER) -> list[int]:
    """Mark the ports whose readers have ended; return the numbers of those that were in order."""
    marked = []
    for path in folder.glob('fastrtps_port*_el'):
        with contextlib.suppress(OSError, ValueError), path.open('rb') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # raises if a reader holds it
            port = path.with_name(path.name.removesuffix('_el'))
            number = int(port.name.removeprefix('fastrtps_port'))
            with port.open('r+b', buffering=0) as file:
                if _mark(file.fileno(), number):
                    marked.append(number)
    return marked


def clean() -> None:
    """Mark ports without a reader, then remove files of killed processes; files in use stay."""
    release_unfinished()
    mark_unread()
    try:
        left = any(name.startswith('fastrtps_') for name in os.listdir(FOLDER))
    except OSError:
        return
    tool = Path(sys.executable).with_name('fastdds')
    if left and tool.exists():
        subprocess.run([tool, 'shm', 'clean'], capture_output=True, timeout=20, check=False)
