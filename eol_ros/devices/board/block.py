# SPDX-License-Identifier: Apache-2.0
"""The firmware that runs in a block, here on the host: firmware/block/knock.h, loaded with ctypes.

It is compiled with the package (setup.py), and only the twin and the tests load it.
"""

import ctypes
from functools import cache
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from eol_ros.errors import DeviceMissing

UNIT_MPS2 = 9.80665e-3 / 16  # of a sample: 1/16 mg
FELT, TOLD, IDLE = 1, 2, 3
LEARNS, RESTS, FEELS, MOVES = range(4)
WINDOW = 16  # samples
LEARN = 512
MISSING = (
    'the firmware of the blocks was not compiled when eol_ros was installed, so the twin feels no'
    ' knocks: sudo apt-get install g++, and install eol_ros again (in a checkout: make setup)'
)


class Config(ctypes.Structure):
    """Of the detector; see eol_knock_config."""

    _fields_ = [
        ('threshold', ctypes.c_uint16),
        ('ratio', ctypes.c_uint16),
        ('quiet', ctypes.c_uint16),
        ('slow', ctypes.c_uint16),
        ('still', ctypes.c_uint16),
        ('longest', ctypes.c_uint16),
        ('idle', ctypes.c_uint32),
    ]


class _Knock(ctypes.Structure):
    """The part of eol_knock that is read here."""

    _fields_ = [
        ('config', Config),
        ('strength', ctypes.c_uint16),
        ('age', ctypes.c_uint16),
        ('first', ctypes.c_uint8),
        ('state', ctypes.c_uint8),
        ('dead', ctypes.c_uint8),
    ]


class _Event(ctypes.Structure):
    _fields_ = [
        ('sample', ctypes.c_uint32),
        ('strength', ctypes.c_uint16),
        ('age', ctypes.c_uint16),
        ('what', ctypes.c_uint8),
        ('first', ctypes.c_uint8),
    ]


class Event(NamedTuple):
    """FELT, TOLD or IDLE at the sample given; of what is TOLD, how hard, m/s^2, how many samples
    before the end of that sample it began, and whether it woke the block.
    """

    what: int
    sample: int
    strength_mps2: float
    age_samples: float
    first: bool


def defaults() -> Config:
    """Return a copy of EOL_KNOCK_DEFAULTS; raises DeviceMissing as `Detector` does."""
    return Config.from_buffer_copy(Config.in_dll(library(), 'EOL_KNOCK_DEFAULTS'))


class Detector:
    """What one block runs.

    Raises DeviceMissing where the firmware was not compiled.
    """

    def __init__(self, config: Config | None = None):
        self._lib = library()
        self._memory = ctypes.create_string_buffer(self._lib.eol_knock_size())
        self._knock = ctypes.cast(self._memory, ctypes.POINTER(_Knock)).contents
        self._events = (_Event * 64)()
        self.config = config or defaults()
        self._lib.eol_knock_begin(self._memory, ctypes.byref(self.config))

    def feed(self, samples: np.ndarray) -> list[Event]:
        """Take samples (n, 2) of int16, 1/16 mg; return what they bring."""
        samples = np.ascontiguousarray(samples, np.int16)
        if samples.ndim != 2 or samples.shape[1] != 2:
            raise ValueError(f'samples of shape {samples.shape}; they must be (n, 2)')
        found = self._lib.eol_knock_batch(
            self._memory, samples.ctypes.data, len(samples), self._events, len(self._events)
        )
        return [
            Event(
                e.what, e.sample, e.strength * UNIT_MPS2, e.age / 16, e.what == TOLD and e.first > 0
            )
            for e in self._events[:found]
        ]

    def wake(self) -> None:
        """Go on after a sleep."""
        self._lib.eol_knock_wake(self._memory)

    @property
    def running(self) -> Config:
        """What it goes by; to be changed while it runs."""
        return self._knock.config

    @property
    def limit_mg(self) -> float:
        """The threshold as it is now: that of the noise, where it is greater."""
        return self._lib.eol_knock_limit(self._memory) / 16

    @property
    def state(self) -> int:
        """LEARNS, RESTS, FEELS or MOVES."""
        return self._knock.state

    @property
    def dead(self) -> bool:
        """Whether the sensor repeats one value."""
        return bool(self._knock.dead)


def compiled() -> bool:
    """Whether the firmware was compiled with the package."""
    return find_spec('eol_ros.devices.board._block') is not None


@cache
def library() -> ctypes.CDLL:
    """Return what was compiled; raises DeviceMissing."""
    found = find_spec('eol_ros.devices.board._block')
    if found is None or found.origin is None:
        raise DeviceMissing(MISSING)
    lib = ctypes.CDLL(found.origin)
    memory, size = ctypes.c_void_p, ctypes.c_size_t
    try:
        lib.eol_knock_size.restype = size
        lib.eol_knock_batch.argtypes = [memory, memory, size, memory, size]
        lib.eol_knock_batch.restype = size
        lib.eol_knock_begin.argtypes = [memory, memory]
        lib.eol_knock_wake.argtypes = [memory]
        lib.eol_knock_limit.argtypes = [memory]
        lib.eol_knock_limit.restype = ctypes.c_uint16
    except AttributeError:  # what the library lacks
        raise DeviceMissing(
            f'{found.origin} was compiled for another version of eol_ros: install eol_ros again '
            '(in a checkout: make setup)'
        ) from None
    return lib
