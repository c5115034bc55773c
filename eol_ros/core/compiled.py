# SPDX-License-Identifier: Apache-2.0
"""Loops compiled by numba, and loaded without its compiler.

numba imports its whole compiler before it loads a function from its cache: the code generators of
all that it knows of NumPy, and SciPy's linear algebra through them; and it keeps the intermediate
code (LLVM bitcode) of each function for callers that might be compiled later. In a process that
compiles nothing that is 30 to 45 MB and half a second. Here both are had when something is
compiled, and only then. The machine code is the same.

numba's own cache checks only the file of the function, not the files of the functions and constants
that it uses. If two processes write its index, it can return code for other argument types. The
cache here (`eol_ros/compiled.py`) names each object by everything that it was made from.

The target is one processor, x86-64 with AVX2 and FMA, on every machine that can run its code. The
vector width determines the order in which a loop adds, so code for each machine's own processor
differs in the last bits. Other machines (older x86-64, Arm) get code for their own processor, as
does a process that has used numba before it imports this module.

Use `njit` and `cfunc` of this module in place of numba's.
"""

import functools
import json
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from types import CodeType, ModuleType
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from numba import types
from numba.core import config, environment, sigutils
from numba.core.bytecode import FunctionIdentity
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, compile_result
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.extending import _Intrinsic

from eol_ros import compiled as store

TARGET = 'haswell'  # LLVM's name for x86-64 with AVX2, BMI2 and FMA (x86-64-v3)
NEEDED = ('avx2', 'bmi', 'bmi2', 'f16c', 'fma', 'fsgsbase', 'invpcid', 'lzcnt', 'movbe', 'rdrnd')


def fix_target(features: Mapping[str, bool], settings: Any) -> bool:
    """Make numba (`settings`: its config) compile for TARGET if the processor has its features.

    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES do not matter. Returns whether TARGET is used.
    """
    able = all(features.get(name, False) for name in NEEDED)
    if able:
        settings.CPU_NAME, settings.CPU_FEATURES = TARGET, ''
    return able


FIXED = fix_target(llvm.get_host_cpu_features(), config)

# numba numbers the functions that it compiles from 1 in each process and puts the number into their
# symbols. Objects of two processes could then define one symbol for two functions, and a third
# process that loads both would run one in place of the other.
numbers: Any = store.numbers()
FunctionIdentity._unique_ids = numbers


def njit(
    function: Callable[..., Any] | None = None,
    *,
    cache: bool = False,
    inner: bool = False,
    **options: Any,
) -> Any:
    """Return `function` compiled as by `numba.njit`; with `cache` it is loaded as told above.

    `inner`: only other compiled functions call it. It then gets no entry for Python, which takes
    each array of its arguments apart and can be more to compile than the function itself, and no
    machine code but in what calls it.
    """
    if function is None:
        return lambda function: njit(function, cache=cache, inner=inner, **options)
    # What is not stated here a function would inherit from its first caller.
    options = {'fastmath': False, 'error_model': 'python', 'forceinline': False, **options}
    options |= {'no_cpython_wrapper': inner, 'no_cfunc_wrapper': True}
    known = json.dumps(options, sort_keys=True, default=sorted)
    if inner:
        options['pipeline_class'] = _InnerCompiler
    compiled = numba.njit(**options)(function)
    compiled.get_call_template = functools.partial(_without_literals, compiled.get_call_template)
    if cache:
        compiled._cache = _InnerCache(function, known) if inner else _Cache(function, known)
    if inner:  # numba would call an entry that is not there
        compiled.add_overload = functools.partial(_add_inner, compiled)
        compiled._compile_for_args = functools.partial(_refuse, function)
    return compiled


def _add_inner(dispatcher: Any, compiled: Any) -> None:
    dispatcher.overloads[tuple(compiled.signature.args)] = compiled


def _refuse(function: Callable[..., Any], *_args: Any, **_kws: Any) -> None:
    raise TypeError(f'{function.__qualname__} has no entry for Python: compiled functions call it')


def _without_literals(template: Callable[..., Any], args: Any, kws: Any) -> Any:
    """Return numba's template of a call, its arguments typed by what they are, not by their value.

    While numba infers types, a count that starts from 0 and a step order of 3 are types of their
    own, and for each the function called would be compiled once more.
    """
    kws = {name: types.unliteral(kind) for name, kind in kws.items()}
    return template(tuple(types.unliteral(kind) for kind in args), kws)


_INNER = 'intermediate code'


class _InnerLibrary(JITCodeLibrary):
    """Intermediate code of a function that only others call: optimised as part of these, once.

    numba would optimise each function with all that it calls, and make machine code of them that
    nobody runs.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        self._ensure_finalized()
        return self.name, _INNER, self._get_module_for_linking().as_bitcode()

    def get_pointer_to_function(self, name: str) -> int:
        return 0

    @property
    def codegen(self) -> Any:
        return _NO_ENVIRONMENTS


class _NoEnvironments:
    """What has no machine code has no variables to point to what it was compiled from."""

    def set_env(self, env_name: str, env: Any) -> None:
        pass


_NO_ENVIRONMENTS = _NoEnvironments()


class _InnerCompiler(Compiler):
    def compile_extra(self, func: Callable[..., Any]) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = _InnerLibrary(codegen, func.__qualname__)
        return super().compile_extra(func)


def read_only(image: np.ndarray) -> np.ndarray:
    """Return `image` as the one type that loops are compiled for: contiguous, not to be written.

    For another type they would be compiled again, while an image waits, and their fast arithmetic
    might then round differently in the last bit.
    """
    if image.flags.c_contiguous and not image.flags.writeable:
        return image
    image = np.ascontiguousarray(image).view()
    image.flags.writeable = False
    return image


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that makes a C callback, as `numba.cfunc(signature, cache=True)`."""

    def decorate(function: Callable[..., Any]) -> Any:
        callback: Any = CFunc(function, sigutils.normalize_signature(signature), {}, {})
        callback._cache = _Cache(function, 'cfunc')
        callback.compile()
        return callback

    return decorate


def made_from(function: Callable[..., Any]) -> tuple[dict[str, str], str]:
    """Return the sources of the machine code of `function`: digests of each file and of globals.

    The files are its own and those of all compiled functions that it calls, directly or not. The
    globals are those that these functions read. All called functions must be defined.
    """
    files = set()
    constants = set()
    left, seen = [function], set()
    while left:
        called = left.pop()
        files.add(called.__code__.co_filename)
        for name, value in _read_by(called):
            if isinstance(value, Dispatcher):
                if value.py_func not in seen:
                    seen.add(value.py_func)
                    left.append(value.py_func)
            elif isinstance(value, _Intrinsic):
                files.add(value._defn.__code__.co_filename)
            elif isinstance(value, type):  # a record, or an exception
                files.add(getattr(sys.modules[value.__module__], '__file__', ''))
            elif isinstance(value, _CONSTANT):
                constants.add((called.__module__, name, pickle.dumps(value)))
    digest = sha256(repr(sorted(constants)).encode()).hexdigest()
    return {file: store.content(file) for file in sorted(files - {''})}, digest


_CONSTANT = (bool, int, float, complex, str, bytes, tuple, np.ndarray, np.generic, np.dtype)


def _read_by(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Yield (name, value) of each global that the code of `function` may read, in modules too.

    Of a module each attribute counts whose name stands anywhere in the code: some too many.
    """
    names = set(_names(function.__code__))
    for name in names & function.__globals__.keys():
        value = function.__globals__[name]
        if isinstance(value, ModuleType):
            for attribute in names & vars(value).keys():
                yield f'{name}.{attribute}', vars(value)[attribute]
        else:
            yield name, value
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for inside in code.co_consts:
        if isinstance(inside, CodeType):
            yield from _names(inside)


def _described(kind: Any) -> Any:
    """Return a name of an argument type, unique for each type that numba compiles separately."""
    fields = getattr(kind, 'fields', ())  # a named tuple: `str` gives only its class
    inside = getattr(kind, 'types', ()) if isinstance(kind, types.BaseTuple) else ()
    return str(kind), tuple(map(str, fields)), tuple(map(_described, inside))


# What pickle, numba and LLVM raise on an object that is whole but made by other versions of them.
_UNREADABLE = (
    pickle.UnpicklingError, AssertionError, AttributeError, EOFError, ImportError, LookupError,
    RuntimeError, TypeError, ValueError,
)  # fmt: skip


class _Cache:
    """The cache of one function, in place of numba's; each set of argument types has a file.

    It loads the compiler only if it finds no file.
    """

    def __init__(self, function: Callable[..., Any], options: str):
        store.check()
        self._function, self._options = function, options
        store.content(function.__code__.co_filename)  # before an update replaces the file

    @property
    def cache_path(self) -> str:
        return str(store.folders()[0])

    def flush(self) -> None:
        """Keep the files: their sources have not changed."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        name, files = self._named(sig, target_context.codegen())
        found = self._load(name, sig, target_context) if store.is_lasting(files) else None
        if found is None:
            target_context.refresh()  # loads numba's compiler
        return found

    def save_overload(self, sig: Any, result: Any) -> None:
        if result.lifted or result.library.has_dynamic_globals:
            raise ValueError(f'{self._function.__qualname__} cannot be cached')
        name, files = self._named(sig, result.codegen)
        if store.is_lasting(files):
            store.store(name, files, dumps((sig, result._reduce())))

    def _named(self, sig: Any, codegen: Any) -> tuple[str, dict[str, str]]:
        """Return the file name for `sig` and the sources of its code."""
        function = self._function
        files, constants = made_from(function)
        args, returned = sigutils.normalize_signature(sig)
        target = codegen.magic_tuple()  # with features if numba was used before this module
        key = (
            *(function.__module__, function.__qualname__, function.__code__.co_firstlineno),
            *(sha256(function.__code__.co_code).hexdigest(), self._options, constants),
            *([_described(kind) for kind in args], str(returned)),
            TARGET if FIXED and not target[2] else target,
            sorted(files.values()),
        )
        where = function.__module__.rpartition('.')[2]
        title = ''.join(c for c in f'{where}.{function.__qualname__}' if c not in '<>/')
        return f'{title}-{sha256(repr(key).encode()).hexdigest()[:32]}.object', files

    def _load(self, name: str, sig: Any, target_context: Any) -> Any:
        stored = store.load(name)
        if stored is None:
            return None
        data, again = stored
        try:
            with _without_imports():
                made_for, reduced = pickle.loads(data)
                # else: a default of nan, or a class of the main script
                return self._rebuild(again, target_context, reduced) if made_for == sig else None
        except _UNREADABLE as error:
            store.say(f'{name} cannot be loaded ({error}); compiling it again')
            return None

    def _rebuild(self, again: Callable[[], bytes | None], target_context: Any, reduced: Any) -> Any:
        """Rebuild without the bitcode, which is read again if a caller is compiled later."""
        found = CompileResult._rebuild(target_context, *reduced)
        library = found.library
        library._shared_module.close()
        library._shared_module = None

        def read_again() -> Any:
            if library._shared_module is None:
                data = again()
                if data is None:
                    raise RuntimeError('a file of the cache of compiled loops was overwritten')
                _sig, ((_name, _kind, (_machine_code, bitcode)), *_rest) = pickle.loads(data)
                library._shared_module = llvm.parse_bitcode(bitcode)
            return library._shared_module

        library._get_module_for_linking = read_again
        return found


class _InnerCache(_Cache):
    def _rebuild(self, again: Callable[[], bytes | None], target_context: Any, reduced: Any) -> Any:
        (title, kind, bitcode), fndesc, env, signature, *_rest = reduced
        assert kind == _INNER
        library = _InnerLibrary(target_context.codegen(), title)
        library._final_module = llvm.parse_bitcode(bitcode)
        library._finalize_final_module()
        return compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=library,
            environment=env,
            entry_point=target_context.get_executable(library, fndesc, env),
            fndesc=fndesc,
            signature=signature,
            objectmode=False,
            lifted=(),
            reload_init=(),
            referenced_envs=(),
        )


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
