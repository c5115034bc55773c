# SPDX-License-Identifier: Apache-2.0
"""Text tables that people write by hand or export from a spreadsheet: one reader for all of them.

UTF-8 with or without a byte order mark, or UTF-16 with one. Cells are separated by a tab, `;`, `,`,
`|` or blanks, whichever fits the first lines, or as a line `sep=;` says. A first line may name the
columns, in any order; else they stand in the order of the caller. Decimal points or commas. Empty
lines, and those that begin with `#` or a backslash, are left out.
"""

import codecs
import csv
import io
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eol_ros.disk import opened
from eol_ros.errors import ConfigError, DeviceMissing

_MARKS = {
    codecs.BOM_UTF8: 'utf-8-sig',
    codecs.BOM_UTF16_LE: 'utf-16',
    codecs.BOM_UTF16_BE: 'utf-16',
}
_WORKBOOKS = b'PK\3\4', b'\xd0\xcf\x11\xe0'  # .xlsx and .ods, .xls
# What a spreadsheet exports of a cell that it cannot compute; any other # begins a comment.
_ERROR = re.compile(
    r'#(DIV/0!|N/A|NAME\?|NULL!|NUM!|REF!|VALUE!|SPILL!|CALC!|WERT!|BEZUG!|ZAHL!|NV)\s*$'
)
LONGEST = 1 << 17  # characters of a line: what the reader of Python takes for a cell
_SNIFFED = 20  # lines by which the delimiter is chosen
_SEP = re.compile(r'"?sep=([^"\w\r\n])"?\s*', re.I)
_UNIT = re.compile(r'\s*[\[(].*')  # `x [m]` names the column x


@dataclass(frozen=True)
class Row:
    """One line: its cells by column, and where it stands."""

    path: Path
    line: int
    cells: dict[str, str]
    count: int  # of cells, named or not

    def number(
        self,
        name: str,
        default: float | None = None,
        low: float = -math.inf,
        high: float = math.inf,
        hint: str = '',
    ) -> float:
        """Return the cell as a float in low..high; `default` where it is absent or empty.

        Raises ConfigError with line and column.
        """
        text = self.cells.get(name, '').strip()
        if _ERROR.match(text):
            raise self.wrong(name, f'{name} {text} is an error that the spreadsheet shows')
        text = text.partition('#')[0].strip()
        if not text and default is not None:
            return default
        if not text:
            raise self.wrong(name, f'{name} is missing: the line has {self.count} cells')
        value = number(text)
        if not low <= value <= high:  # nan, too
            known = math.isfinite(value)
            wrong = f'must lie in {low:g}..{high:g}{hint}' if known else 'is not a number'
            raise self.wrong(name, f'{name} {text[:40]!r} {wrong}')
        return value

    def wrong(self, name: str, text: str) -> ConfigError:
        """Return the error that says `text` of a cell, with line and column."""
        column = list(self.cells).index(name) + 1 if name in self.cells else self.count + 1
        return ConfigError(f'{self.path}:{self.line}:{column}: {text}')


def number(text: str) -> float:
    """Return a number with a decimal point or comma; nan for anything else."""
    text = with_point(text.strip().replace('\N{MINUS SIGN}', '-'))
    try:
        value = float(text) if '_' not in text else math.nan
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def with_point(text: str) -> str:
    """Return the text of a number with a decimal point in place of a decimal comma."""
    return text.replace(',', '.') if text.count(',') == 1 and '.' not in text else text


def rows(
    path: str | Path,
    columns: Sequence[str],
    needed: Sequence[str],
    fits: Callable[[Sequence[str]], bool] | None = None,
    header: bool = False,
) -> Iterator[Row]:
    """Yield the lines of a table.

    Parameters
    ----------
    path : str or Path
    columns : sequence of str
        Names of the columns that count, in the order that they have without a header.
    needed : sequence of str
        Those that every line has.
    fits : callable, optional
        Whether these cells of a line without header are plausible; by default, whether they are
        numbers.
    header : bool
        The first line must name the columns.

    Raises
    ------
    DeviceMissing
        The file cannot be read.
    ConfigError
        It is not text, or a line lacks cells; with line and column.
    """
    path = Path(path)
    fits = fits or (lambda cells: all(math.isfinite(number(c.partition('#')[0])) for c in cells))
    lines = _lines(path)
    first = list(itertools.islice(lines, _SNIFFED))
    start = 0
    if first and (said := _SEP.fullmatch(first[0])):
        delimiters, start = [said[1]], 1
    else:
        delimiters = [*([''] if len(columns) == 1 else []), *'\t;,|', ' ']
    sample = [line for line in first[start:] if not _is_left_out([line])]
    delimiter, names = _layout(sample, delimiters, columns, needed, fits)
    if header and sample and not names:
        names = [_name(c) for c in _split(sample[:1], delimiter)[0]]
        missing = next((name for name in needed if name not in names), needed[0])
        raise ConfigError(
            f'{path}:{first.index(sample[0]) + 1}:1: no column {missing}; the first line names the '
            f'columns: {",".join(columns)}'
        )
    for name in columns:
        if names.count(name) > 1:
            line = first.index(sample[0]) + 1
            raise ConfigError(f'{path}:{line}:1: {names.count(name)} columns are named {name}')
    seen_header = not names
    reader = _reader(itertools.chain(first[start:], lines), delimiter)
    try:
        for cells in reader:
            if _is_left_out(cells):
                continue
            if not seen_header:
                seen_header = True
                continue
            line = reader.line_num + start
            found = zip(names or columns, cells, strict=False)
            yield Row(path, line, {name: cell.strip() for name, cell in found}, len(cells))
    except csv.Error as error:
        raise ConfigError(f'{path}:{reader.line_num + start}:1: not a table ({error})') from None


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a text; raises DeviceMissing, ConfigError."""
    line, column = 1, 1
    try:
        with open(path, 'rb', opener=opened) as file:
            head = file.peek(4)
            if head.startswith(_WORKBOOKS):
                raise ConfigError(f'{path}: a workbook, not text; save it as "CSV UTF-8"')
            encoding = next((e for mark, e in _MARKS.items() if head.startswith(mark)), 'utf-8')
            text = io.TextIOWrapper(file, encoding, 'surrogateescape', newline='')
            for line, found in enumerate(iter(lambda: text.readline(LONGEST), ''), 1):
                if len(found) == LONGEST:
                    raise ConfigError(
                        f'{path}:{line}:1: not a table: a line of more than {LONGEST} characters'
                    )
                odd = re.search('[\0\udc80-\udcff]', found)
                if odd:
                    column = odd.start() + 1
                    if odd[0] == '\0':
                        raise ConfigError(
                            f'{path}:{line}:{column}: a zero byte, as of a power cut, of UTF-16 '
                            'without a byte order mark or of no text; save the file as UTF-8'
                        )
                    raise ConfigError(
                        f'{path}:{line}:{column}: byte 0x{ord(odd[0]) - 0xDC00:02X} is not UTF-8; '
                        'save the file as UTF-8 (in a spreadsheet: "CSV UTF-8")'
                    )
                yield found.lstrip('\ufeff') if line == 1 else found  # some write it twice
    except IsADirectoryError:
        raise DeviceMissing(f'{path}: a folder, not a file') from None
    except OSError as error:
        raise DeviceMissing(f'{path}: cannot be read ({error.strerror})') from None
    except UnicodeError as error:  # UTF-16 that is cut
        raise ConfigError(f'{path}:{line}:{column}: not text in {encoding} ({error})') from None


def _layout(sample, delimiters, columns, needed, fits) -> tuple[str, list[str]]:
    """Return the delimiter and the names in the first line, none if it is no header."""
    for delimiter in delimiters if sample else ():
        names = [_name(c) for c in _split(sample[:1], delimiter)[0]]
        if set(needed) <= set(names):
            return delimiter, names
    for delimiter in delimiters:
        for cells in _split(sample[:2], delimiter)[::-1]:  # the first may be an unknown header
            wanted = cells[: len(needed)]
            if len(wanted) == len(needed) and fits(wanted):
                return delimiter, []
    return max(delimiters, key=lambda d: sum(line.count(d) for line in sample) if d else 0), []


def _split(lines: Iterable[str], delimiter: str) -> list[list[str]]:
    return list(_reader(lines, delimiter))


def _reader(lines: Iterable[str], delimiter: str):
    blanks = delimiter in ('', ' ')
    if blanks:
        lines = (' '.join(line.split()) + '\n' for line in lines)
    return csv.reader(
        lines,
        delimiter=delimiter or '\x1f',
        quoting=csv.QUOTE_NONE if delimiter == '\t' else csv.QUOTE_MINIMAL,  # labels quote nothing
        skipinitialspace=not blanks,
    )


def _is_left_out(cells: Sequence[str]) -> bool:
    text = next((c.strip() for c in cells), '')
    comment = text.startswith(('#', '\\')) and not _ERROR.match(text)
    return comment or not any(c.strip() for c in cells)


def _name(cell: str) -> str:
    return _UNIT.sub('', cell.strip().strip('"')).lower()
