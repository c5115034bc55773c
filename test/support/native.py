# SPDX-License-Identifier: Apache-2.0
"""The C of the firmware, compiled for this machine, with C of the tests around it."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

from support.checkout import ROOT

FIRMWARE = ROOT / 'firmware'
UNDEFINED = ['-fsanitize=undefined,bounds', '-fsanitize-undefined-trap-on-error']


def assert_compiles(folder: Path, *words: object) -> None:
    """Run the C compiler in `folder`; the test fails with its messages."""
    compiler = shutil.which('cc') or shutil.which('gcc') or shutil.which('clang')
    if compiler is None:
        pytest.skip('no C compiler here')
    done = subprocess.run(
        [compiler, '-std=c99', *map(str, words)], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def _words(folder: Path, text: str, sources: tuple[str, ...]) -> list[object]:
    (folder / 'glue.c').write_text(text)
    paths = [FIRMWARE / source for source in sources]
    return [*(f'-I{path}' for path in (FIRMWARE, FIRMWARE / 'block', FIRMWARE / 'bridge')),
            'glue.c', *paths, '-lm']  # fmt: skip


def library(folder: Path, text: str, *sources: str) -> ctypes.CDLL:
    """Return the library of a C text and of sources of the firmware, without a warning."""
    words = _words(folder, text, sources)
    assert_compiles(
        folder, '-O2', '-Wall', '-Wextra', '-Werror', '-shared', '-fPIC', *words, '-oglue.so'
    )
    return ctypes.CDLL(str(folder / 'glue.so'))


def output(folder: Path, text: str, *sources: str) -> list[int]:
    """Return the numbers that a program prints; undefined behaviour in C ends it."""
    assert_compiles(folder, '-O1', *UNDEFINED, *_words(folder, text, sources), '-oglue')
    done = subprocess.run([folder / 'glue'], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f'it ended with {done.returncode}'
    return [int(word) for word in done.stdout.split()]
