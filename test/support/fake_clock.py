# SPDX-License-Identifier: Apache-2.0
"""A system clock of its own for what is started with it: it can be set while that runs."""

import struct
import subprocess
from pathlib import Path

from eol_ros.errors import DeviceMissing


class FakeClock:
    """The true time and an offset, for each process that is started in `environment`."""

    def __init__(self, folder: Path, offset_ns: int = 0):
        """Build the library in `folder`; raises DeviceMissing without a C compiler."""
        library, source = folder / 'fake_clock.so', Path(__file__).with_suffix('.c')
        command = ['cc', '-shared', '-fPIC', '-O1', '-o', str(library), str(source), '-ldl']
        try:
            subprocess.run(command, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError) as error:
            raise DeviceMissing(
                f'a clock that can be set needs a C compiler (gcc): {error}'
            ) from None
        self._file = folder / 'clock_offset'
        self._file.write_bytes(struct.pack('<q', offset_ns))
        self.environment = {'LD_PRELOAD': str(library), 'FAKE_CLOCK': str(self._file)}

    def set(self, offset_ns: int) -> None:
        """Step the clock to `offset_ns` after the true time."""
        with self._file.open('r+b') as file:  # it is mapped: never shorter
            file.write(struct.pack('<q', offset_ns))
