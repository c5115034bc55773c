# SPDX-License-Identifier: Apache-2.0
"""A CSV of the triggers that the sound node took, and how long before their time."""

from pathlib import Path

from eol_ros.errors import ConfigError

COLUMNS = ('felt', 'stamp_ns', 'block', 'grain', 'came_ns', 'taken_ns', 'spare_s')


class TriggerLog:
    """Writes a row of `COLUMNS` at a time, at once; sound goes on where that fails.

    `trouble` then says why, and no further row is written. Raises ConfigError where the file cannot
    be made.
    """

    def __init__(self, path: str | Path):
        self.path, self.trouble = Path(path), ''
        try:
            self._file = self.path.open('w', buffering=1, encoding='utf-8')
        except OSError as error:
            raise ConfigError(
                f'trigger_log: {path}: {error.strerror}; give a file that can be written'
            ) from None
        self.write(*COLUMNS)

    def write(self, *row: object) -> None:
        """Add a row; its fields are `COLUMNS`."""
        if self.trouble:
            return
        try:
            print(*row, sep=',', file=self._file)
        except OSError as error:
            self.trouble = f'trigger_log ends: {self.path}: {error.strerror}'

    def close(self) -> None:
        """Close the file."""
        try:
            self._file.close()
        except OSError as error:  # of what was not written yet
            self.trouble = f'trigger_log ends: {self.path}: {error.strerror}'
