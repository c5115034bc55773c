# SPDX-License-Identifier: Apache-2.0
"""A drawing in mm, written as DXF (ezdxf) for cutters and CAD, and as SVG to look at.

x to the right, y upwards. Layers: outline is to be cut, hidden lies behind, centre marks axes,
dimension and text are for people.
"""

import io
import math
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

import ezdxf
from ezdxf import units
from ezdxf.document import Drawing
from ezdxf.enums import TextEntityAlignment

LAYERS = {'outline': 7, 'hidden': 8, 'centre': 1, 'dimension': 5, 'text': 3}
STYLES = {
    'outline': 'stroke:#111;stroke-width:1.6',
    'hidden': 'stroke:#777;stroke-width:1;stroke-dasharray:5 3',
    'centre': 'stroke:#b33;stroke-width:0.7;stroke-dasharray:9 2 2 2',
    'dimension': 'stroke:#235;stroke-width:0.7',
}
WIDTH_PX, MARGIN_PX = 1100.0, 24.0

Point = tuple[float, float]


@dataclass
class Sheet:
    """What is drawn, in the order in which it was; `text_mm` is the height of letters."""

    title: str
    text_mm: float = 4.0
    lines: list[tuple[str, list[Point], bool]] = field(default_factory=list)
    circles: list[tuple[str, Point, float]] = field(default_factory=list)
    dims: list[tuple[Point, Point, Point, float, str]] = field(default_factory=list)
    words: list[tuple[Point, str, str]] = field(default_factory=list)

    def line(self, *points: Point, layer: str = 'outline', closed: bool = False) -> None:
        """Draw through all points."""
        self.lines.append((layer, list(points), closed))

    def rect(self, x: float, y: float, width: float, height: float, layer: str = 'outline') -> None:
        """Draw a rectangle; x, y is its lower left corner."""
        corners = ((x, y), (x + width, y), (x + width, y + height), (x, y + height))
        self.line(*corners, layer=layer, closed=True)

    def square(self, x: float, y: float, side: float, layer: str = 'outline') -> None:
        """Draw a square about x, y."""
        self.rect(x - side / 2, y - side / 2, side, side, layer)

    def circle(self, x: float, y: float, diameter: float, layer: str = 'outline') -> None:
        """Draw a circle about x, y."""
        self.circles.append((layer, (x, y), diameter / 2))

    def dim(self, a: Point, b: Point, away: float, vertical: bool = False, note: str = '') -> None:
        """Dimension the distance from a to b along x (or y), its line `away` from a."""
        base = (a[0] + away, a[1]) if vertical else (a[0], a[1] + away)
        self.dims.append((a, b, base, 90.0 if vertical else 0.0, note))

    def say(self, x: float, y: float, words: str, align: str = 'left') -> None:
        """Write, its baseline beginning (or having its middle) at x, y."""
        self.words.append(((x, y), words, align))

    def measured(self) -> list[float]:
        """Return the lengths that are dimensioned, mm."""
        return [abs(b[1] - a[1]) if angle else abs(b[0] - a[0]) for a, b, _, angle, _ in self.dims]

    def dxf(self) -> str:
        """Return the drawing as DXF, with dimensions that a program can read."""
        ezdxf.options.write_fixed_meta_data_for_testing = True  # the same text each time
        doc: Drawing = ezdxf.new('R2010', setup=['linetypes', 'styles', 'dimstyles'])
        doc.units = units.MM
        for name, colour in LAYERS.items():
            linetype = {'hidden': 'DASHED', 'centre': 'CENTER'}.get(name, 'Continuous')
            doc.layers.add(name.upper(), color=colour, linetype=linetype)
        space = doc.modelspace()
        for layer, points, closed in self.lines:
            space.add_lwpolyline(points, close=closed, dxfattribs={'layer': layer.upper()})
        for layer, centre, radius in self.circles:
            space.add_circle(centre, radius, dxfattribs={'layer': layer.upper()})
        style = {
            'dimtxt': self.text_mm, 'dimasz': self.text_mm * 0.7, 'dimexe': self.text_mm / 3,
            'dimexo': self.text_mm / 3, 'dimgap': self.text_mm / 4, 'dimdec': 2, 'dimzin': 8,
            'dimscale': 1, 'dimlfac': 1, 'dimtad': 1, 'dimtih': 0, 'dimtoh': 0,
        }  # fmt: skip
        for a, b, base, angle, note in self.dims:
            space.add_linear_dim(
                base=base, p1=a, p2=b, angle=angle, dimstyle='EZDXF', override=style,
                text=f'<>{" " + note if note else ""}', dxfattribs={'layer': 'DIMENSION'},
            ).render()  # fmt: skip
        for at, words, align in self.words:
            place = {'left': TextEntityAlignment.LEFT, 'middle': TextEntityAlignment.CENTER}[align]
            space.add_text(words, height=self.text_mm, dxfattribs={'layer': 'TEXT'}).set_placement(
                at, align=place
            )
        text = io.StringIO()
        doc.write(text)
        return text.getvalue()

    def _box(self) -> tuple[float, float, float, float]:
        points = [p for _, line, _ in self.lines for p in line]
        points += [(x + s * r, y + s * r) for _, (x, y), r in self.circles for s in (-1, 1)]
        points += [p for a, b, base, _, _ in self.dims for p in (a, b, base)]
        for (x, y), words, align in self.words:
            wide = 0.6 * self.text_mm * len(words)
            left = x - wide / 2 if align == 'middle' else x
            points += [(left, y), (left + wide, y + self.text_mm)]
        xs, ys = zip(*points, strict=True)
        return min(xs), min(ys) - self.text_mm, max(xs), max(ys) + self.text_mm * 1.5

    def svg(self) -> str:
        """Return the drawing as SVG."""
        left, low, right, high = self._box()
        scale = (WIDTH_PX - 2 * MARGIN_PX) / (right - left)
        height = (high - low) * scale + 2 * MARGIN_PX

        def at(point: Point) -> str:
            x = MARGIN_PX + (point[0] - left) * scale
            return f'{x:.2f},{height - MARGIN_PX - (point[1] - low) * scale:.2f}'

        size = self.text_mm * scale
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH_PX:g}" height="{height:.0f}" '
            f'viewBox="0 0 {WIDTH_PX:g} {height:.0f}" font-family="sans-serif" '
            f'font-size="{size:.1f}">',
            f'<title>{escape(self.title)}</title>',
            '<rect width="100%" height="100%" fill="white"/>',
        ]
        for layer, points, closed in self.lines:
            kind = 'polygon' if closed else 'polyline'
            joined = ' '.join(map(at, points))
            parts.append(f'<{kind} points="{joined}" fill="none" style="{STYLES[layer]}"/>')
        for layer, centre, radius in self.circles:
            x, y = at(centre).split(',')
            parts.append(
                f'<circle cx="{x}" cy="{y}" r="{radius * scale:.2f}" fill="none" '
                f'style="{STYLES[layer]}"/>'
            )
        for (a, b, base, angle, note), value in zip(self.dims, self.measured(), strict=True):
            ends = [(base[0], p[1]) if angle else (p[0], base[1]) for p in (a, b)]
            for p, end in zip((a, b), ends, strict=True):
                parts.append(_path([at(p), at(end)]))
            parts.append(_path([at(e) for e in ends]))
            parts += [self._arrow(at(ends[0]), at(ends[1])), self._arrow(at(ends[1]), at(ends[0]))]
            x, y = ((float(u) + float(v)) / 2 for u, v in zip(
                at(ends[0]).split(','), at(ends[1]).split(','), strict=True))  # fmt: skip
            turn = f' transform="rotate(-90 {x:.2f} {y:.2f})"' if angle else ''
            words = escape(f'{value:.2f}'.rstrip('0').rstrip('.') + (f' {note}' if note else ''))
            parts.append(
                f'<text x="{x:.2f}" y="{y - size / 4:.2f}" fill="#235" text-anchor="middle"'
                f'{turn}>{words}</text>'
            )
        for point, words, align in self.words:
            x, y = at(point).split(',')
            anchor = ' text-anchor="middle"' if align == 'middle' else ''
            parts.append(f'<text x="{x}" y="{y}"{anchor}>{escape(words)}</text>')
        return '\n'.join([*parts, '</svg>', ''])

    def _arrow(self, tip: str, other: str) -> str:
        (x, y), (u, v) = ([float(n) for n in p.split(',')] for p in (tip, other))
        length = math.hypot(u - x, v - y) or 1.0
        dx, dy = (u - x) / length * 7, (v - y) / length * 7
        sides = [(x + dx - dy * 0.3, y + dy + dx * 0.3), (x + dx + dy * 0.3, y + dy - dx * 0.3)]
        points = ' '.join(f'{p:.2f},{q:.2f}' for p, q in [(x, y), *sides])
        return f'<polygon points="{points}" fill="#235"/>'


def _path(points: list[str]) -> str:
    return f'<polyline points="{" ".join(points)}" fill="none" style="{STYLES["dimension"]}"/>'
