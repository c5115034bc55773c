# SPDX-License-Identifier: Apache-2.0
"""Reading a sound between its samples, eight outputs at a time.

Each output needs four neighbouring samples from a place of its own. Compilers gather them one by
one; here each output loads its four in one go and the eight loads are transposed in registers,
which is between three and four times as fast. It is plain LLVM vector code, for any processor.
"""

from typing import Any

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from eol_ros.core.sound.envelope import FAST

WIDTH = 8
_ir = cgutils.ir
_FLOAT, _I32, _I64 = _ir.FloatType(), _ir.IntType(32), _ir.IntType(64)
_FOUR, _EIGHT = _ir.VectorType(_FLOAT, 4), _ir.VectorType(_FLOAT, WIDTH)
_FLAGS = tuple(sorted(FAST))


def _lanes(*numbers: int):
    return _ir.Constant(_ir.VectorType(_I32, len(numbers)), list(numbers))


def _transposed(builder, rows):
    """Return four vectors of eight from eight rows of four."""
    pairs = [builder.shuffle_vector(rows[k], rows[k + 4], _lanes(*range(8))) for k in range(4)]
    low, high = _lanes(0, 8, 1, 9, 4, 12, 5, 13), _lanes(2, 10, 3, 11, 6, 14, 7, 15)
    mixed = [
        builder.shuffle_vector(pairs[i], pairs[i + 1], half) for half in (low, high) for i in (0, 2)
    ]
    first, second = _lanes(0, 1, 8, 9, 4, 5, 12, 13), _lanes(2, 3, 10, 11, 6, 7, 14, 15)
    return [
        builder.shuffle_vector(mixed[i], mixed[i + 1], half)
        for i in (0, 2)
        for half in (first, second)
    ]


def _taps(formula) -> Any:
    """Return what writes eight float32 to `out`: `formula` of the samples around each place.

    Arguments are addresses: of out (8,) f4, of sample 0 of the source, of index (8,) i4 and of
    fraction (8,) f4. Samples index - 1 .. index + 2 are read.
    """

    def signature(typing_context, out, source, index, fraction):
        def codegen(context, builder, sig, args):
            out, source, index, fraction = args

            def load(address, kind):
                return builder.load(builder.inttoptr(address, kind.as_pointer()), align=4)

            rows = []
            for k in range(WIDTH):
                i = load(builder.add(index, _ir.Constant(_I64, 4 * k)), _I32)
                bytes_ = builder.shl(builder.sext(i, _I64), _ir.Constant(_I64, 2))
                begin = builder.sub(builder.add(source, bytes_), _ir.Constant(_I64, 4))
                rows.append(load(begin, _FOUR))
            y = formula(_Algebra(builder), *_transposed(builder, rows), load(fraction, _EIGHT))
            builder.store(y, builder.inttoptr(out, _EIGHT.as_pointer()), align=4)
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, types.int64, types.int64), codegen

    return intrinsic(signature)


class _Algebra:
    """Vector arithmetic with the flags of `FAST`."""

    def __init__(self, builder):
        self._builder = builder

    def add(self, a, b):
        return self._builder.fadd(a, b, flags=_FLAGS)

    def sub(self, a, b):
        return self._builder.fsub(a, b, flags=_FLAGS)

    def times(self, number, a):
        constant = _ir.Constant(_EIGHT, [_ir.Constant(_FLOAT, number)] * WIDTH)
        return self.mul(constant, a)

    def mul(self, a, b):
        return self._builder.fmul(a, b, flags=_FLAGS)


def _line(v, _a, b, c, _d, f):
    return v.add(b, v.mul(f, v.sub(c, b)))


def _cubic(v, a, b, c, d, f):
    """The cubic through b and c with the slopes of their neighbours (Catmull and Rom 1974)."""
    c1 = v.times(0.5, v.sub(c, a))
    c2 = v.sub(v.add(v.sub(a, v.times(2.5, b)), v.times(2.0, c)), v.times(0.5, d))
    c3 = v.add(v.times(0.5, v.sub(d, a)), v.times(1.5, v.sub(b, c)))
    return v.add(v.mul(v.add(v.mul(v.add(v.mul(c3, f), c2), f), c1), f), b)


_line8, _cubic8 = _taps(_line), _taps(_cubic)


@njit(cache=True, fastmath=FAST)
def _places(index, fraction, rate, first, count):
    for k in range(count):
        p = rate * (first + k)
        i = np.int32(p)
        index[k] = i
        fraction[k] = np.float32(p - i)


@njit(cache=True)
def read(out, source, rate, first, cubic, index, fraction):
    """Read the sound at address `source` at the places rate * (first + k) into `out` (n,) f4.

    `index` i4 and `fraction` f4 are room to work in. They and `out` must have room for n rounded up
    to a multiple of eight; samples from -1 on and up to 2 behind the last place must exist.
    """
    count = out.size
    _places(index, fraction, rate, first, count)
    whole = (count + WIDTH - 1) // WIDTH * WIDTH
    for k in range(count, whole):
        index[k], fraction[k] = index[count - 1], 0.0
    o, i, f = out.ctypes.data, index.ctypes.data, fraction.ctypes.data
    for k in range(0, 4 * whole, 4 * WIDTH):
        if cubic:
            _cubic8(o + k, source, i + k, f + k)
        else:
            _line8(o + k, source, i + k, f + k)
