# SPDX-License-Identifier: Apache-2.0
"""The pipe to bringup, and the names of the variables with which it starts a process."""

import json
import os
from collections.abc import Mapping
from typing import Any

HEALTH_FD = 'EOL_HEALTH_FD'
"""The descriptor of the pipe for heartbeats, and for the progress of the compiler."""
KEPT = 'EOL_KEPT'
"""JSON by node: state that each persisted in its last process."""
AGAIN = 'EOL_AGAIN'
"""Set when the other nodes already run, so that discovery takes little time, or fails."""


class HealthPipe:
    """The write end, which HEALTH_FD names; writing never blocks.

    A report that does not fit is dropped: the reader stands still, and has older ones to read when
    it goes on. Who reports does so every second, so the newest state comes within a second of that.
    """

    def __init__(self, fd: int):
        os.set_blocking(fd, False)
        self._fd = fd
        self._rest = b''  # of a report longer than PIPE_BUF, which the kernel may take in parts

    @classmethod
    def inherited(cls) -> 'HealthPipe | None':
        """Return the pipe of this process; None where no bringup has started it."""
        fd = os.environ.get(HEALTH_FD)
        return cls(int(fd)) if fd else None

    def send(self, report: Mapping[str, Any]) -> bool:
        """Write `report` as one line of JSON; return whether it was taken."""
        try:
            self._write(self._rest)
            if self._rest:
                return False
            self._write(json.dumps(report, default=str).encode() + b'\n')
        except (BlockingIOError, BrokenPipeError):  # a stuck or a dead reader
            return False
        return True

    def _write(self, data: bytes) -> None:
        self._rest = data[os.write(self._fd, data) :] if data else b''
