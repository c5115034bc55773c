# SPDX-License-Identifier: Apache-2.0
"""Loops compiled by numba, and loaded without its compiler.

numba imports its whole compiler before it loads a function from its cache: the code generators of
all that it knows of NumPy, and SciPy's linear algebra through them; and it keeps the intermediate
code (LLVM bitcode) of each function for callers that might be compiled later. In a process that
compiles nothing that is 30 to 45 MB and half a second. Here both are had when something is
compiled, and only then. The machine code is the same.

Use `njit` and `cfunc` of this module in place of numba's.
"""

import sys
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import environment, sigutils
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.runtime import rtsys


def njit(function: Callable[..., Any] | None = None, *, cache: bool = False, **options: Any) -> Any:
    """Return `function` compiled as by `numba.njit`; with `cache` it is loaded as told above."""
    if function is None:
        return lambda function: njit(function, cache=cache, **options)
    compiled = numba.njit(**options)(function)
    if cache:
        compiled._cache = _Cache(function)
    return compiled


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that makes a C callback, as `numba.cfunc(signature, cache=True)`."""

    def decorate(function: Callable[..., Any]) -> Any:
        callback: Any = CFunc(function, sigutils.normalize_signature(signature), {}, {})
        callback._cache = _Cache(function)
        callback.compile()
        return callback

    return decorate


class _Cache(FunctionCache):
    """numba's cache of one function, which asks for the compiler only where it finds nothing."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        with _without_imports():
            found = self._load_overload(sig, target_context)
        if found is None:
            target_context.refresh()  # numba's compiler, with all that it knows
        else:
            self._leave_bitcode(found.library, sig, target_context)
        return found

    def _leave_bitcode(self, library: Any, sig: Any, target_context: Any) -> None:
        """Drop the bitcode of a library; a caller that is compiled later has it read again."""
        library._shared_module.close()
        library._shared_module = None

        def read_again() -> Any:
            if library._shared_module is None:
                key = self._index_key(sig, target_context.codegen())
                (_name, _kind, (_machine_code, bitcode)), *_rest = self._cache_file.load(key)
                library._shared_module = llvm.parse_bitcode(bitcode)
            return library._shared_module

        library._get_module_for_linking = read_again


@contextmanager
def _without_imports() -> Any:
    """Let numba find the environments of its own helper functions without importing them.

    An environment is the globals and constants of a function; machine code has its constants from
    there, and only object mode, which nothing here uses, its globals.
    """
    rebuild = environment._rebuild_env

    def light(module: str, constants: Any, name: str) -> Any:
        known = environment.lookup_environment(name)
        if known is not None or not module.startswith('numba.') or module in sys.modules:
            return rebuild(module, constants, name)
        found = environment.Environment({'__name__': module})
        found.consts[:] = constants
        found.env_name = name
        environment.Environment._memo[name] = found
        return found

    environment._rebuild_env = light  # pickle looks it up by this name
    try:
        yield
    finally:
        environment._rebuild_env = rebuild
