# SPDX-License-Identifier: Apache-2.0
"""Vectors of sixteen float32 as values in compiled code: `+`, `-`, `*`, `fma`, load, store.

A compiler turns a loop over arrays into vector code by rules of its own: integers of 64 bits or
places that are gathered may cost all that the vectors gain, and what does not fill one goes through
scalar code. Here both the width and each operation are written down. On AVX-512 a value is one
register, on AVX2 two of eight, on SSE or NEON four; a lane never looks at its neighbours, and a
product and a sum are fused where `fma` says so only. So the bits are the same on every processor
that has a fused multiply-add, however wide its vectors are.
"""

import operator
from typing import Any

from numba import types
from numba.core import cgutils, errors
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

WIDTH = 16
_ir = cgutils.ir
_FLOAT, _I32, _I64 = _ir.FloatType(), _ir.IntType(32), _ir.IntType(64)
_FLOATS, _INTS = _ir.VectorType(_FLOAT, WIDTH), _ir.VectorType(_I32, WIDTH)
_FOUR = _ir.VectorType(_FLOAT, 4)
_LANE = _ir.Constant(_INTS, list(range(WIDTH)))
_intrinsic: Any = intrinsic


class Lanes(types.Type):
    """Sixteen float32."""

    def __init__(self) -> None:
        super().__init__(name='Lanes')


lanes = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _FLOATS)


def _operator(function, build: str) -> None:
    @infer_global(function)
    class _Typing(ConcreteTemplate):
        cases = [signature(lanes, lanes, lanes)]

    @lower_builtin(function, lanes, lanes)
    def _lower(context, builder, sig, args):
        return getattr(builder, build)(*args)


_operator(operator.add, 'fadd')
_operator(operator.sub, 'fsub')
_operator(operator.mul, 'fmul')


def _pointer(builder, address, kind):
    return builder.inttoptr(address, kind.as_pointer())


def _shuffle(builder, a, b, places):
    kind = _ir.VectorType(_I32, len(places))
    return builder.shuffle_vector(a, b, _ir.Constant(kind, list(places)))


def _spread(builder, number, kind):
    """Return a vector of `kind` that holds `number` in every lane."""
    one = builder.insert_element(_ir.Constant(kind, _ir.Undefined), number, _ir.Constant(_I32, 0))
    return _shuffle(builder, one, one, [0] * WIDTH)


def _multiply_add(builder, *args):
    kind = _ir.FunctionType(_FLOATS, [_FLOATS] * 3)
    name = f'llvm.fmuladd.v{WIDTH}f32'
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


@_intrinsic
def splat(typing_context, number):
    """Return the float32 `number` in all lanes."""

    def codegen(context, builder, sig, args):
        return _spread(builder, args[0], _FLOATS)

    return lanes(types.float32), codegen


@_intrinsic
def load(typing_context, address):
    """Return the float32 from `address` on."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, args[0], _FLOATS), align=4)

    return lanes(types.int64), codegen


@_intrinsic
def store(typing_context, address, x):
    """Write `x` from `address` on."""

    def codegen(context, builder, sig, args):
        builder.store(args[1], _pointer(builder, args[0], _FLOATS), align=4)
        return context.get_dummy_value()

    return types.void(types.int64, lanes), codegen


@_intrinsic
def fma(typing_context, a, b, c):
    """Return a * b + c, rounded once; twice on processors that cannot."""

    def codegen(context, builder, sig, args):
        return _multiply_add(builder, *args)

    return lanes(lanes, lanes, lanes), codegen


@_intrinsic
def least(typing_context, a, b):
    """Return the lesser of `a` and `b` in each lane."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered('<', *args), *args)

    return lanes(lanes, lanes), codegen


@_intrinsic
def count_from(typing_context, first):
    """Return first, first + 1, ..., first + 15; `first` is an int32."""

    def codegen(context, builder, sig, args):
        return builder.sitofp(builder.add(_spread(builder, args[0], _INTS), _LANE), _FLOATS)

    return lanes(types.int32), codegen


@_intrinsic
def keep(typing_context, x, count):
    """Return the first `count` (int32) lanes of `x` and zeros behind them."""

    def codegen(context, builder, sig, args):
        x, count = args
        kept = builder.icmp_signed('<', _LANE, _spread(builder, count, _INTS))
        return builder.select(kept, x, _ir.Constant(_FLOATS, None))

    return lanes(lanes, types.int32), codegen


@_intrinsic
def fractions(typing_context, place, step):
    """Return what is behind the point of place + lane * step, int64 with 32 bits behind it."""

    def codegen(context, builder, sig, args):
        place, step = (_spread(builder, builder.trunc(a, _I32), _INTS) for a in args)
        bits = builder.add(place, builder.mul(step, _LANE))
        bits = builder.lshr(bits, _ir.Constant(_INTS, [1] * WIDTH))  # room for a sign
        unit = _ir.Constant(_FLOATS, [_ir.Constant(_FLOAT, 2.0**-31)] * WIDTH)
        return builder.fmul(builder.sitofp(bits, _FLOATS), unit)

    return lanes(types.int64, types.int64), codegen


def _transposed(builder, rows):
    """Return four vectors of eight from eight rows of four."""
    pairs = [_shuffle(builder, rows[k], rows[k + 4], range(8)) for k in range(4)]
    low, high = (0, 8, 1, 9, 4, 12, 5, 13), (2, 10, 3, 11, 6, 14, 7, 15)
    mixed = [_shuffle(builder, pairs[i], pairs[i + 1], h) for h in (low, high) for i in (0, 2)]
    first, second = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)
    return [_shuffle(builder, mixed[i], mixed[i + 1], h) for i in (0, 2) for h in (first, second)]


@_intrinsic
def around(typing_context, address, place, step):
    """Return the float32 before, at, one and two behind the whole part of place + lane * step.

    Places are int64 with 32 bits behind the point, not negative, and count from `address`. Each
    lane loads its four in one go, and they are transposed in registers: that is several times as
    fast as gathering them one by one, which is what compilers do.
    """

    def codegen(context, builder, sig, args):
        address, place, step = args
        begin = _pointer(builder, builder.sub(address, _ir.Constant(_I64, 4)), _FLOAT)
        rows = []
        for _ in range(WIDTH):
            at = builder.gep(begin, [builder.lshr(place, _ir.Constant(_I64, 32))])
            rows.append(builder.load(builder.bitcast(at, _FOUR.as_pointer()), align=4))
            place = builder.add(place, step)
        halves = zip(_transposed(builder, rows[:8]), _transposed(builder, rows[8:]), strict=True)
        columns = [_shuffle(builder, a, b, range(16)) for a, b in halves]
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(lanes, 4)(types.int64, types.int64, types.int64), codegen


@_intrinsic
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
        swapped = _shuffle(builder, args[0], args[0], [j ^ step for j in lanes_of])
        signs = [_ir.Constant(_FLOAT, -1.0 if j & step else 1.0) for j in lanes_of]
        signed = builder.fmul(args[0], _ir.Constant(_FLOATS, signs))  # exact, so no step is fused
        return builder.fadd(swapped, signed)

    return lanes(lanes, stride), codegen


@_intrinsic
def total(typing_context, x):
    """Return the sum of all lanes, in each of them."""

    def codegen(context, builder, sig, args):
        x = args[0]
        for step in (8, 4, 2, 1):
            x = builder.fadd(x, _shuffle(builder, x, x, [j ^ step for j in range(WIDTH)]))
        return x

    return lanes(lanes), codegen


@_intrinsic
def convolve(typing_context, row, response):
    """Return what sixteen float32 from address `row` make of a response at rest, cut to sixteen.

    Lane k is the sum over j <= k of row[j] response[k - j]; fifteen zeros stand before `response`,
    an address too. The four sums of every fourth j do not wait for each other.
    """

    def codegen(context, builder, sig, args):
        row, response = args
        sums = []
        for j in range(WIDTH):
            at = builder.add(row, _ir.Constant(_I64, 4 * j))
            sample = _spread(builder, builder.load(_pointer(builder, at, _FLOAT)), _FLOATS)
            begin = builder.sub(response, _ir.Constant(_I64, 4 * j))
            late = builder.load(_pointer(builder, begin, _FLOATS), align=4)
            if j < 4:
                sums.append(builder.fmul(sample, late))
            else:
                sums[j % 4] = _multiply_add(builder, sample, late, sums[j % 4])
        return builder.fadd(builder.fadd(sums[0], sums[1]), builder.fadd(sums[2], sums[3]))

    return lanes(types.int64, types.int64), codegen
