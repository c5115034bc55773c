# SPDX-License-Identifier: Apache-2.0
"""What the writer asks of a disk, in one place: so a test can put one below it that forgets.

Bytes that were written are the operating system's until they are synchronised, and so is the name
of a file until its folder is: a power cut may undo either (man 2 fsync).
"""

import os
from pathlib import Path
from typing import BinaryIO


class Disk:
    """The file system; every method may raise OSError."""

    def create(self, path: Path) -> BinaryIO:
        """Return a new file, open for writing."""
        return open(path, 'xb')

    def sync(self, file: BinaryIO) -> None:
        """Return when all that was written to `file` survives a power cut."""
        file.flush()
        os.fdatasync(file.fileno())

    def sync_folder(self, folder: Path) -> None:
        """Return when the names in `folder` survive a power cut."""
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def rename(self, old: Path, new: Path) -> None:
        """Give `old`, which is synchronised, the name `new` for good."""
        os.replace(old, new)
        self.sync_folder(new.parent)

    def write_text(self, path: Path, text: str) -> None:
        """Write `text` to `path`, whole or not at all."""
        part = path.with_name(path.name + '.tmp')
        part.unlink(missing_ok=True)
        with self.create(part) as file:
            file.write(text.encode())
            self.sync(file)
        self.rename(part, path)


DISK = Disk()
