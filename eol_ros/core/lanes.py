# SPDX-License-Identifier: Apache-2.0
"""Vectors of eight or sixteen float32, or of eight float64, in compiled code: `+ - * /`, `fma`.

A compiler turns a loop over arrays into vector code by rules of its own: integers of 64 bits or
places that are gathered may cost all that the vectors gain, and what does not fill one goes through
scalar code. Here both the width and each operation are written down. On AVX-512 sixteen are one
register, on AVX2 two of eight, on SSE or NEON four; a lane never looks at its neighbours, and a
product and a sum are fused where `fma` says so only. So the bits are the same on every processor
that has a fused multiply-add, however wide its vectors are.
"""

import operator
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

ir = cgutils.ir
FLOAT, DOUBLE, I32, I64 = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)
njit_intrinsic: Any = intrinsic


class Lanes(types.Type):
    """So many float32 or float64."""

    def __init__(self, width: int, element: Any = FLOAT) -> None:
        super().__init__(name=f'Lanes{width}{element}')
        self.width, self.element = width, element


eight, sixteen, doubles = Lanes(8), Lanes(16), Lanes(8, DOUBLE)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(kind.element, kind.width))


def _operator(function, build: str) -> None:
    @infer_global(function)
    class _Typing(ConcreteTemplate):
        cases = [signature(kind, kind, kind) for kind in (eight, sixteen, doubles)]

    @lower_builtin(function, Lanes, Lanes)
    def _lower(context, builder, sig, args):
        return getattr(builder, build)(*args)


_operator(operator.add, 'fadd')
_operator(operator.sub, 'fsub')
_operator(operator.mul, 'fmul')
_operator(operator.truediv, 'fdiv')


def pointer(builder, address, kind):
    """Return the address as a pointer to `kind`."""
    return builder.inttoptr(address, kind.as_pointer())


def shuffle(builder, a, b, places):
    """Return the lanes `places` of a and b, one behind the other."""
    kind = ir.VectorType(I32, len(places))
    return builder.shuffle_vector(a, b, ir.Constant(kind, list(places)))


def spread(builder, number, kind):
    """Return a vector of `kind` that holds `number` in every lane."""
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), number, ir.Constant(I32, 0))
    return shuffle(builder, one, one, [0] * kind.count)


def _call(builder, name, *args):
    kind = args[0].type
    function = ir.FunctionType(kind, [kind] * len(args))
    name = f'llvm.{name}.v{kind.count}f{32 if kind.element == FLOAT else 64}'
    return builder.call(cgutils.get_or_insert_function(builder.module, function, name), args)


def multiply_add(builder, *args):
    """Return a * b + c."""
    return _call(builder, 'fmuladd', *args)


def transposed(builder, rows):
    """Return four vectors of eight from eight rows of four."""
    pairs = [shuffle(builder, rows[k], rows[k + 4], range(8)) for k in range(4)]
    low, high = (0, 8, 1, 9, 4, 12, 5, 13), (2, 10, 3, 11, 6, 14, 7, 15)
    mixed = [shuffle(builder, pairs[i], pairs[i + 1], h) for h in (low, high) for i in (0, 2)]
    first, second = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)
    return [shuffle(builder, mixed[i], mixed[i + 1], h) for i in (0, 2) for h in (first, second)]


def _splat(kind, number_kind=types.float32):
    @njit_intrinsic
    def splat(typing_context, number):
        """Return `number` in all lanes."""

        def codegen(context, builder, sig, args):
            return spread(builder, args[0], context.get_value_type(kind))

        return kind(number_kind), codegen

    return splat


splat, splat8 = _splat(sixteen), _splat(eight)
splat_double = _splat(doubles, types.float64)


@njit_intrinsic
def fma(typing_context, a, b, c):
    """Return a * b + c, rounded once; twice on processors that cannot."""

    def codegen(context, builder, sig, args):
        return multiply_add(builder, *args)

    return a(a, b, c), codegen


@njit_intrinsic
def less(typing_context, c, a, b):
    """Return c - a * b, rounded once; twice on processors that cannot."""

    def codegen(context, builder, sig, args):
        return multiply_add(builder, builder.fneg(args[1]), args[2], args[0])

    return c(c, a, b), codegen


@njit_intrinsic
def least(typing_context, a, b):
    """Return the lesser of `a` and `b` in each lane."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered('<', *args), *args)

    return a(a, b), codegen


@njit_intrinsic
def most(typing_context, a, b):
    """Return the greater of `a` and `b` in each lane."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered('>', *args), *args)

    return a(a, b), codegen


@njit_intrinsic
def above(typing_context, a, b, then, otherwise):
    """Return in each lane `then` where a > b, else `otherwise`."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered('>', args[0], args[1]), args[2], args[3])

    return a(a, b, then, otherwise), codegen


@njit_intrinsic
def magnitude(typing_context, a):
    """Return the absolute value in each lane."""

    def codegen(context, builder, sig, args):
        return _call(builder, 'fabs', args[0])

    return a(a), codegen


@njit_intrinsic
def whole(typing_context, a):
    """Return `a` in each lane without what is behind its point; it must fit an int32."""

    def codegen(context, builder, sig, args):
        kind = ir.VectorType(I32, sig.return_type.width)
        return builder.sitofp(builder.fptosi(args[0], kind), args[0].type)

    return a(a), codegen


@njit_intrinsic
def signed(typing_context, a, b):
    """Return `a` in each lane, with its sign changed where b is negative."""

    def codegen(context, builder, sig, args):
        kind = ir.VectorType(I32, sig.return_type.width)
        a, b = (builder.bitcast(value, kind) for value in args)
        sign = builder.and_(b, ir.Constant(kind, [-(2**31)] * kind.count))
        return builder.bitcast(builder.xor(a, sign), args[0].type)

    return a(a, b), codegen


@njit_intrinsic
def all_below(typing_context, a, b):
    """Return whether a < b in every lane."""

    def codegen(context, builder, sig, args):
        width = sig.args[0].width
        bits = builder.bitcast(builder.fcmp_ordered('<', *args), ir.IntType(width))
        return builder.icmp_unsigned('==', bits, ir.Constant(ir.IntType(width), -1))

    return types.boolean(a, b), codegen


@njit_intrinsic
def added(typing_context, a):
    """Return the sum of all lanes, float32: of halves, then of halves of these."""

    def codegen(context, builder, sig, args):
        x, width = args[0], sig.args[0].width
        while width > 1:
            width //= 2
            low, high = (shuffle(builder, x, x, range(k, k + width)) for k in (0, width))
            x = builder.fadd(low, high)
        return builder.extract_element(x, ir.Constant(I32, 0))

    return types.float32(a), codegen


def _place(context, builder, sig, args, kind):
    """Return a pointer to the lanes that begin at column args[2] of row args[1] of args[0]."""
    array = context.make_array(sig.args[0])(context, builder, args[0])
    columns = builder.extract_value(array.shape, 1)
    at = builder.gep(array.data, [builder.add(builder.mul(args[1], columns), args[2])])
    return builder.bitcast(at, kind.as_pointer())


@njit_intrinsic
def take(typing_context, rows, row, column):
    """Return eight numbers of an array (n, m), contiguous: from rows[row, column] on."""

    def codegen(context, builder, sig, args):
        kind = context.get_value_type(sig.return_type)
        return builder.load(_place(context, builder, sig, args, kind), align=4)

    kind = eight if rows.dtype == types.float32 else doubles
    return kind(rows, types.int64, types.int64), codegen


@njit_intrinsic
def look(typing_context, pixels, places, first, by):
    """Return eight of `pixels` (n,) uint8, at places[first:] (int32), each `by` further on."""

    def codegen(context, builder, sig, args):
        pixels, places = (
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(sig.args[:2], args[:2], strict=True)
        )
        found = ir.Constant(ir.VectorType(ir.IntType(8), 8), ir.Undefined)
        for k in range(8):
            at = builder.gep(places, [builder.add(args[2], ir.Constant(I64, k))])
            at = builder.add(builder.sext(builder.load(at), I64), args[3])
            pixel = builder.load(builder.gep(pixels, [at]))
            found = builder.insert_element(found, pixel, ir.Constant(I32, k))
        return builder.uitofp(found, context.get_value_type(eight))

    return eight(pixels, places, types.int64, types.int64), codegen


def _indices(builder, index):
    """Yield the lanes of `index` as int64."""
    whole = builder.fptosi(index, ir.VectorType(I32, index.type.count))
    for k in range(index.type.count):
        yield builder.sext(builder.extract_element(whole, ir.Constant(I32, k)), I64)


@njit_intrinsic
def pluck(typing_context, values, index):
    """Return values[index] of an array (n,); index: whole numbers that float32 can hold."""

    def codegen(context, builder, sig, args):
        first = context.make_array(sig.args[0])(context, builder, args[0]).data
        found = ir.Constant(args[1].type, ir.Undefined)
        for k, at in enumerate(_indices(builder, args[1])):
            value = builder.load(builder.gep(first, [at]))
            found = builder.insert_element(found, value, ir.Constant(I32, k))
        return found

    return index(values, index), codegen


@njit_intrinsic
def pluck_rows(typing_context, rows, index):
    """Return the four columns of rows[index], a vector each; index: as of pluck."""

    def codegen(context, builder, sig, args):
        first = context.make_array(sig.args[0])(context, builder, args[0]).data
        found = []
        for at in _indices(builder, args[1]):
            place = builder.gep(first, [builder.mul(at, ir.Constant(I64, 4))])
            place = builder.bitcast(place, ir.VectorType(FLOAT, 4).as_pointer())
            found.append(builder.load(place, align=4))
        return context.make_tuple(builder, sig.return_type, transposed(builder, found))

    return types.UniTuple(index, 4)(rows, index), codegen


@njit_intrinsic
def put(typing_context, rows, row, column, x):
    """Write `x` to an array (n, m), contiguous: from rows[row, column] on."""

    def codegen(context, builder, sig, args):
        builder.store(args[3], _place(context, builder, sig, args, args[3].type), align=4)
        return context.get_dummy_value()

    return types.void(rows, types.int64, types.int64, x), codegen


@njit_intrinsic
def add_products(typing_context, sums, weight, values, other_weight, other_values):
    """Add to sums (n, 8) the products of weight with all pairs of values, two vectors of each.

    Of the upper triangle of all values but the last row by row, then of these with the last.
    """
    count = len(values) - 1

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        lanes = args[1].type
        first = builder.bitcast(array.data, lanes.as_pointer())
        two = [
            (args[w], [builder.extract_value(args[w + 1], i) for i in range(count + 1)])
            for w in (1, 3)
        ]
        k = 0
        for i in range(count):
            weighted = [(builder.fmul(weight, values[i]), values) for weight, values in two]
            for j in range(i, count + 1):
                at = k if j < count else count * (count + 1) // 2 + i
                k += j < count
                place = builder.gep(first, [ir.Constant(I64, at)])
                total = builder.load(place, align=4)
                for by, values in weighted:
                    total = multiply_add(builder, by, values[j], total)
                builder.store(total, place, align=4)
        return context.get_dummy_value()

    return types.void(sums, weight, values, other_weight, other_values), codegen


@njit_intrinsic
def add_weighted(typing_context, sums, weight, values):
    """Add weight * values[i] to row i of sums (m, 8), for the first m of m + 1 values."""

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        first = builder.bitcast(array.data, args[1].type.as_pointer())
        for i in range(len(values) - 1):
            place = builder.gep(first, [ir.Constant(I64, i)])
            total = builder.load(place, align=4)
            total = multiply_add(builder, args[1], builder.extract_value(args[2], i), total)
            builder.store(total, place, align=4)
        return context.get_dummy_value()

    return types.void(sums, weight, values), codegen
