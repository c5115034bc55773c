# SPDX-License-Identifier: Apache-2.0
"""What killed DDS processes leave in /dev/shm, and how it is kept from holding up the others.

Fast DDS keeps a port, the queue of what is meant for one participant, in a file that its reader or
its first writer makes. A process that is killed between making the file and giving it a size leaves
it empty, and a process that opens it then waits for the size: 300 s, in C, deaf to signals
(Boost.Interprocess, managed_open_or_create_impl.hpp). The reader would not start, and the writers
would stand in `publish`.
"""

import contextlib
import os
import re
import subprocess
import sys
import time
from pathlib import Path

FOLDER = Path('/dev/shm')
UNFINISHED_S = 1.0  # making a port takes microseconds
_PORT = re.compile(r'fastrtps_port\d+')
_CORRUPTED = (3).to_bytes(4, sys.byteorder)  # Boost.Interprocess: the first word of a segment
_SIZE = 4096


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


def clean() -> None:
    """Remove what killed processes have left; what a live one uses stays."""
    release_unfinished()
    try:
        left = any(name.startswith('fastrtps_') for name in os.listdir(FOLDER))
    except OSError:
        return
    tool = Path(sys.executable).with_name('fastdds')
    if left and tool.exists():
        subprocess.run([tool, 'shm', 'clean'], capture_output=True, timeout=20, check=False)
