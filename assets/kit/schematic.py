# SPDX-License-Identifier: Apache-2.0
"""A schematic, drawn with schemdraw from its netlist, pins joined by names of nets."""

import schemdraw
import schemdraw.elements as elm

from assets.kit.netlist import Circuit, Part

Point = tuple[float, float]
POWER = {'+3V3', '+5V', 'BATT', 'CELL'}
# where a group stands: left edge and top, in units of schemdraw
PLACES = {
    'controller': (0.0, 0.0),
    'supply': (38.0, 0.0),
    'accelerometer': (22.0, -14.0),
    'radio': (22.0, 0.0),
    'light': (38.0, -21.0),
    'measuring': (0.0, -25.0),
    'host': (38.0, 0.0),
}
BOX_WIDTH, PIN_STEP, STUB = 4.5, 1.0, 1.0
COLUMN, ROW = 10.5, 4.6  # of boxes, of two-pin parts


def _label(
    drawing: schemdraw.Drawing, at: Point, text: str, align: tuple[str, str], size: int
) -> None:
    """Write a text; `align` is how it lies at its place, across and up."""
    label = elm.Label().theta(0).at(at)
    drawing += label.label(text, halign=align[0], valign=align[1], fontsize=size, ofst=0)


def _tag(drawing: schemdraw.Drawing, net: str, at: Point, side: str) -> None:
    """Draw a stub from a pin, and its net."""
    dx, dy, right, up, align = {
        'left': (-STUB, 0, -0.25, 0, ('right', 'center')),
        'right': (STUB, 0, 0.25, 0, ('left', 'center')),
        'up': (0, STUB / 2, 0, 0.15, ('center', 'bottom')),
        'down': (0, -STUB / 2, 0, -0.55, ('center', 'bottom')),
    }[side]
    end = (at[0] + dx, at[1] + dy)
    drawing += elm.Line().at(at).to(end)
    if net == 'GND' and side != 'up':
        drawing += elm.Ground().at(end).theta(0)
        return
    if not net:
        drawing += elm.NoConnect().theta(0).at(end)
        return
    if net in POWER:
        drawing += elm.Dot(open=True).theta(0).at(end)
    _label(drawing, (end[0] + right, end[1] + up), net, align, 11)


def _box(drawing: schemdraw.Drawing, circuit: Circuit, part: Part, x: float, top: float) -> float:
    """Draw a part of many pins; return how far down it reaches."""
    pins = [(name, number) for name, numbers in part.pins.items() for number in numbers or ['']]
    if all(part.pins.values()):
        pins.sort(key=lambda pin: pin[1])
    half = (len(pins) + 1) // 2 if len(pins) > 4 else 0
    sides = {'left': pins[:half], 'right': pins[half:][::-1] if half else pins}
    height = (max(map(len, sides.values())) + 1) * PIN_STEP
    drawing += elm.Rect(corner1=(0, 0), corner2=(BOX_WIDTH, -height)).theta(0).at((x, top))
    title = f'{part.ref}  {part.name}'
    _label(drawing, (x + BOX_WIDTH / 2, top + 0.15), title, ('center', 'bottom'), 12)
    for side, edge, inwards in (('left', x, 1), ('right', x + BOX_WIDTH, -1)):
        other = 'right' if side == 'left' else 'left'
        for row, (name, number) in enumerate(sides[side]):
            y = top - (row + 1) * PIN_STEP
            _label(drawing, (edge + 0.2 * inwards, y), name, (side, 'center'), 11)
            at = (edge - 0.15 * inwards, y + 0.05)
            _label(drawing, at, str(number), (other, 'bottom'), 8)
            _tag(drawing, circuit.net(part.ref, name), (edge, y), side)
    return height


def _small(drawing: schemdraw.Drawing, circuit: Circuit, part: Part, x: float, y: float) -> None:
    """Draw a resistor, capacitor or LED upright, the first pin above."""
    kinds = {'R': elm.Resistor, 'C': elm.Capacitor, 'D': elm.LED}
    first, second = part.pins
    symbol = kinds[part.ref[0]]().at((x, y)).down().length(2.0)
    drawing += symbol.label(f'{part.ref}\n{part.name}', loc='bottom', fontsize=11)
    _tag(drawing, circuit.net(part.ref, first), (x, y), 'up')
    _tag(drawing, circuit.net(part.ref, second), (x, y - 2.0), 'down')


def draw(circuit: Circuit) -> str:
    """Return the schematic as SVG."""
    schemdraw.use('svg')
    schemdraw.svgconfig.text = 'text'
    with schemdraw.Drawing(show=False) as drawing:
        drawing.config(unit=2.0, fontsize=11, bgcolor='white', margin=0.6)
        for group, (left, top) in PLACES.items():
            parts = [part for part in circuit.parts.values() if part.group == group]
            if not parts:
                continue
            _label(drawing, (left, top + 1.3), group, ('left', 'bottom'), 15)
            small = [part for part in parts if part.ref[0] in 'RCD']
            boxes = sorted((p for p in parts if p not in small), key=lambda p: -len(p.pins))
            ends = [top, top]  # of the two columns of boxes
            for part in boxes:
                column = max((0, 1), key=lambda c: ends[c])
                x = left + 3.0 + column * COLUMN
                ends[column] -= _box(drawing, circuit, part, x, ends[column]) + 1.6
            for n, part in enumerate(small):
                row, place = divmod(n, 4)
                x, y = left + 1.5 + 4.6 * place, min(ends) - 0.4 - row * ROW
                _small(drawing, circuit, part, x, y)
    return drawing.get_imagedata('svg').decode()
