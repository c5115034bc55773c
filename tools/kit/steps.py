# SPDX-License-Identifier: Apache-2.0
"""Pictures of the assembly: boxes and covers in parallel projection, drawn from behind forwards."""

from xml.sax.saxutils import escape

import numpy as np

from eol_ros.core.geometry import COLS, rest_lattice, spring_ends
from eol_ros.core.terrain import cover_mesh, landscape, tile
from kit.drawings import (
    BALLAST_SIDE,
    BAR,
    BAR_INSIDE,
    BOARD,
    CASTER,
    COVER,
    FLOOR,
    GAP,
    HEIGHT,
    INSET,
    JIG_DEEP,
    JIG_PLAY,
    JIG_WIDE,
    PITCH,
    PLATFORM,
    PULL,
    RIM,
    SIDE,
    WALL,
)

# seen from the front right, above: rows are right, up and towards the viewer
_RIGHT = np.array([np.cos(0.6), np.sin(0.6), 0.0])
_TOWARDS = np.array([np.sin(0.6) * np.cos(0.6), -np.cos(0.6) * np.cos(0.6), np.sin(0.6)])
_UP = np.cross(_TOWARDS, _RIGHT)
_LIGHT = np.array([0.35, -0.55, 0.76])
WIDTH, HEIGHT_PX, MARGIN = 720, 460, 20
CELLS = 14
LAND = landscape(1, cells=CELLS)


class View:
    """Faces and lines of one picture."""

    def __init__(self) -> None:
        self._drawn: list[tuple[float, np.ndarray, str, bool]] = []
        self._words: list[tuple[np.ndarray, str]] = []

    def face(
        self, points: np.ndarray, colour: tuple[int, int, int], edge: bool = True, nearer: float = 0
    ) -> None:
        """Draw a flat face, shaded by how it lies; one that looks away is left out."""
        points = np.asarray(points, float)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal = normal / (np.linalg.norm(normal) or 1.0)
        if normal @ _TOWARDS <= 1e-9:
            return
        shade = 0.62 + 0.38 * max(0.0, float(normal @ _LIGHT))
        rgb = '#' + ''.join(f'{round(c * shade):02x}' for c in colour)
        style = f'fill:{rgb};stroke:{"#222" if edge else rgb};stroke-width:0.7'
        self._drawn.append((float((points @ _TOWARDS).mean()) + nearer, points, style, True))

    def box(
        self, x: float, y: float, z: float, size: tuple[float, float, float],
        colour: tuple[int, int, int], cut: int = 1, nearer: float = 0,
    ) -> None:  # fmt: skip
        """Draw a box; x, y is the middle of its underside. `cut` into so many, to be sorted."""
        w, d, h = size
        for k in range(cut):
            off = (k + 0.5) / cut - 0.5
            at, part = (x + off * w, y), (w / cut, d, h)
            if w < d:
                at, part = (x, y + off * d), (w, d / cut, h)
            self._box(*at, z, part, colour, cut == 1, nearer)

    def _box(self, x, y, z, size, colour, edge, nearer) -> None:
        w, d, h = size
        p = np.array([[sx * w / 2, sy * d / 2, sz * h] for sz in (0, 1)
                      for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) + [x, y, z]  # fmt: skip
        for face in ((4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)):
            self.face(p[list(face)], colour, edge, nearer)

    def line(self, a, b, style: str = 'stroke:#888;stroke-width:1.2', nearer: float = 0.0) -> None:
        """Draw from a to b; `nearer` draws it as if it were so much closer."""
        points = np.array([a, b], float)
        self._drawn.append((float((points @ _TOWARDS).mean()) + nearer, points, style, False))

    def body(self, x: float, y: float, z: float = 0.0) -> None:
        """An open body with its pins."""
        plastic, half, mid = (214, 208, 196), SIDE / 2, (SIDE - WALL) / 2
        self.box(x, y, z, (SIDE, SIDE, FLOOR), plastic)
        for sx, sy in ((0, 1), (-1, 0), (1, 0), (0, -1)):
            size = (SIDE, WALL, HEIGHT) if sy else (WALL, SIDE - 2 * WALL, HEIGHT)
            self.box(x + sx * mid, y + sy * mid, z, size, plastic)
        for sx, sy in ((1, 0), (0, -1)):
            a, b = np.array([-sy * 4.0, sx * 4.0]), np.array([sx * half, sy * half]) + [x, y]
            corners = [
                (*(b - a), PULL - 5),
                (*(b + a), PULL - 5),
                (*(b + a), PULL + 5),
                (*(b - a), PULL + 5),
            ]
            hole = np.array(corners) + [0, 0, z] + np.array([sx, sy, 0]) * 0.1
            self._drawn.append(
                (
                    float((hole @ _TOWARDS).mean()) + 60,
                    hole,
                    'fill:#444;stroke:#222;stroke-width:0.7',
                    True,
                )
            )
            pin = b - np.array([sx, sy]) * INSET
            self.line(
                (*pin, z + PULL - 5), (*pin, z + PULL + 5), 'stroke:#ddd;stroke-width:2.4', 120
            )

    def cover(self, block: int, x: float, y: float, z: float) -> None:
        """A cover, its rim at z."""
        for triangle in cover_mesh(tile(LAND, *divmod(block, COLS), CELLS), COVER):
            self.face(triangle + [x, y, z], (236, 240, 246), edge=False)

    def land(self, block: int, x: float, y: float, z: float) -> None:
        """A cover seen from afar: its land and its sides."""
        heights = COVER.skirt_mm + COVER.relief_mm * tile(LAND, *divmod(block, COLS), CELLS)
        step, at = 2, np.linspace(-SIDE / 2, SIDE / 2, CELLS + 1)
        for i in range(0, CELLS, step):
            for j in range(0, CELLS, step):
                around = ((i, j), (i, j + step), (i + step, j + step), (i + step, j))
                face = np.array([[x + at[q], y + at[p], z + heights[p, q]] for p, q in around])
                self.face(face, (236, 240, 246), edge=False, nearer=60)
        for edge, way in ((heights[0], (1, 0)), (heights[:, -1], (0, 1))):
            side = np.array([way[1], -way[0]]) * SIDE / 2 + [x, y]
            top = [[*(side + np.array(way) * a), z + h] for a, h in zip(at, edge, strict=True)]
            corners = [[*top[0][:2], z], [*top[-1][:2], z], *top[::-1]]
            self.face(corners, (236, 240, 246), nearer=60)

    def say(self, at, words: str) -> None:
        """Write at a place."""
        self._words.append((np.array(at, float), words))

    def svg(self, title: str) -> str:
        """Return the picture."""
        plane = [np.stack([p @ _RIGHT, -(p @ _UP)], axis=1) for _, p, _, _ in self._drawn]
        low, high = np.concatenate(plane).min(axis=0), np.concatenate(plane).max(axis=0)
        if self._words:
            high = high + [20, 0]
        scale = min(
            (WIDTH - 2 * MARGIN) / (high - low)[0], (HEIGHT_PX - 2 * MARGIN) / (high - low)[1]
        )
        shift = (np.array([WIDTH, HEIGHT_PX]) - (low + high) * scale) / 2
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT_PX}" '
            f'viewBox="0 0 {WIDTH} {HEIGHT_PX}" font-family="sans-serif" font-size="15">',
            f'<title>{escape(title)}</title>',
            '<rect width="100%" height="100%" fill="white"/>',
        ]
        order = sorted(range(len(plane)), key=lambda k: self._drawn[k][0])
        for k in order:
            _, _, style, closed = self._drawn[k]
            points = ' '.join(f'{x:.1f},{y:.1f}' for x, y in plane[k] * scale + shift)
            kind = 'polygon' if closed else 'polyline'
            parts.append(f'<{kind} points="{points}" style="{style}" stroke-linejoin="round"/>')
        for at, words in self._words:
            x, y = np.array([at @ _RIGHT, -(at @ _UP)]) * scale + shift
            parts.append(f'<text x="{x:.1f}" y="{y:.1f}">{escape(words)}</text>')
        return '\n'.join([*parts, '</svg>', ''])


GREEN, STEEL, SILVER = (90, 140, 100), (150, 155, 165), (205, 208, 214)
WOOD, GREY, BLUE = (214, 178, 128), (196, 192, 186), (110, 130, 190)


def inside() -> str:
    """What lies in a body, lifted out of it."""
    v = View()
    v.body(0, 0)
    v.box(0, 0, 58, (BALLAST_SIDE, BALLAST_SIDE, 2.4), STEEL)
    v.box(0, 0, 78, (60, 36, 7), BLUE)
    v.box(0, 0, 108, (*BOARD, 1.6), GREEN)
    v.box(-8, 2, 109.6, (36, 9, 8), (50, 50, 55))
    v.box(24, 12, 109.6, (16, 20, 2), (60, 90, 160))
    v.box(26, -14, 109.6, (15, 15, 2), (120, 60, 120))
    v.box(0, -18, 109.6, (5, 5, 8), (250, 250, 250))
    v.box(10, -18, 109.6, (5, 5, 8), (70, 30, 60))
    for z, words in ((60, 'steel plate'), (82, 'cell'), (112, 'board'), (20, 'body')):
        v.say((84, -10, z), words)
    return v.svg('Steel plate, cell and board go into the body')


def covering() -> str:
    """A cover above its body."""
    v = View()
    v.body(0, 0)
    v.cover(12, 0, 0, HEIGHT + 34)
    v.say((92, -4, HEIGHT + 26), 'lip, 6 mm')
    return v.svg('The lip of the cover goes into the body')


def hooking() -> str:
    """A row of blocks between two combs."""
    v = View()
    for k in range(COLS):
        v.body((k - 2) * PITCH, 0)
    for side in (-1, 1):
        depth = SIDE / 2 + JIG_WIDE - JIG_DEEP
        v.box(
            0,
            side * (depth - (JIG_WIDE - JIG_DEEP) / 2),
            0,
            (820, JIG_WIDE - JIG_DEEP, 6),
            WOOD,
            41,
        )
        for k in range(COLS - 1):
            x = (k - 1.5) * PITCH
            v.box(x, side * (SIDE / 2 - JIG_DEEP / 2), 0, (GAP - JIG_PLAY, JIG_DEEP, 6), WOOD)
    for k in range(COLS - 1):
        v.line(
            ((k - 2) * PITCH + SIDE / 2, 0, PULL),
            ((k - 1) * PITCH - SIDE / 2, 0, PULL),
            'stroke:#333;stroke-width:2.2;stroke-dasharray:2 1.2',
            60,
        )
    return v.svg('Two combs hold a row while its springs are hooked in')


def together() -> str:
    """The table."""
    v = View()
    v.box(0, 0, -30, (PLATFORM, PLATFORM, 29), GREY, nearer=-3000)
    rest = np.column_stack([rest_lattice(), np.zeros(25)])
    for a, b in 1e3 * spring_ends(rest, np.zeros(3)):
        v.line((*a, PULL), (*b, PULL), 'stroke:#444;stroke-width:1.6;stroke-dasharray:2 1', 30)
    for n, (x, y, _) in enumerate(1e3 * rest):
        v.box(x, y, 0, (SIDE, SIDE, HEIGHT), (214, 208, 196))
        v.land(n, x, y, HEIGHT)
    middle = RIM / 2 - BAR_INSIDE + BAR[0] / 2
    for side in (-1, 1):
        v.box(0, side * middle, CASTER, (2 * middle + BAR[0], *BAR), SILVER, 30)
        v.box(side * middle, 0, CASTER, (BAR[0], 2 * middle - BAR[0], BAR[1]), SILVER, 30)
        for other in (-1, 1):
            v.box(side * middle, other * middle, 0, (14, 14, CASTER), (70, 70, 75))
    return v.svg('Blocks, springs and rim on the platform')


STEPS = {'step1': inside, 'step2': covering, 'step3': hooking, 'step4': together}
