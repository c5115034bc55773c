# SPDX-License-Identifier: Apache-2.0
"""Asking for memory before it is needed, from compiled code: meanwhile other work goes on."""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

CACHE_LINE = 64  # bytes that come at once

_ir = cgutils.ir


def _prefetch(typing_context, address) -> Any:
    """Ask for the cache line at `address`, and do not wait for it."""

    def codegen(context, builder, sig, args):
        at = builder.inttoptr(args[0], _ir.IntType(8).as_pointer())
        number = _ir.IntType(32)
        kind = _ir.FunctionType(_ir.VoidType(), [at.type, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, 'llvm.prefetch.p0')
        read, keep, data = (_ir.Constant(number, k) for k in (0, 3, 1))
        builder.call(function, [at, read, keep, data])
        return context.get_dummy_value()

    return types.void(types.int64), codegen


prefetch: Any = intrinsic(_prefetch)
