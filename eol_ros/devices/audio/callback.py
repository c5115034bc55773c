# SPDX-License-Identifier: Apache-2.0
"""What a sound card calls for samples: compiled, so that Python's lock cannot delay it."""

import numpy as np
from numba import carray, types

from eol_ros.core.compiled import cfunc, njit
from eol_ros.core.sound.clock import step_clock
from eol_ros.core.sound.mixer import render
from eol_ros.core.sound.mixer_layout import fence, memory, pointer

OUTPUT_UNDERFLOW = 4  # paOutputUnderflow of portaudio.h
CLOCK_REALTIME, CLOCK_MONOTONIC = 0, 1

_clock_gettime = types.ExternalFunction('clock_gettime', types.int32(types.int32, types.voidptr))


@njit(cache=True)
def _seconds(timespec, clock, epoch):
    """Return seconds of a POSIX clock since `epoch`; `timespec` (2,) i8 is room for the answer."""
    _clock_gettime(clock, pointer(timespec.ctypes.data))
    return (timespec[0] - epoch) + 1e-9 * timespec[1]


@njit(cache=True, nogil=True)
def turn(address, out, flags):
    """Fill `out` (frames, channels) f4 from the mixer at `address`, keep its clock and counters."""
    m = memory(address)
    s = m.state[0]
    begun = _seconds(m.timespec, CLOCK_MONOTONIC, 0.0)
    step_clock(s, _seconds(m.timespec, CLOCK_REALTIME, s.epoch))
    if flags & OUTPUT_UNDERFLOW:
        s.underruns += 1
        s.clock_since = 0.0  # frames are missing: let the clock follow quickly again
    render(address, out)
    taken = _seconds(m.timespec, CLOCK_MONOTONIC, 0.0) - begun
    if out.shape[0]:
        m.loads[s.callbacks % m.loads.size] = taken * s.sample_rate / out.shape[0]
        s.callbacks += 1


@njit(cache=True, nogil=True)
def serve(address, out, flags):
    """A card asks: as `turn`, but silence if the mixer is not the card's (any more).

    `busy` is up before `card` is looked at, so a thread that takes `card` down and finds
    `busy` down has the mixer for itself.
    """
    s = memory(address).state[0]
    s.busy = 1
    fence()
    if s.card:
        turn(address, out, flags)
    else:
        out[:] = 0
    fence()
    s.busy = 0


@cfunc(
    types.intc(types.voidptr, types.voidptr, types.ulong, types.voidptr, types.ulong, types.voidptr)
)
def callback(_inputs, output, frames, _times, flags, table):
    """PaStreamCallback of portaudio.h; `table` is the mixer's table of addresses."""
    address = np.int64(carray(table, 1, np.int64).ctypes.data)  # as from Python: compiled once
    out = carray(output, (frames, memory(address).state[0].channels), np.float32)
    serve(address, out, np.int64(flags))
    return 0  # paContinue
