# SPDX-License-Identifier: Apache-2.0
"""Drawings of block, springs, rim, casters and jig, with the sizes of eol_ros/core/table.py.

What the table leaves open is chosen here, once, in mm.
"""

import math

import numpy as np

from assets.kit.netlist import Circuit
from assets.kit.sheet import Sheet
from eol_ros.core.body import BodyShape, body_mesh
from eol_ros.core.physics.builders import NATURAL_M
from eol_ros.core.table import Table
from eol_ros.core.terrain import CoverShape, cover_mesh, landscape, tile, volume_mm3
from eol_ros.settings import TwinSettings

TABLE = Table()
SIDE, HEIGHT, WALL = 1e3 * TABLE.block_side_m, 1e3 * TABLE.body_height_m, BodyShape().wall_mm
PITCH, GAP, RIM = 1e3 * TABLE.pitch_m[0], 1e3 * TABLE.gap_m, 1e3 * TABLE.rim_m()[0]
PLATFORM = 1e3 * TABLE.platform_m[0]
COLUMNS, BLOCK_G = TABLE.columns, 1e3 * TwinSettings.block_kg
COVER = CoverShape(lip_mm=6.0)

BODY = BodyShape()
FLOOR, PULL = BODY.floor_mm, BODY.spring_mm
POCKET, BOSS = BODY.window_mm, BODY.boss_mm
PIN, INSET = BODY.pin_mm, BODY.inset_mm
BOARD = (70.0, 50.0)
BALLAST_SIDE = 70.0
BAR = (30.0, 20.0)  # width and height of the tube of which the rim is made
CASTER = 25.0  # height of the ball casters under the corners of the rim
BAR_INSIDE = 3.0  # of the bar before the line at which its springs pull
WIRE, COIL = 0.6, 6.0  # diameter of a spring's wire, and mean diameter of its coils
SHEAR = 81.5e3  # N/mm^2, music wire (EN 10270-1)
JIG_DEEP, JIG_WIDE, JIG_PLAY = 25.0, 60.0, 0.4
PLASTIC, STEEL = 1.24e-3, 7.85e-3  # g/mm^3
WIRES_G = 18.0  # board with holes, socket, wire, screws; a guess


def spring_coils() -> float:
    """Return how many active coils give the stiffness of the table: k = G d^4 / (8 D^3 n)."""
    k = TwinSettings().stiffness * 1e-3  # N/mm
    return SHEAR * WIRE**4 / (8 * COIL**3 * k)


def spring_lengths() -> tuple[float, float]:
    """Return lengths from hook to hook: natural, and between the pins of two blocks at rest."""
    return 1e3 * NATURAL_M + 2 * INSET, GAP + 2 * INSET


def masses(circuit: Circuit) -> list[tuple[str, float]]:
    """Return what a block is made of, g; the last is the steel that makes it as heavy as it is."""
    land = landscape(1, cells=28)
    covers = [
        volume_mm3(cover_mesh(tile(land, *divmod(i, COLUMNS), 28), COVER))
        for i in range(TABLE.cells)
    ]
    rows = [
        ('electronics', sum(p.mass_g for p in circuit.parts.values() if p.ref != 'BT1')),
        ('cell', circuit.parts['BT1'].mass_g),
        ('board with holes, socket, wire, screws, pins', WIRES_G),
        ('body, printed', PLASTIC * volume_mm3(body_mesh(BODY))),
        ('cover, printed, in the mean', PLASTIC * float(np.mean(covers))),
    ]
    return [*rows, ('steel plate, to make it up', BLOCK_G - sum(g for _, g in rows))]


def mass_table(circuit: Circuit) -> list[str]:
    """Return the masses as rows of a table."""
    rows = ['| part of a block | g |', '| --- | --- |']
    rows += [f'| {what} | {grams:.0f} |' for what, grams in masses(circuit)]
    thick = masses(circuit)[-1][1] / STEEL / BALLAST_SIDE**2
    return [
        *rows,
        f'| **all** | **{BLOCK_G:.0f}** |',
        '',
        f'The plate is {BALLAST_SIDE:g} x {BALLAST_SIDE:g} x {thick:.1f} mm; weigh each block with '
        'its own cover, and file or tape.',
    ]


def body() -> Sheet:
    """The body of a block from above, and cut in the middle with its cover on."""
    s = Sheet('Body of a block, with its cover', 3.0)
    half, inner = SIDE / 2, SIDE / 2 - WALL
    s.square(0, 0, SIDE)
    s.square(0, 0, 2 * inner)
    s.rect(-BOARD[0] / 2, -BOARD[1] / 2, *BOARD, layer='hidden')
    s.square(0, 0, BALLAST_SIDE, layer='hidden')
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1)):

        def at(out: float, along: float, x: int = x, y: int = y) -> tuple[float, float]:
            return x * out + abs(y) * along, y * out + abs(x) * along

        boss, back = BOSS[0] / 2, inner - BOSS[1]
        s.circle(*at(half - INSET, 0), PIN)
        s.line(at(inner, -boss), at(back, -boss), at(back, boss), at(inner, boss))
        for along in (-POCKET[0] / 2, POCKET[0] / 2):
            s.line(at(half, along), at(half - WALL, along), layer='hidden')
    for a, b in (((-half - 6, 0), (half + 6, 0)), ((0, -half - 6), (0, half + 6))):
        s.line(a, b, layer='centre')
    s.dim((-half, -half), (half, -half), -14)
    s.dim((-inner, -half), (inner, -half), -8, note='inside')
    s.dim((half - INSET, 0), (half, 0), 52, note='pin to face')
    s.dim((-half, -POCKET[0] / 2), (-half, POCKET[0] / 2), -8, vertical=True)
    s.say(-half, half + 6, 'from above, without cover; dashed: board, ballast, pockets')

    cx, floor = 120.0, -half  # the cut, its platform at y = floor
    left, right = cx - half, cx + half
    s.line((left - 12, floor), (right + 12, floor), layer='centre')
    outer = [(left, floor + HEIGHT), (left, floor), (right, floor), (right, floor + HEIGHT)]
    inside = [(right - WALL, floor + HEIGHT), (right - WALL, floor + FLOOR)]
    inside += [(left + WALL, floor + FLOOR), (left + WALL, floor + HEIGHT)]
    s.line(*outer, *inside, closed=True)
    rings = COVER.rings()
    base, low = floor + HEIGHT, COVER.skirt_mm
    for side in (-1, 1):
        top = base + low - COVER.wall_mm
        roof = [(cx, top), (cx + side * (half - COVER.wall_mm), top)]
        rim = [(cx + side * x, base + z) for x, z in rings]
        s.line(*roof, *rim, (cx + side * half, base + low), (cx, base + low))
        pin = cx + side * (half - INSET)
        s.line((pin, floor + PULL - 9), (pin, floor + PULL + 9), layer='hidden')
    s.rect(cx - BALLAST_SIDE / 2, floor + FLOOR, BALLAST_SIDE, 2.5, layer='hidden')
    s.rect(cx - 30, floor + FLOOR + 2.5, 60, 7, layer='hidden')
    s.rect(cx - BOARD[0] / 2, floor + FLOOR + 13, BOARD[0], 1.6, layer='hidden')
    s.say(cx - 29, floor + FLOOR + 4.6, 'cell, on the steel plate')
    s.say(cx - 29, floor + FLOOR + 16, 'board')
    s.line((left - 6, floor + PULL), (right + 6, floor + PULL), layer='centre')
    s.dim((right, floor), (right, floor + PULL), 10, vertical=True, note='springs')
    s.dim((right, floor), (right, floor + HEIGHT), 18, vertical=True)
    s.dim((right, floor + HEIGHT), (right, base + low), 26, vertical=True, note='lowest land')
    s.dim((left, floor), (left, floor + FLOOR), -8, vertical=True)
    s.dim((left, base - COVER.lip_mm), (left, base), -8, vertical=True, note='lip')
    lip = max(x for x, z in rings if z < 0)
    s.dim((cx - lip, base - COVER.lip_mm), (cx + lip, base - COVER.lip_mm), low + 20, note='lip')
    s.say(left, base + low + 8, 'cut in the middle, with the lowest cover')
    return s


def rim() -> Sheet:
    """The rim from above: bars, pins of the outer springs, casters under its corners."""
    s = Sheet('Rim', 14.0)
    inside = RIM / 2 - BAR_INSIDE
    outside = inside + BAR[0]
    s.square(0, 0, 2 * inside)
    s.square(0, 0, 2 * outside)
    middle = inside + BAR[0] / 2
    rest = np.column_stack([TABLE.rest, np.zeros(TABLE.cells)])
    for a, b in 1e3 * TABLE.spring_ends(rest, np.zeros(3))[TABLE.springs[:, 1] < 0]:
        out = (b - a) / np.linalg.norm(b - a)
        s.circle(*(b + INSET * out), 4.0)
    for x in (-middle, middle):
        for y in (-middle, middle):
            s.circle(x, y, 15.0, layer='hidden')
    for x in (-outside, outside):  # mitres
        s.line((x, -outside), (np.sign(x) * inside, -inside))
        s.line((x, outside), (np.sign(x) * inside, inside))
    s.line((-outside - 20, 0), (outside + 20, 0), layer='centre')
    s.line((0, -outside - 20), (0, outside + 20), layer='centre')
    pin = RIM / 2 + INSET
    s.dim((-outside, -outside), (outside, -outside), -90)
    s.dim((-inside, -inside), (inside, -inside), 60)
    s.dim((-pin, 0), (pin, 0), 120, note='from pin to pin')
    for k in range(COLUMNS - 1):
        x = (k - 2) * PITCH
        s.dim((x, -pin), (x + PITCH, -pin), -60 - BAR_INSIDE)
    s.dim((-middle, middle), (middle, middle), 60, note='casters')
    s.dim((outside, -outside), (outside, -inside), 40, vertical=True)
    s.say(-outside + 60, 330, f'tube {BAR[0]:g} x {BAR[1]:g} x 2, four pieces, mitred;')
    s.say(-outside + 60, 305, '20 holes of 4 mm through both walls')
    s.say(-outside + 60, 270, 'dashed: ball casters below, one under each corner')
    return s


def section() -> Sheet:
    """Rim, caster, spring and the outermost block, cut, with their heights."""
    s = Sheet('Heights', 3.5)
    half = SIDE / 2
    s.line((-half - 20, 0), (half + GAP + 60, 0))
    s.say(-half - 20, -7, 'platform, sandpaper of grain 120')
    s.rect(-half, 0, SIDE, HEIGHT)
    s.rect(-half, HEIGHT, SIDE, COVER.skirt_mm)
    s.say(-half + 4, HEIGHT + 4, 'cover')
    s.say(-half + 4, 8, 'body')
    face = half + GAP
    bar = face - BAR_INSIDE
    s.rect(bar, CASTER, *BAR)
    s.rect(bar + 2, CASTER + 2, BAR[0] - 4, BAR[1] - 4, layer='hidden')
    s.circle(bar + BAR[0] / 2, 7.5, 15.0)
    s.rect(bar + BAR[0] / 2 - 8, 11, 16, CASTER - 11)
    pin = face + INSET
    s.rect(pin - 2, PULL - 6, 4, CASTER + BAR[1] + 4 - PULL + 6)
    s.rect(pin - 3.5, PULL - 4.5, 7, 3)
    s.rect(pin - 3.5, PULL + 1.5, 7, 3)
    _coil(s, half - INSET, pin, PULL)
    s.dim((half, 0), (half, PULL), 12, vertical=True)
    s.dim((bar + BAR[0], 0), (bar + BAR[0], CASTER), 12, vertical=True, note='caster')
    s.dim((bar + BAR[0], CASTER), (bar + BAR[0], CASTER + BAR[1]), 12, vertical=True)
    s.dim((-half, 0), (-half, HEIGHT), -8, vertical=True)
    s.dim((half, HEIGHT), (face, HEIGHT), 24)
    s.dim((half - INSET, 0), (pin, 0), -16, note='from pin to pin')
    return s


def _coil(s: Sheet, left: float, right: float, y: float) -> None:
    """Draw a spring from pin to pin."""
    hook, turns = COIL, 30
    a, b = left + hook, right - hook
    step = (b - a) / turns
    zigzag = [(a + k * step / 2, y + (COIL / 2) * (-1) ** k) for k in range(2 * turns + 1)]
    s.line((left, y), (a, y), *zigzag, (b, y), (right, y))


def spring() -> Sheet:
    """A spring unstretched, and as it is built in."""
    s = Sheet('Spring', 3.0)
    natural, installed = spring_lengths()
    k = TwinSettings().stiffness
    for y, length, words in ((0.0, natural, 'free'), (-22.0, installed, 'between two blocks')):
        _coil(s, 0, length, y)
        s.dim((0, y), (length, y), -8, note=words)
    force = k * 1e-3 * (installed - natural)
    lines = (
        f'{k:g} N/m; wire {WIRE:g} mm, mean diameter {COIL:g} mm, {spring_coils():.0f} coils',
        f'open hooks; music wire, G = {SHEAR / 1e3:g} kN/mm2; built in it pulls with {force:.1f} N',
        'wound with initial tension F0 it may be F0/k longer when free',
    )
    for n, words in enumerate(lines):
        s.say(0, 12 - 5.0 * n + 8, words)
    return s


def jig() -> Sheet:
    """A comb that holds a row of five blocks at their places while springs are hooked in."""
    s = Sheet('Jig, for a row of blocks: two pieces of 6 mm plywood', 9.0)
    slot = SIDE + JIG_PLAY
    left = -(COLUMNS - 1) / 2 * PITCH - SIDE / 2 - 20
    points = [(left, 0.0), (left, JIG_WIDE)]
    for k in range(COLUMNS):
        x = (k - (COLUMNS - 1) / 2) * PITCH
        a, b = x - slot / 2, x + slot / 2
        points += [(a, JIG_WIDE), (a, JIG_WIDE - JIG_DEEP), (b, JIG_WIDE - JIG_DEEP), (b, JIG_WIDE)]
    s.line(*points, (-left, JIG_WIDE), (-left, 0.0), closed=True)
    edge = -(COLUMNS - 1) / 2 * PITCH - slot / 2
    s.dim((edge, JIG_WIDE), (edge + slot, JIG_WIDE), 18)
    s.dim((edge + slot, JIG_WIDE), (edge + PITCH, JIG_WIDE), 18)
    for k in range(1, COLUMNS - 1):
        a = edge + k * PITCH
        s.dim((a, JIG_WIDE), (a + PITCH, JIG_WIDE), 18)
    s.dim((left, 0), (-left, 0), -20)
    s.dim((-left, 0), (-left, JIG_WIDE), 20, vertical=True)
    s.dim((left, JIG_WIDE - JIG_DEEP), (left, JIG_WIDE), -16, vertical=True)
    return s


def table() -> Sheet:
    """The whole table from above, at rest."""
    s = Sheet('The table from above', 18.0)
    s.square(0, 0, PLATFORM)
    inside = RIM / 2 - BAR_INSIDE
    s.square(0, 0, 2 * inside)
    s.square(0, 0, 2 * (inside + BAR[0]))
    rest = np.column_stack([TABLE.rest, np.zeros(TABLE.cells)])
    for n, (x, y, _) in enumerate(rest * [1e3, 1e3, 1]):
        s.square(x, y, SIDE)
        s.say(x, y - 7, str(n), 'middle')
    for a, b in 1e3 * TABLE.spring_ends(rest, np.zeros(3)):
        s.line(tuple(a), tuple(b), layer='hidden')
    corner = 2 * PITCH + SIDE / 2
    s.dim((-PLATFORM / 2, -PLATFORM / 2), (PLATFORM / 2, -PLATFORM / 2), -60)
    s.dim((-RIM / 2, -RIM / 2), (RIM / 2, -RIM / 2), -110, note='where the outer springs pull')
    s.dim((-2 * PITCH, corner), (-PITCH, corner), 200)
    s.dim((PITCH - SIDE / 2, corner), (PITCH + SIDE / 2, corner), 200)
    s.dim((corner, corner), (corner + GAP, corner), 200)
    s.say(-PLATFORM / 2 + 20, -PLATFORM / 2 + 20, 'visitors stand here: block 0 is at the left')
    return s


SHEETS = {f.__name__: f for f in (table, body, section, spring, rim, jig)}


def coil_stress(stretch_mm: float) -> float:
    """Return a wire's shear stress, its spring stretched so far, N/mm^2: 8 F D / pi d^3."""
    force = TwinSettings().stiffness * 1e-3 * stretch_mm
    return 8 * force * COIL / (math.pi * WIRE**3)
