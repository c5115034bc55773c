# SPDX-License-Identifier: Apache-2.0
"""The counts of a day in a small file, so that a restart forgets nothing."""

import json
import re
from collections.abc import Callable
from typing import Any

from eol_ros import folders
from eol_ros.disk import DISK, Disk, read

SAVE_EVERY_S = 5.0


class DayFile:
    """Keeps one JSON object in the state folder, written at most every 5 s.

    A file that cannot be read counts as none; one that cannot be written is told in `trouble`, and
    the show goes on.
    """

    def __init__(self, name: str, what: str = 'cascades', disk: Disk = DISK):
        plain = re.sub(r'[^\w.-]', '_', name)
        self.path = folders.state_path() / f'{what}-{plain}.json'
        self.trouble, self._disk = '', disk
        self._saved: Any = None
        self._next_s = 0.0

    def load(self, parse: Callable[[Any], Any] = lambda value: value) -> Any:
        """Return the value that was saved last, as `parse` makes it; None if it is damaged."""
        return read(self.path, lambda content: parse(json.loads(content)))

    def save(self, value: Any, now_s: float) -> None:
        """Write `value` if it is new and the last writing is long enough ago; never half a file."""
        if value == self._saved or now_s < self._next_s:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._disk.write(self.path, json.dumps(value))
        except OSError as error:
            self.trouble = f'{self.path}: {error.strerror}; a restart will forget it'
            return
        self.trouble = ''
        self._saved, self._next_s = value, now_s + SAVE_EVERY_S
