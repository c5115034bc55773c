# SPDX-License-Identifier: Apache-2.0
"""The sheet every drawn image begins with: palette, sky, hills, layers of earth; and its pencil.

Coordinates are those of the SVG view box, 1600 x 900, x right, y down; the horizon lies at
`HORIZON`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

WIDTH = 1600
HEIGHT = 900
HORIZON = 520.0
FAULT_X = 800.0
"""Where a broken sheet's layers are displaced; the fault leans by `FAULT_LEAN` of its depth."""
FAULT_LEAN = 0.32
FAULT_THROW = 46.0
"""How far the right half hangs lower where the damage is whole."""
WEATHERS = ('clear', 'clouds', 'rain', 'snow', 'stars', 'fog')

Point = tuple[float, float]


@dataclass(frozen=True)
class Palette:
    """Colours of one pair; sky, hills and layers from top to bottom."""

    sky: tuple[str, str]
    disc: str
    hills: tuple[str, str]
    layers: tuple[str, ...]
    body: str
    shade: str
    line: str
    thread: str


PALETTES = (
    Palette(  # night blue, sulphur
        ('#0b1622', '#27445a'),
        '#e9dfbf',
        ('#1d3548', '#142838'),
        ('#0f1f2c', '#16293a', '#112231', '#1b3244', '#122433', '#0c1924'),
        '#0a141d',
        '#060d14',
        '#cfdbe0',
        '#f0c64a',
    ),
    Palette(  # rust
        ('#1c0f0c', '#6b3424'),
        '#f2cfa0',
        ('#4a2318', '#341810'),
        ('#26120c', '#3a1d13', '#2c150e', '#462417', '#301810', '#1e0e09'),
        '#190b07',
        '#100704',
        '#ecd9c4',
        '#ff7a3c',
    ),
    Palette(  # petrol
        ('#071716', '#22514d'),
        '#dfe8cf',
        ('#173d3a', '#0f2c2a'),
        ('#0b211f', '#12302d', '#0d2725', '#173b37', '#0f2a28', '#081917'),
        '#061311',
        '#040d0c',
        '#d2e2da',
        '#5fd3b4',
    ),
    Palette(  # slate, coral
        ('#14151b', '#474a58'),
        '#eedfd8',
        ('#32343f', '#23252e'),
        ('#191b22', '#262832', '#1e2028', '#2f323d', '#21232c', '#131419'),
        '#101117',
        '#0a0b0f',
        '#dcdde2',
        '#f2665c',
    ),
    Palette(  # plum
        ('#150d1b', '#4d3357'),
        '#f1dcc8',
        ('#38253f', '#281a2e'),
        ('#1c1221', '#2b1c31', '#211527', '#36243d', '#25182b', '#160e1a'),
        '#120a16',
        '#0b060e',
        '#e2d6e4',
        '#e59bd0',
    ),
    Palette(  # sand and ink
        ('#16130d', '#6a5c40'),
        '#f4ead0',
        ('#463d2a', '#322b1e'),
        ('#211c13', '#332c1e', '#282217', '#3f3726', '#2c261a', '#1a160f'),
        '#15110b',
        '#0d0b07',
        '#e9e1cc',
        '#9fd0ff',
    ),
)


def waves(rng: np.random.Generator, x: np.ndarray, height: float, length: float) -> np.ndarray:
    """Return a smooth random line over `x`: five sines, each half as long and half as high."""
    y = np.zeros_like(x, dtype=float)
    for octave in range(5):
        phase = rng.uniform(0, 2 * np.pi)
        stretch = rng.uniform(0.8, 1.25)
        y += 0.5**octave * np.sin(2 * np.pi * x * 2**octave * stretch / length + phase)
    return height * y / 2


def _points(points: Iterable[Point]) -> str:
    return ' '.join(f'{x:.1f},{y:.1f}' for x, y in points)


@dataclass(frozen=True)
class View:
    """From where and when a pair is seen: mirrored, how near and around which x, in what weather,
    with how many people in it. One half of a pair has the moon: both hang in one room."""

    mirrored: bool = False
    near: float = 1.0
    middle: float = 800.0
    weather: str = 'clear'
    moon: bool = True
    people: int = 0


class Sheet:
    """An image in the making; draws the land first, then what is asked for, in order.

    `damage` is 0 where the land is whole, and 1 where it is as broken as can be.
    """

    def __init__(
        self,
        palette: Palette,
        land: np.random.Generator,
        damage: float = 0.0,
        view: View | None = None,
    ):
        self.palette = palette
        self.damage = damage
        self.view = view or View()
        self.broken = damage > 0
        self.throw = FAULT_THROW * damage
        # Where people stand (None: none can be seen; NaN: nobody there), and down to where rain,
        # snow and fog fall (None: they do not come in).
        self.stands: Callable[[float], float] | None = self.footing
        self.falls_to: float | None = HORIZON
        self._parts: list[str] = []
        self._draw_land(land)

    # The pencil

    def polygon(self, points: Iterable[Point], fill: str, opacity: float = 1.0) -> None:
        """Fill a closed shape."""
        self._parts.append(
            f'<polygon points="{_points(points)}" fill="{fill}"{_opacity(opacity)}/>'
        )

    def rect(self, x: float, y: float, w: float, h: float, fill: str, opacity: float = 1.0) -> None:
        """Fill an upright rectangle from its top left corner."""
        self.polygon([(x, y), (x + w, y), (x + w, y + h), (x, y + h)], fill, opacity)

    def line(
        self,
        points: Iterable[Point],
        stroke: str | None = None,
        width: float = 2.0,
        opacity: float = 1.0,
        dash: str = '',
    ) -> None:
        """Draw an open line; `stroke` defaults to the palette's line colour."""
        colour = stroke or self.palette.line
        dashes = f' stroke-dasharray="{dash}"' if dash else ''
        self._parts.append(
            f'<polyline points="{_points(points)}" fill="none" stroke="{colour}"'
            f' stroke-width="{width:g}"{dashes}{_opacity(opacity)}/>'
        )

    def disc(self, x: float, y: float, r: float, fill: str, opacity: float = 1.0) -> None:
        """Fill a circle."""
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" fill="{fill}"{_opacity(opacity)}/>'
        )

    def ellipse(
        self, x: float, y: float, rx: float, ry: float, fill: str, opacity: float = 1.0
    ) -> None:
        """Fill an ellipse that lies along the axes."""
        self._parts.append(
            f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{rx:.1f}" ry="{ry:.1f}" fill="{fill}"'
            f'{_opacity(opacity)}/>'
        )

    def ring(self, x: float, y: float, r: float, width: float = 2.0, opacity: float = 1.0) -> None:
        """Draw a circle's outline in the line colour."""
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" fill="none"'
            f' stroke="{self.palette.line}" stroke-width="{width:g}"{_opacity(opacity)}/>'
        )

    def marks(self, strokes: Iterable[tuple[Point, Point]], width: float, opacity: float) -> None:
        """Draw many strokes (start, step) that do not meet, as one path; step (0, 0): a dot."""
        d = ''.join(f'M{x:.1f} {y:.1f}l{dx:.1f} {dy:.1f}' for (x, y), (dx, dy) in strokes)
        self._parts.append(
            f'<path d="{d}" fill="none" stroke="{self.palette.line}" stroke-width="{width:g}"'
            f'{_opacity(opacity)}/>'
        )

    def thread(self, points: Iterable[Point], width: float = 4.0) -> None:
        """Draw the pair's thread of light: a line with a soft glow of its own."""
        points = list(points)
        for widen, opacity in ((7.0, 0.07), (3.5, 0.14)):
            self.line(points, self.palette.thread, width * widen, opacity)
        self.line(points, self.palette.thread, width)

    def truss(
        self, a: Point, b: Point, top_a: Point, top_b: Point, bays: int, width: float = 2.0
    ) -> None:
        """Draw a braced mast between the feet `a`, `b` and the heads `top_a`, `top_b`."""
        self.line([a, top_a], width=width * 1.4)
        self.line([b, top_b], width=width * 1.4)
        feet, heads = np.array([a, b], float), np.array([top_a, top_b], float)
        for i in range(bays):
            low = feet + (heads - feet) * i / bays
            high = feet + (heads - feet) * (i + 1) / bays
            self.line([low[0], high[1]], width=width * 0.7, opacity=0.85)
            self.line([low[1], high[0]], width=width * 0.7, opacity=0.85)
            self.line([high[0], high[1]], width=width * 0.7, opacity=0.85)

    def crack(
        self,
        rng: np.random.Generator,
        start: Point,
        end: Point,
        rough: float,
        width: float,
        share: float = 1.0,
    ) -> list[Point]:
        """Draw a branching fissure from `start` to `end`, or its first part; return its points."""
        points = jagged(rng, start, end, rough)
        points = points[: max(round(share * len(points)), 2)]
        self.thread(points, width)
        for i in range(3, len(points) - 3, 4):
            if rng.random() < 0.6:
                x, y = points[i]
                side = rng.choice([-1, 1])
                reach = rough * rng.uniform(2.0, 4.5)
                lean = rng.uniform(-0.4, 0.9)
                branch = jagged(rng, (x, y), (x + side * reach, y + lean * reach), rough * 0.35)
                self.line(branch, self.palette.thread, width * 0.45, 0.9)
        return points

    # The land

    def ground(self, x: float) -> float:
        """Return the height of the surface at `x`: level, and stepped where the sheet is broken."""
        return HORIZON + (self.throw if x > FAULT_X else 0.0)

    def footing(self, x: float) -> float:
        """Return where somebody stands at `x`: on the ground, NaN on the step of the fault."""
        on_step = 0 <= x - FAULT_X <= FAULT_LEAN * self.throw
        return float('nan') if self.broken and on_step else self.ground(x)

    def _draw_land(self, rng: np.random.Generator) -> None:
        look = self.palette
        sun_x = rng.uniform(260, 1340)
        sun_y, sun_r = rng.uniform(150, 300), rng.uniform(62, 105)
        self._draw_sky(apart(rng), (sun_x, sun_y), sun_r)
        x = np.linspace(0, WIDTH, 161)
        for hill, (base, height) in zip(look.hills, ((70, 95), (26, 46)), strict=True):
            y = HORIZON - base + waves(rng, x, height, rng.uniform(900, 1700))
            outline = [*zip(x, np.minimum(y, HORIZON), strict=True), (WIDTH, HORIZON), (0, HORIZON)]
            self.polygon(outline, hill)
        tops = np.linspace(0, HEIGHT - HORIZON, len(look.layers) + 1)[:-1]
        for number, (top, colour) in enumerate(zip(tops, look.layers, strict=True)):
            bend = waves(rng, x, 0.0 if number == 0 else 17.0, rng.uniform(1100, 2000))
            seam = HORIZON + top + bend
            for xs, ys in self._halves(x, seam):
                foot = FAULT_X + FAULT_LEAN * (HEIGHT - HORIZON)  # both halves meet along the fault
                right = WIDTH if xs[-1] == WIDTH else foot
                left = 0 if xs[0] == 0 else foot
                self.polygon([*zip(xs, ys, strict=True), (right, HEIGHT), (left, HEIGHT)], colour)
                if number:
                    self.line(zip(xs, ys, strict=True), width=1.2, opacity=0.22)
            self._texture(rng, number, HORIZON + top + 26)
        for xs, ys in self._halves(x, np.full_like(x, HORIZON)):
            self.line(zip(xs, ys, strict=True), width=2.5, opacity=0.9)

    def _draw_sky(self, rng: np.random.Generator, sun: Point, r: float) -> None:
        """One disc in the sky, and the weather before it."""
        look, weather = self.palette, self.view.weather
        veiled = weather in ('rain', 'snow', 'fog')
        if weather == 'stars':
            for _ in range(130):
                x, y = rng.uniform(0, WIDTH), HORIZON * rng.random() ** 1.6
                self.disc(x, y, rng.uniform(0.7, 1.9), look.disc, rng.uniform(0.3, 0.8))
        if self.view.moon:
            self.disc(*sun, r * (2.6 if weather == 'fog' else 1.9), look.disc, 0.05)
        if self.view.moon and weather == 'stars':
            turn = np.linspace(-np.pi / 2, np.pi / 2, 24)
            outer = [(sun[0] + r * np.cos(a), sun[1] + r * np.sin(a)) for a in turn]
            inner = [(sun[0] + 0.55 * r * np.cos(a), sun[1] + r * np.sin(a)) for a in turn[::-1]]
            self.polygon([*outer, *inner], look.disc, 0.88)
        elif self.view.moon:
            self.disc(*sun, r, look.disc, 0.3 if veiled else 0.88)
        if weather in ('clouds', 'rain', 'snow'):
            for _ in range(7):
                x, y, wide = rng.uniform(-100, WIDTH), rng.uniform(60, 300), rng.uniform(160, 460)
                for k in range(5):
                    cx, cr = x + wide * k / 4, wide * (0.16 - 0.03 * abs(k - 2)) + 14
                    self.ellipse(cx, y, 1.5 * cr, 0.5 * cr, look.hills[0], 0.6)

    def draw_weather(self, rng: np.random.Generator) -> None:
        """What falls or lies before everything: rain, snow, fog; and people, for the scale."""
        look, weather = self.palette, self.view.weather
        for _ in range(self.view.people if self.stands else 0):
            x = rng.uniform(120, 1480)
            y, tall = self.stands(x), rng.uniform(24, 30)
            if np.isfinite(y):
                self.person(x, y, tall, rng)
        low = self.falls_to
        if low is None:
            return
        if weather == 'rain':
            drops = rng.uniform((0, -20, 16), (WIDTH, low, 44), (240, 3))
            self.marks((((x, y), (-0.22 * s, s)) for x, y, s in drops), 1.1, 0.26)
        if weather == 'snow':
            for _ in range(200):
                x, y = rng.uniform(0, WIDTH), rng.uniform(0, low)
                self.disc(x, y, rng.uniform(1.2, 3.2), look.line, rng.uniform(0.25, 0.65))
        if weather == 'fog':
            for k in range(6):
                self.rect(0, low - 26 - 30 * k, WIDTH, 34, look.sky[1], 0.3 - 0.035 * k)

    def person(self, x: float, y: float, tall: float, rng: np.random.Generator) -> None:
        """Draw somebody who stands at (x, y)."""
        width = tall / 27  # of a line that is one wide at a usual size
        colour, lean = self.palette.line, rng.uniform(-0.06, 0.06) * tall
        hip, neck = (x, y - 0.48 * tall), (x + lean, y - 0.8 * tall)
        for foot in (-0.12, 0.12):
            self.line([(x + foot * tall, y), hip], colour, round(2.6 * width, 2))
        self.line([hip, neck], colour, round(4.4 * width, 2))
        self.line([neck, (x + lean + 0.16 * tall, y - 0.56 * tall)], colour, round(2 * width, 2))
        self.disc(x + lean, y - 0.9 * tall, 0.1 * tall, colour)

    def _halves(self, x: np.ndarray, y: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Split a seam at the fault when broken; the right half hangs lower by the throw."""
        if not self.broken:
            return [(x, y)]
        cut = FAULT_X + FAULT_LEAN * (np.interp(FAULT_X, x, y) - HORIZON)
        at_cut = np.interp(cut, x, y)
        low = self.throw
        left, right = x < cut, x > cut
        return [
            (np.append(x[left], cut), np.append(y[left], at_cut)),
            (np.insert(x[right], 0, cut + FAULT_LEAN * low), np.insert(y[right], 0, at_cut) + low),
        ]

    def _texture(self, rng: np.random.Generator, layer: int, y: float) -> None:
        """Mark a layer as a geologist would: dashes, dots or strokes, faint."""
        dot, dash, stroke = (
            ((0.0, 0.0), 3.0, 0.16),
            ((26.0, 0.0), 1.2, 0.13),
            ((9.0, -14.0), 1.2, 0.13),
        )
        step, width, opacity = (dot, dash, stroke)[layer % 3]
        strokes = []
        for _ in range(46):
            x, dy = rng.uniform(0, WIDTH), rng.uniform(-6, 26)
            drop = self.throw if x > FAULT_X + FAULT_LEAN * (y - HORIZON) else 0.0
            strokes.append(((x, y + dy + drop - step[1] / 2), step))
        self.marks(strokes, width, opacity)

    def _seen(self) -> str:
        """The transform by which the drawing fills the sheet as its view has it."""
        view = self.view
        if view.near == 1 and not view.mirrored:
            return ''
        left = min(max(view.middle - WIDTH / 2 / view.near, 0), WIDTH - WIDTH / view.near)
        top = (HORIZON - 0.54 * HEIGHT / view.near) if view.near > 1 else 0.0
        top = min(max(top, 0), HEIGHT - HEIGHT / view.near)
        flip = f'translate({WIDTH} 0) scale(-1 1) ' if view.mirrored else ''
        return f' transform="{flip}scale({view.near:g}) translate({-left:.1f} {-top:.1f})"'

    def svg(self) -> str:
        """Return the finished image as SVG text."""
        top, low = self.palette.sky
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
            f'width="{WIDTH}" height="{HEIGHT}" preserveAspectRatio="xMidYMid slice">\n'
            f'<defs><linearGradient id="sky" x1="0" y1="0" x2="0" y2="1"><stop offset="0" '
            f'stop-color="{top}"/><stop offset="1" stop-color="{low}"/></linearGradient></defs>\n'
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="url(#sky)"/>\n'
            f'<g stroke-linejoin="round" stroke-linecap="round"{self._seen()}>\n'
            + '\n'.join(self._parts)
            + '\n</g>\n</svg>\n'
        )


def apart(rng: np.random.Generator) -> np.random.Generator:
    """Return a generator for a part whose draws shall not shift those that follow."""
    return np.random.default_rng(rng.integers(2**63))


def jagged(rng: np.random.Generator, start: Point, end: Point, rough: float) -> list[Point]:
    """Return a broken line from `start` to `end`; `rough` is the sideways scatter."""
    ends = np.array([start, end], float)
    length = float(np.hypot(*(ends[1] - ends[0])))
    count = max(int(length / 24), 3)
    along = np.linspace(0, 1, count + 1)
    along[1:-1] += rng.uniform(-0.3, 0.3, count - 1) / count
    side = rng.normal(0, rough / 2, count + 1)
    side[[0, -1]] = 0
    normal = np.array([-(ends[1] - ends[0])[1], (ends[1] - ends[0])[0]]) / max(length, 1e-9)
    points = ends[0] + along[:, None] * (ends[1] - ends[0]) + side[:, None] * normal
    return [(float(px), float(py)) for px, py in points]


def _opacity(value: float) -> str:
    return '' if value >= 1 else f' opacity="{value:.2g}"'
