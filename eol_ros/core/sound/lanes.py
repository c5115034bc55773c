# SPDX-License-Identifier: Apache-2.0
"""What sound does with vectors of sixteen float32, beside `core.lanes`: load, store, resample."""

from numba import types
from numba.core import errors

from eol_ros.core.lanes import (
    FLOAT,
    I32,
    I64,
    fma,
    ir,
    least,
    multiply_add,
    njit_intrinsic,
    pointer,
    shuffle,
    sixteen,
    splat,
    spread,
    transposed,
)

__all__ = ['fma', 'least', 'splat']
WIDTH = sixteen.width
_FLOATS, _INTS = ir.VectorType(FLOAT, WIDTH), ir.VectorType(I32, WIDTH)
_FOUR = ir.VectorType(FLOAT, 4)
_LANE = ir.Constant(_INTS, list(range(WIDTH)))


@njit_intrinsic
def load(typing_context, address):
    """Return the float32 from `address` on."""

    def codegen(context, builder, sig, args):
        return builder.load(pointer(builder, args[0], _FLOATS), align=4)

    return sixteen(types.int64), codegen


@njit_intrinsic
def store(typing_context, address, x):
    """Write `x` from `address` on."""

    def codegen(context, builder, sig, args):
        builder.store(args[1], pointer(builder, args[0], _FLOATS), align=4)
        return context.get_dummy_value()

    return types.void(types.int64, sixteen), codegen


@njit_intrinsic
def count_from(typing_context, first):
    """Return first, first + 1, ..., first + 15; `first` is an int32."""

    def codegen(context, builder, sig, args):
        return builder.sitofp(builder.add(spread(builder, args[0], _INTS), _LANE), _FLOATS)

    return sixteen(types.int32), codegen


@njit_intrinsic
def keep(typing_context, x, count):
    """Return the first `count` (int32) lanes of `x` and zeros behind them."""

    def codegen(context, builder, sig, args):
        x, count = args
        kept = builder.icmp_signed('<', _LANE, spread(builder, count, _INTS))
        return builder.select(kept, x, ir.Constant(_FLOATS, None))

    return sixteen(sixteen, types.int32), codegen


@njit_intrinsic
def fractions(typing_context, place, step):
    """Return what is behind the point of place + lane * step, int64 with 32 bits behind it."""

    def codegen(context, builder, sig, args):
        place, step = (spread(builder, builder.trunc(a, I32), _INTS) for a in args)
        bits = builder.add(place, builder.mul(step, _LANE))
        bits = builder.lshr(bits, ir.Constant(_INTS, [1] * WIDTH))  # room for a sign
        unit = ir.Constant(_FLOATS, [ir.Constant(FLOAT, 2.0**-31)] * WIDTH)
        return builder.fmul(builder.sitofp(bits, _FLOATS), unit)

    return sixteen(types.int64, types.int64), codegen


@njit_intrinsic
def around(typing_context, address, place, step):
    """Return the float32 before, at, one and two behind the whole part of place + lane * step.

    Places are int64 with 32 bits behind the point, not negative, and count from `address`. Each
    lane loads its four in one go, and they are transposed in registers: that is several times as
    fast as gathering them one by one, which is what compilers do.
    """

    def codegen(context, builder, sig, args):
        address, place, step = args
        begin = pointer(builder, builder.sub(address, ir.Constant(I64, 4)), FLOAT)
        rows = []
        for _ in range(WIDTH):
            at = builder.gep(begin, [builder.lshr(place, ir.Constant(I64, 32))])
            rows.append(builder.load(builder.bitcast(at, _FOUR.as_pointer()), align=4))
            place = builder.add(place, step)
        halves = zip(transposed(builder, rows[:8]), transposed(builder, rows[8:]), strict=True)
        columns = [shuffle(builder, a, b, range(16)) for a, b in halves]
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(sixteen, 4)(types.int64, types.int64, types.int64), codegen


@njit_intrinsic
def butterfly(typing_context, x, stride):
    """Return the sums and differences of lanes `stride` apart: a step of a Hadamard transform.

    Lane j becomes x[j] + x[j + stride] where bit `stride` (a literal) of j is clear, and
    x[j - stride] - x[j] where it is set.
    """
    if not isinstance(stride, types.IntegerLiteral):
        raise errors.RequireLiteralValue('stride')
    step = stride.literal_value

    def codegen(context, builder, sig, args):
        lanes_of = range(WIDTH)
        swapped = shuffle(builder, args[0], args[0], [j ^ step for j in lanes_of])
        signs = [ir.Constant(FLOAT, -1.0 if j & step else 1.0) for j in lanes_of]
        signed = builder.fmul(args[0], ir.Constant(_FLOATS, signs))  # exact, so no step is fused
        return builder.fadd(swapped, signed)

    return sixteen(sixteen, stride), codegen


@njit_intrinsic
def convolve(typing_context, row, response):
    """Return what sixteen float32 from address `row` make of a response at rest, cut to sixteen.

    Lane k is the sum over j <= k of row[j] response[k - j]; fifteen zeros stand before `response`,
    an address too. The four sums of every fourth j do not wait for each other.
    """

    def codegen(context, builder, sig, args):
        row, response = args
        sums = []
        for j in range(WIDTH):
            at = builder.add(row, ir.Constant(I64, 4 * j))
            sample = spread(builder, builder.load(pointer(builder, at, FLOAT)), _FLOATS)
            begin = builder.sub(response, ir.Constant(I64, 4 * j))
            late = builder.load(pointer(builder, begin, _FLOATS), align=4)
            if j < 4:
                sums.append(builder.fmul(sample, late))
            else:
                sums[j % 4] = multiply_add(builder, sample, late, sums[j % 4])
        return builder.fadd(builder.fadd(sums[0], sums[1]), builder.fadd(sums[2], sums[3]))

    return sixteen(types.int64, types.int64), codegen
