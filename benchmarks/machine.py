# SPDX-License-Identifier: Apache-2.0
"""The machine that figures are of: every benchmark says it before its table and in its JSON.

The compiler, not the processor, gives the vector width: `core/compiled.py` compiles for one target
on every machine.
"""

import importlib.metadata
import json
import os
import platform
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

REGISTERS = (('zmm', 512, 'AVX-512'), ('ymm', 256, 'AVX2'), ('xmm', 128, 'SSE'))


def machine() -> dict[str, Any]:
    """Return processor, vector width in bits as compiled, cores, versions."""
    import numba
    from numba.core.registry import cpu_target

    from eol_ros.core import compiled  # noqa: F401  sets the target
    from eol_ros.ros.run_record import versions

    bits, name = _vectors()
    target = cpu_target.target_context.codegen().magic_tuple()[1]
    return {
        'processor': _processor(),
        'compiled_for': target,
        'vector_bits': bits,
        'vectors': name,
        'cores': len(os.sched_getaffinity(0)),
        'python': platform.python_version(),
        'numba': numba.__version__,
        'eol_ros': importlib.metadata.version('eol_ros'),
        'commit': versions().get('commit', ''),  # of the checkout; none in a wheel
    }


def line(found: dict[str, Any]) -> str:
    """Return what `machine` found as one line."""
    made = f'compiled for {found["compiled_for"]}, {found["vectors"]}'
    return (
        f'{found["processor"]}, {made}: vectors of {found["vector_bits"]} bits; '
        f'{found["cores"]} cores; Python {found["python"]}, Numba {found["numba"]}, '
        f'eol_ros {version(found)}'
    )


def version(found: dict[str, Any]) -> str:
    """Return the commit that was measured, or the version where there was no checkout."""
    return found.get('commit') or found['eol_ros']


def headed(found: dict[str, Any], columns: str) -> list[str]:
    """Return the head of a Markdown table whose rows are all of this machine and version."""
    first, *others = columns.split(' | ')
    names = [f'{first} ({found["processor"]}, {version(found)})', *others]
    return [f'| {" | ".join(names)} |', '|' + ' --- |' * len(names)]


def tell(result: dict[str, Any], as_json: bool, table: Callable[[dict[str, Any]], str]) -> None:
    """Print `result` as JSON with its machine, or as a table under the machine's line.

    A result that names its machine already, for it was read from a file, keeps it.
    """
    found = result.get('machine') or machine()
    if as_json:
        print(json.dumps({'machine': found, **result}, indent=2))
        return
    print(line(found))
    print(table(result))


def _processor() -> str:
    """Return the processor's own name."""
    try:
        text = Path('/proc/cpuinfo').read_text()
    except OSError:
        text = ''
    found = re.search(r'^model name\s*:\s*(.+)$', text, re.M)
    return found[1].strip() if found else platform.processor() or platform.machine()


def _vectors() -> tuple[int, str]:
    """Return the width of the registers, bits, that a loop over float32 is compiled to."""
    from numba import float32, njit, void

    @njit(void(float32[::1], float32[::1]))
    def loop(a, b):
        for k in range(a.size):
            a[k] += b[k]

    code = next(iter(loop.inspect_asm().values()))
    for register, bits, name in REGISTERS:
        if register in code:
            return bits, name
    return (128, 'NEON') if platform.machine() in ('aarch64', 'arm64') else (0, 'unknown')
