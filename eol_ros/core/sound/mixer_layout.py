# SPDX-License-Identifier: Apache-2.0
"""The memory of the mixer: flat arrays that a compiled callback reaches through one address.

A sound card calls back from a thread that must never wait for Python. So everything that the mixer
knows lies in numpy arrays whose addresses stand in one table of int64; compiled code gets the
address of that table and views the arrays in place, and Python reads the same arrays.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from eol_ros.core.compiled import njit
from eol_ros.core.sound.grain_filter import TABLE
from eol_ros.core.sound.lanes import WIDTH
from eol_ros.core.sound.room import LINES, SPAN
from eol_ros.core.sound.triggers import MAX_RATE

CHUNK = 512  # frames mixed in one go: two channels of it and a scratch row stay in the L1 cache
ROOM = CHUNK + WIDTH  # what is written behind the last frame, up to a whole vector, is unused
GUARD = int(WIDTH * MAX_RATE) + 4  # zeros about each sound: voices read in whole vectors
RING = 4096  # triggers on their way to the callback
WINDOWS = 300  # of 100 ms: the 30 s that the loudness governor looks back
LOADS = 512  # callbacks whose load is remembered
FOREVER = 2**62

VOICE = np.dtype(
    [
        ('time_s', 'f8'),  # when it is to begin, on the engine's time axis
        ('start', 'i8'),  # the same as a frame number
        ('length', 'i8'),  # frames from the first zero of its envelope to the last
        ('attack', 'i8'),  # frames of the rising edge
        ('release', 'i8'),  # frames of the falling edge
        ('steal', 'i8'),  # frame at which a fade-out for others begins; FOREVER if none
        ('source', 'i8'),  # address of the float32 samples that it reads
        ('rate', 'f8'),  # source samples a frame
        ('channel_a', 'i8'),  # the two loudspeakers between which it stands, as rows of the mix
        ('channel_b', 'i8'),
        ('gain_a', 'f4'),
        ('gain_b', 'f4'),
        ('tuning', 'f8'),  # gain of the integrators of its filter; 0: it has none
        ('damping', 'f8'),  # of that, 1 / Q
        ('band', 'i8'),  # 1: a band-pass, 0: a low-pass
    ],
    align=True,
)

STATE = np.dtype(
    [
        # fixed at the start
        ('sample_rate', 'f8'),
        ('channels', 'i8'),
        ('max_voices', 'i8'),
        ('capacity', 'i8'),  # voices with those that are fading out
        ('ingest', 'i8'),  # triggers taken from the ring in one call at most
        ('steal_frames', 'i8'),  # of the fade-out of a voice that makes room
        ('look_ahead', 'i8'),  # frames that the limiter delays by
        ('buses', 'i8'),  # of grains that are filtered together, beside the mix; 0: there are none
        ('history', 'i8'),  # frames of output that are remembered
        ('ceiling', 'f8'),  # the limiter's
        ('release', 'f8'),  # of the limiter: share of the way to 1 made in a frame
        ('dc_pole', 'f8'),
        ('loudness', 'f8'),  # LUFS that the governor holds
        ('governor_range', 'f8'),  # dB that it may take away
        ('line_size', 'i8'),  # samples of a line of the room
        ('room_tail', 'i8'),  # frames until the room has decayed; 0: there is no room
        # targets: Python writes, the callback reads
        ('gain_target', 'f8'),
        ('fade_target', 'f8'),  # 0 silent, 1 open
        ('fade_step', 'f8'),  # share of a fade made in a frame
        ('ring_head', 'i8'),
        ('card', 'i8'),  # 1 while a sound card may render; one that is given up hears silence
        ('busy', 'i8'),  # 1 while a sound card renders: no other thread may then
        # the callback's own
        ('ring_tail', 'i8'),
        ('frame', 'i8'),  # frames made so far
        ('voices', 'i8'),
        ('pending', 'i8'),
        ('gain', 'f8'),
        ('fade', 'f8'),
        ('governor', 'f8'),  # gain now
        ('governor_step', 'f8'),
        ('governor_db', 'f8'),
        ('lufs', 'f8'),
        ('window_fill', 'i8'),
        ('window_next', 'i8'),
        ('limiter', 'f8'),  # gain now
        ('limiter_least', 'f8'),  # least gain since the last reading
        ('held', 'f8'),
        ('box_sum', 'i8'),
        ('settled', 'i8'),  # frames since the limiter last had to work
        ('queue_first', 'i8'),
        ('queue_count', 'i8'),
        ('room_until', 'i8'),  # frame at which the room has decayed
        ('room_awake', 'i8'),
        # counters
        ('triggers', 'i8'),
        ('late', 'i8'),
        ('dropped', 'i8'),
        ('stolen', 'i8'),
        ('underruns', 'i8'),
        ('callbacks', 'i8'),
        # the clock, see clock.py
        ('epoch', 'f8'),  # where the engine's time axis begins, seconds of the system clock
        ('clock_time', 'f8'),
        ('clock_frame', 'f8'),
        ('clock_period', 'f8'),
        ('clock_since', 'f8'),
        ('clock_locks', 'i8'),
        ('clock_steady', 'i8'),  # 1: frames come at exact times, there is nothing to follow
    ],
    align=True,
)


class Room(NamedTuple):
    """The arrays of the room, empty where there is none."""

    wets: np.ndarray  # (1 + buses,) f4, share of each bus that goes into the room
    send: np.ndarray  # (2, ROOM) f4, what goes into it: of even channels, of odd ones
    delays: np.ndarray  # (LINES,) i8, of the room's lines
    lines: np.ndarray  # (LINES, a power of two) f4
    coefficients: np.ndarray  # (4, LINES) f4, see room.coefficients
    damping: np.ndarray  # (LINES,) f4, state of the low-pass of each line
    turned: np.ndarray  # (2, SPAN, LINES) f4, samples of all lines side by side


class Memory(NamedTuple):
    """The arrays of one mixer, in the order of its table."""

    state: np.ndarray  # (1,) STATE
    voices: np.ndarray  # (capacity,) VOICE, what sounds
    ring: np.ndarray  # (RING,) VOICE, from Python to the callback
    pending: np.ndarray  # (RING,) VOICE, taken from the ring, sorted by start
    order: np.ndarray  # (capacity,) i8, rows of `voices`: those that sound, then the free ones
    ended: np.ndarray  # (capacity,) i8, room to sort `order` in
    mix: np.ndarray  # (max(2, channels (1 + buses)), ROOM) f4, sums of voices, bus by bus
    scratch: np.ndarray  # (ROOM + WIDTH,) f4, one voice, and what its filter comes to again
    delay: np.ndarray  # (channels, look_ahead + CHUNK) f4, the limiter's
    queue_gain: np.ndarray  # (look_ahead + 2,) f8, of its sliding minimum
    queue_frame: np.ndarray  # (look_ahead + 2,) i8
    box: np.ndarray  # (look_ahead + 1,) i8, of its smoothing, gains in units of 2^-40
    filters: np.ndarray  # (channels, 7) f8: DC block x, y; K weighting, two states a stage; energy
    weights: np.ndarray  # (10,) f8, K weighting: b0 b1 b2 a1 a2 of both stages
    windows: np.ndarray  # (WINDOWS,) f8, energies of the last 30 s
    past: np.ndarray  # (history, channels) f4, ring of what was put out
    loads: np.ndarray  # (LOADS,) f8, ring of the share of its time that a callback took
    timespec: np.ndarray  # (2,) i8, for the clock
    poles: np.ndarray  # (1 + buses,) f8, of the two low-passes of each bus; that of the mix unused
    summed: np.ndarray  # (channels (1 + buses),) i8, rows of `mix` into which a voice was summed
    passes: np.ndarray  # (channels (1 + buses), 3) f8, state of each row's low- and high-passes
    highs: np.ndarray  # (1 + buses,) f8, pole of the high-pass of each bus; 1: there is none
    tables: np.ndarray  # (capacity, TABLE) f4, of the filters of `voices`, see grain_filter.py
    room: Room


ARRAYS = len((*Memory._fields[:-1], *Room._fields))
_intrinsic: Any = intrinsic


@_intrinsic
def pointer(typing_context, address):
    """Turn an int64 into a pointer, which numba has no word for."""

    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), codegen


@_intrinsic
def fence(typing_context):
    """Order the memory accesses before and after it, as the other threads see them too."""

    def codegen(context, builder, signature, args):
        builder.fence('seq_cst')
        return context.get_dummy_value()

    return types.void(), codegen


@njit(cache=True)
def memory(address):
    """View the arrays whose table stands at `address`."""
    t = carray(pointer(address), ARRAYS, np.int64)
    state = carray(pointer(t[0]), 1, STATE)
    s = state[0]
    c, look_ahead, rows = s.channels, s.look_ahead, s.channels * (1 + s.buses)
    return Memory(
        state,
        carray(pointer(t[1]), s.capacity, VOICE),
        carray(pointer(t[2]), RING, VOICE),
        carray(pointer(t[3]), RING, VOICE),
        carray(pointer(t[4]), s.capacity, np.int64),
        carray(pointer(t[5]), s.capacity, np.int64),
        carray(pointer(t[6]), (max(2, rows), ROOM), np.float32),
        carray(pointer(t[7]), ROOM + WIDTH, np.float32),
        carray(pointer(t[8]), (c, look_ahead + CHUNK), np.float32),
        carray(pointer(t[9]), look_ahead + 2, np.float64),
        carray(pointer(t[10]), look_ahead + 2, np.int64),
        carray(pointer(t[11]), look_ahead + 1, np.int64),
        carray(pointer(t[12]), (c, 7), np.float64),
        carray(pointer(t[13]), 10, np.float64),
        carray(pointer(t[14]), WINDOWS, np.float64),
        carray(pointer(t[15]), (s.history, c), np.float32),
        carray(pointer(t[16]), LOADS, np.float64),
        carray(pointer(t[17]), 2, np.int64),
        carray(pointer(t[18]), 1 + s.buses, np.float64),
        carray(pointer(t[19]), rows, np.int64),
        carray(pointer(t[20]), (rows, 3), np.float64),
        carray(pointer(t[21]), 1 + s.buses, np.float64),
        carray(pointer(t[22]), (s.capacity, TABLE), np.float32),
        Room(
            carray(pointer(t[23]), 1 + s.buses, np.float32),
            carray(pointer(t[24]), (2, ROOM if s.room_tail else 0), np.float32),
            carray(pointer(t[25]), LINES, np.int64),
            carray(pointer(t[26]), (LINES, s.line_size), np.float32),
            carray(pointer(t[27]), (4, LINES), np.float32),
            carray(pointer(t[28]), LINES, np.float32),
            carray(pointer(t[29]), (2, SPAN if s.room_tail else 0, LINES), np.float32),
        ),
    )


def allocate(
    channels: int,
    capacity: int,
    look_ahead: int,
    history: int,
    buses: int,
    line_size: int,
    room_tail: int,
) -> tuple[Memory, np.ndarray]:
    """Return the zeroed arrays of a mixer and its table, int64: their addresses.

    `memory` defines their shapes: it views a table whose arrays do not exist yet.
    """
    state = np.zeros(1, STATE)
    s = state[0]
    s['channels'], s['capacity'], s['buses'] = channels, capacity, buses
    s['line_size'], s['room_tail'] = line_size, room_tail
    s['look_ahead'], s['history'] = look_ahead, history
    table = np.full(ARRAYS, state.ctypes.data)
    _, *views, room = memory(table.ctypes.data)
    own_room = Room._make(map(np.zeros_like, room))
    arrays = Memory._make([state, *map(np.zeros_like, views), own_room])
    arrays.order[:] = np.arange(capacity)
    arrays.highs[:] = 1
    table[:] = [a.ctypes.data for a in (*arrays[:-1], *arrays.room)]
    return arrays, table
