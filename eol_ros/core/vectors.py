# SPDX-License-Identifier: Apache-2.0
"""Inner loops that keep their sums in vector registers; rows of the arrays are lanes abreast.

LLVM makes vectors of a loop over lanes, but then each term passes through memory: the sums of eight
lanes stay in registers only if the loop over the terms is the inner one. That is what these say, in
LLVM's own vectors, which it lowers to what the processor has. Rows must be whole lanes of WIDTH.
"""

from typing import Any

import llvmlite.ir as ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WIDTH = 8
F64, _I32, _I64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
VECTOR = ir.VectorType(F64, WIDTH)


class Code:
    """What the loops are written with."""

    def __init__(self, context: Any, builder: Any, signature: Any, values: Any) -> None:
        self.builder = builder
        self.arrays = {
            i: context.make_array(kind)(context, builder, values[i])
            for i, kind in enumerate(signature.args)
            if isinstance(kind, types.Array)
        }

    def constant(self, number: int) -> Any:
        return ir.Constant(_I64, number)

    def columns(self, i: int) -> Any:
        return self.builder.extract_value(self.arrays[i].shape, 1)

    def _at(self, i: int, row: Any, column: Any) -> Any:
        place = self.builder.add(self.builder.mul(row, self.columns(i)), column)
        return self.builder.gep(self.arrays[i].data, [place])

    def load(self, i: int, row: Any, column: Any) -> Any:
        pointer = self.builder.bitcast(self._at(i, row, column), VECTOR.as_pointer())
        value = self.builder.load(pointer)
        value.align = 8
        return value

    def store(self, value: Any, i: int, row: Any, column: Any) -> None:
        pointer = self.builder.bitcast(self._at(i, row, column), VECTOR.as_pointer())
        self.builder.store(value, pointer).align = 8

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        product = self.builder.fmul(a, b, flags=('contract',))
        return self.builder.fadd(product, c, flags=('contract',))

    def splat(self, number: Any) -> Any:
        empty = ir.Constant(VECTOR, ir.Undefined)
        one = self.builder.insert_element(empty, number, ir.Constant(_I32, 0))
        mask = ir.Constant(ir.VectorType(_I32, WIDTH), [0] * WIDTH)
        return self.builder.shuffle_vector(one, empty, mask)

    def sums(self, count: int) -> list[Any]:
        return [cgutils.alloca_once(self.builder, VECTOR) for _ in range(count)]

    def loop(self, begin: Any, end: Any, step: int = 1) -> Any:
        return cgutils.for_range_slice(self.builder, begin, end, self.constant(step), intp=_I64)


def _spring_order(
    typing: Any,
    k: Any,
    x: Any,
    y: Any,
    square: Any,
    inverse: Any,
    law: Any,
    px: Any,
    py: Any,
):
    """Write order k > 0 of the springs' force; rows of all arrays are orders, lanes springs.

    Of vectors (x, y), whose order k is known, the square's and the inverse length's order k, and
    law[0] (1 - law[1] / length) times the vector (`event.taylor.direction_order` has the same).
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        code = Code(context, builder, signature, values)
        order, first = values[0], code.constant(0)
        half = builder.fdiv(ir.Constant(F64, 0.5), builder.sitofp(order, F64))
        sums, zero = code.sums(4), ir.Constant(VECTOR, [0.0] * WIDTH)
        with code.loop(code.constant(0), code.columns(5), WIDTH) as (q, _):
            for total in sums:
                builder.store(zero, total)
            with code.loop(code.constant(1), order) as (j, _):
                rest = builder.sub(order, j)
                x_j, y_j, r = code.load(1, j, q), code.load(2, j, q), code.load(4, rest, q)
                share = builder.fmul(half, builder.sitofp(j, F64))
                share = code.splat(builder.fsub(share, ir.Constant(F64, 1.0)))
                s, p, nx, ny = (builder.load(total) for total in sums)
                s = code.fma(x_j, code.load(1, rest, q), s)
                s = code.fma(y_j, code.load(2, rest, q), s)
                p = code.fma(builder.fmul(share, code.load(3, j, q)), r, p)
                new = (s, p, code.fma(r, x_j, nx), code.fma(r, y_j, ny))
                for value, total in zip(new, sums, strict=True):
                    builder.store(value, total)
            s, p, nx, ny = (builder.load(total) for total in sums)
            x_0, y_0, r = code.load(1, first, q), code.load(2, first, q), code.load(4, first, q)
            x_k, y_k = code.load(1, order, q), code.load(2, order, q)
            ends = code.fma(x_0, x_k, builder.fmul(y_0, y_k))
            s = code.fma(ir.Constant(VECTOR, [2.0] * WIDTH), ends, s)
            p = code.fma(ir.Constant(VECTOR, [-0.5] * WIDTH), builder.fmul(s, r), p)
            p = builder.fmul(p, builder.fmul(r, r))
            code.store(s, 3, order, q)
            code.store(p, 4, order, q)
            stiff, natural = code.load(5, first, q), code.load(5, code.constant(1), q)
            less = builder.fneg(natural)
            for out, at_0, at_k, n in ((6, x_0, x_k, nx), (7, y_0, y_k, ny)):
                n = code.fma(r, at_k, code.fma(p, at_0, n))
                code.store(builder.fmul(stiff, code.fma(less, n, at_k)), out, order, q)
        return context.get_dummy_value()

    return types.void(k, x, y, square, inverse, law, px, py), generate


spring_order: Any = intrinsic(_spring_order)
