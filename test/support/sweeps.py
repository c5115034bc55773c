# SPDX-License-Identifier: Apache-2.0
"""A sweep run to its end by whatever crew a test opens."""

import hashlib

from eol_ros.lab.sweeps import table, work
from eol_ros.lab.sweeps.run import Counts, run


def computed(path, given, opened, on_done=lambda count: None):
    """Run a sweep into `path` with the crew that `opened` yields; return the digest of the file."""
    rows = table.Table(path, given.model, work.version())
    try:
        with opened as crew:
            for count in run(given, rows, crew, Counts()):
                on_done(count)
    finally:
        rows.close()
    return hashlib.sha256(path.read_bytes()).hexdigest()
