# SPDX-License-Identifier: Apache-2.0
"""An identity of this machine that outlives restarts: a MAC may be random, or change."""

import uuid

from eol_ros import folders
from eol_ros.disk import DISK, read
from eol_ros.errors import writing

FILE = 'machine-id'


def machine_id() -> uuid.UUID:
    """Return a random id, kept in the state folder; raise ConfigError if it cannot be written."""
    path = folders.state() / FILE
    found = read(path, lambda content: uuid.UUID(content.decode().strip()))
    if found is None:
        found = uuid.uuid4()
        with writing(path):
            DISK.write(path, f'{found}\n')
    return found
