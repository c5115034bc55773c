# SPDX-License-Identifier: Apache-2.0
"""A ChArUco board on a sheet of paper: to scale, with a white margin and a ruler to check it by.

SVG and PDF are written as text, in millimetres: rectangles and a line of type need no library.
"""

import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

import cv2
import numpy as np

from eol_ros.core.vision.calibration.charuco import Board
from eol_ros.errors import ConfigError

PAPERS = {
    'A4': (297.0, 210.0),
    'A3': (420.0, 297.0),
    'A2': (594.0, 420.0),
    'A1': (841.0, 594.0),
    'A0': (1189.0, 841.0),
}  # ISO 216, mm, lying
EDGE_MM = 10.0  # white at least: few printers reach further out
RULER_MM = 100.0
LINE_MM = 0.4
TYPE_MM = 4.0
FOOT_MM = (180.0, 23.0)  # ruler and words, below the white margin of the board
PT_MM = 25.4 / 72


@dataclass(frozen=True)
class Sheet:
    """What is printed: millimetres from the upper left corner of the paper, y down.

    black, white: rectangles (n, 4) of x, y, width, height; the white ones lie on the black ones.
    words: x, y of the base line, and the text.
    """

    width: float
    height: float
    black: np.ndarray
    white: np.ndarray
    words: tuple[tuple[float, float, str], ...]


def sheet(board: Board, paper: str = 'auto') -> Sheet:
    """Lay the board out on `paper`: a name of PAPERS, WxH in mm, or auto: the smallest that fits.

    Raises:
        ConfigError: no such paper, or the board with its white margin does not fit on it.
    """
    made = board.made()
    square, marker = board.square_m * 1e3, board.marker_m * 1e3
    wide, high = board.columns * square, board.rows * square
    margin = max(EDGE_MM, square / 4)
    need = (max(wide + 2 * margin, FOOT_MM[0] + 2 * EDGE_MM), high + 2 * margin + FOOT_MM[1])
    width, height = _paper(paper, need)
    left, top = (width - wide) / 2, (height - FOOT_MM[1] - high) / 2
    corners = [np.asarray(points)[0, :2] * 1e3 for points in made.getObjPoints()]
    marked = {(int(y // square), int(x // square)) for x, y in corners}
    black = [
        (column * square, row * square, square, square)
        for row in range(board.rows)
        for column in range(board.columns)
        if (row, column) not in marked
    ]
    white = []
    for (x, y), number in zip(corners, np.ravel(made.getIds()), strict=True):
        black.append((x, y, marker, marker))
        white += _light(made.getDictionary(), int(number), x, y, marker)
    shift = [left, top, 0, 0]
    x, below = min(left, width - EDGE_MM - FOOT_MM[0]), top + high + margin + 4
    ticks = [(x + 10 * k, below, LINE_MM, 3.0) for k in range(round(RULER_MM / 10) + 1)]
    ruler = [(x, below, RULER_MM + LINE_MM, LINE_MM), *ticks]
    words = (
        (x, below + 8, '0'),
        (x + RULER_MM, below + 8, f'{RULER_MM:g} mm'),
        (
            x,
            below + 13,
            f'{board.columns} x {board.rows} squares of {square:g} mm, markers of '
            f'{marker:g} mm, {board.dictionary}',
        ),
        (
            x,
            below + 18,
            f'Board {wide:g} x {high:g} mm, sheet {width:g} x {height:g} mm. '
            'Print at 100 %, then measure the ruler.',
        ),
    )
    return Sheet(
        width,
        height,
        np.array([*(np.array(black) + shift), *ruler]),
        np.array(white) + shift,
        words,
    )


def _paper(paper: str, need: tuple[float, float]) -> tuple[float, float]:
    names = PAPERS if paper == 'auto' else {paper: PAPERS.get(paper.upper())}
    for size in names.values():
        size = size or _size(paper)
        for way in (size, size[::-1]):
            if need[0] <= way[0] and need[1] <= way[1]:
                return way
    raise ConfigError(
        f'the board with its margin and ruler needs {need[0]:g} x {need[1]:g} mm, '
        + ('more than A0' if paper == 'auto' else f'paper {paper} is smaller')
        + ': take smaller squares, or larger paper'
    )


def _size(paper: str) -> tuple[float, float]:
    width, _, height = paper.lower().partition('x')
    try:
        size = float(width), float(height)
    except ValueError:
        size = (math.nan, math.nan)
    if not all(0 < side < 1e5 for side in size):
        raise ConfigError(
            f'paper {paper!r} is none of {", ".join(PAPERS)}, nor a size in mm like 700x500'
        )
    return size


def _light(
    dictionary: cv2.aruco.Dictionary, number: int, x: float, y: float, side: float
) -> list[tuple[float, ...]]:
    """Return the white parts of a marker, row by row."""
    cells = dictionary.markerSize + 2
    bits = cv2.aruco.generateImageMarker(dictionary, number, cells) > 0
    step = side / cells
    found: list[tuple[float, ...]] = []
    for row in range(cells):
        edges = np.flatnonzero(np.diff(np.r_[0, bits[row], 0]))
        for begin, end in edges.reshape(-1, 2):
            found.append((x + begin * step, y + row * step, (end - begin) * step, step))
    return found


def svg(page: Sheet) -> str:
    """Return the sheet as SVG, one unit a millimetre."""
    size = f'{page.width:g}mm'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size}" height="{page.height:g}mm" '
        f'viewBox="0 0 {page.width:g} {page.height:g}">',
        f'<style>@page {{ size: {page.width:g}mm {page.height:g}mm; margin: 0 }}</style>',
        f'<rect width="{page.width:g}" height="{page.height:g}" fill="white"/>',
    ]
    for colour, boxes in (('black', page.black), ('white', page.white)):
        lines.append(f'<g fill="{colour}" shape-rendering="crispEdges">')
        lines += [
            f'<rect x="{x:.4f}" y="{y:.4f}" width="{w:.4f}" height="{h:.4f}"/>'
            for x, y, w, h in boxes
        ]
        lines.append('</g>')
    lines += [
        f'<text x="{x:.4f}" y="{y:.4f}" font-family="sans-serif" font-size="{TYPE_MM:g}">'
        f'{escape(text)}</text>'
        for x, y, text in page.words
    ]
    return '\n'.join([*lines, '</svg>', ''])


def pdf(page: Sheet) -> bytes:
    """Return the sheet as PDF 1.4 (ISO 32000-1), which counts in points and from below."""
    drawn = [f'{1 / PT_MM:.6f} 0 0 {-1 / PT_MM:.6f} 0 {page.height / PT_MM:.4f} cm']
    for grey, boxes in ((0, page.black), (1, page.white)):
        drawn += [
            f'{grey} g',
            *(f'{x:.4f} {y:.4f} {w:.4f} {h:.4f} re' for x, y, w, h in boxes),
            'f',
        ]
    drawn.append('0 g BT')
    for x, y, text in page.words:  # y points down here: the letters are turned back
        safe = text.replace('\\', r'\\').replace('(', r'\(').replace(')', r'\)')
        drawn.append(f'/F {TYPE_MM:g} Tf 1 0 0 -1 {x:.4f} {y:.4f} Tm ({safe}) Tj')
    stream = '\n'.join([*drawn, 'ET'])
    box = f'[0 0 {page.width / PT_MM:.4f} {page.height / PT_MM:.4f}]'
    objects = (
        '<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>',
        '<< /Type /Pages /Kids [3 0 R] /Count 1 >>',
        f'<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R /Resources '
        '<< /Font << /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>',
        f'<< /Length {len(stream)} >>\nstream\n{stream}\nendstream',
    )
    data, places = b'%PDF-1.4\n', []
    for number, content in enumerate(objects, 1):
        places.append(len(data))
        data += f'{number} 0 obj\n{content}\nendobj\n'.encode('latin-1')
    table = ''.join(f'{place:010} 00000 n \n' for place in places)
    end = (
        f'xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}trailer\n'
        f'<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(data)}\n%%EOF\n'
    )
    return data + end.encode('latin-1')
