# SPDX-License-Identifier: Apache-2.0
"""Grains as SDIF, and back: the format of Ircam's tools, such as MuBu and CataRT in Max.

Sound Description Interchange Format, version 3 (Schwarz, Virolle, "SDIF Format Specification",
sdif.sourceforge.net; Wright et al., ICMC 1998): big-endian frames, each a signature, its size, a
time in s and matrices, all padded to 8 bytes. A grain is a frame XGRN at its start, in the stream
of its sound, with one matrix XGRN of one row. What its columns are stands in the frame 1TYP, as
the format wants it of types that are not its own; which stream is which sound in 1NVT.
"""

import re
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from eol_ros.core.sound.corpus import Corpus
from eol_ros.devices.corpus.corpus_file import MOST_CORPUS
from eol_ros.devices.corpus.exchange import check_columns, table_of, with_values
from eol_ros.disk import content
from eol_ros.errors import ConfigError, DeviceMissing, writing

SIGNATURE = b'XGRN'
OPENING = struct.pack('>4siii', b'SDIF', 8, 3, 1)  # version 3 of the format, 1 of its types
NO_TIME = -float(np.finfo('f8').max)
TEXT, DOUBLE, SINGLE = 0x301, 0x008, 0x004  # types of what is in a matrix
TABLES, TYPES = -3, -2  # streams of the frames with text
WITHIN_S = 5e-4  # by so much a start may differ, as where another program counts milliseconds
_COLUMNS = re.compile(r'1MTD\s+(\w{4})\s*\{([^}]*)\}')


def save(corpus: Corpus, path: Path) -> list[str]:
    """Write the placed grains as SDIF; return what the columns are. Raises ConfigError."""
    names, rows, table = table_of(corpus)
    files, starts = corpus.grains['file'][rows], corpus.grains['start_s'][rows]
    sounds = ''.join(f'stream{i}\t{s.path}\n' for i, s in enumerate(corpus.sources, 1))
    columns = ', '.join(names)
    types = f'{{\n1MTD {SIGNATURE.decode()} {{{columns}}}\n'
    types += f'1FTD {SIGNATURE.decode()} {{ {SIGNATURE.decode()} grain; }}\n}}\n'
    parts = [
        OPENING,
        _frame(b'1NVT', NO_TIME, TABLES, _text(b'1NVT', f'Author\teol_ros\n{sounds}')),
        _frame(b'1TYP', NO_TIME, TYPES, _text(b'1TYP', types)),
    ]
    for i in np.lexsort((files, starts)):  # frames ascend in time
        head = struct.pack('>4siii', SIGNATURE, DOUBLE, 1, len(names))
        row = head + table[i].astype('>f8').tobytes()
        parts.append(_frame(SIGNATURE, float(starts[i]), int(files[i]) + 1, row))
    with writing(path):
        path.write_bytes(b''.join(parts))
    return names


def apply(corpus: Corpus, path: Path, names: list[str]) -> Corpus:
    """Return `corpus` with the values of an SDIF file.

    Its frames are grains by stream and start. Columns are named as in its 1TYP, or `names`.

    Raises
    ------
    ConfigError
        The file is no SDIF, its frames are no grains, or its columns no descriptors.
    """
    columns, found = _read(path)
    names = names or columns
    if not names:
        raise ConfigError(f'{path}: names no columns; say --columns')
    check_columns(path, names)
    numbers, table = [], []
    for time_s, stream, row in found:
        off = np.abs(corpus.grains['start_s'] - time_s)
        off = np.where(corpus.grains['file'] == stream - 1, off, np.inf)
        nearest = int(np.argmin(off))
        if off[nearest] > WITHIN_S:
            raise ConfigError(f'{path}: no grain of stream {stream} begins at {time_s:g} s')
        if len(row) != len(names) or not np.isfinite(row).all():
            raise ConfigError(f'{path}: the frame at {time_s:g} s has not {len(names)} numbers')
        numbers.append(nearest)
        table.append(row)
    return with_values(corpus, names, np.array(numbers), np.array(table))


def _text(signature: bytes, text: str) -> bytes:
    data = text.encode()
    return struct.pack('>4siii', signature, TEXT, len(data), 1) + data


def _frame(signature: bytes, time_s: float, stream: int, matrix: bytes) -> bytes:
    matrix += bytes(-len(matrix) % 8)
    return struct.pack('>4sidii', signature, 16 + len(matrix), time_s, stream, 1) + matrix


def _read(path: Path) -> tuple[list[str], list[tuple[float, int, np.ndarray]]]:
    """Return the columns of our matrix, and time, stream and row of each frame that has one."""
    try:
        data = content(path, MOST_CORPUS)
    except FileNotFoundError:
        raise DeviceMissing(f'{path}: no such file') from None
    except OSError as error:
        raise ConfigError(f'{path}: cannot be read ({error.strerror})') from None
    if data[:4] != b'SDIF':
        raise ConfigError(f'{path}: not an SDIF file')
    columns: list[str] = []
    found: list[tuple[float, int, np.ndarray]] = []
    try:
        at = 8 + struct.unpack_from('>i', data, 4)[0]
        if at > len(data):
            raise ValueError('its opening is cut short')
        for time_s, stream, kind, form, rows, body in _matrices(data, at):
            if kind == b'1TYP':
                for name, words in _COLUMNS.findall(body.decode('utf-8', 'replace')):
                    if name.encode() == SIGNATURE:
                        columns = [word.strip() for word in words.split(',')]
            elif kind == SIGNATURE and form in (DOUBLE, SINGLE) and rows == 1:
                numbers = np.frombuffer(body, '>f8' if form == DOUBLE else '>f4')
                found.append((time_s, stream, numbers.astype(float)))
    except (struct.error, ValueError) as error:
        raise ConfigError(f'{path}: not an SDIF file ({error})') from None
    if not found:
        raise ConfigError(
            f'{path}: an SDIF file without matrices {SIGNATURE.decode()}, as grains are'
        )
    return columns, found


def _matrices(data: bytes, at: int) -> Iterator[tuple[float, int, bytes, int, int, bytes]]:
    """Yield time and stream of its frame, signature, form, rows and body of each matrix from `at`.

    Raises ValueError or struct.error where one is cut short.
    """
    while at < len(data):
        _, size, time_s, stream, count = struct.unpack_from('>4sidii', data, at)
        end, here = at + 8 + size, at + 24
        if size < 16 or end > len(data):
            raise ValueError('a frame is cut short')
        for _ in range(count):
            kind, form, rows, columns = struct.unpack_from('>4siii', data, here)
            length = rows * columns * (form & 0xFF)
            body = data[here + 16 : here + 16 + length]
            if rows < 0 or columns < 0 or here + 16 + length > end:
                raise ValueError('a matrix is cut short')
            here += 16 + length + -length % 8
            yield time_s, stream, kind, form, rows, body
        at = end
