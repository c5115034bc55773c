# SPDX-License-Identifier: Apache-2.0
"""Drawings of block, springs, rim, casters and jig, with the sizes of a table, in mm.

What the table leaves open is chosen here, once.
"""

import math
from functools import cached_property

import numpy as np

from assets.covers.body import BodyShape, body_mesh
from assets.covers.mesh import CoverShape, cover_mesh, tile, volume_mm3
from assets.kit.netlist import Circuit
from assets.kit.sheet import Sheet
from eol_ros.core.table import Table
from eol_ros.core.terrain import landscape
from eol_ros.errors import ConfigError
from eol_ros.settings import TwinSettings

BOARD = (70.0, 50.0)
CELL = 60.0  # its length
BAR = (30.0, 20.0)  # width and height of the tube of which the rim is made
CASTER = 25.0  # height of the ball casters under the corners of the rim
BAR_INSIDE = 3.0  # of the bar before the line at which its springs pull
WIRE, COILS = 0.6, range(6, 13)  # diameter of a spring's wire; mean diameters of its coils
SHEAR = 81.5e3  # N/mm^2, music wire (EN 10270-1)
JIG_DEEP, JIG_WIDE, JIG_PLAY = 25.0, 60.0, 0.4
PLASTIC, STEEL = 1.24e-3, 7.85e-3  # g/mm^3
WIRES_G = 18.0  # board with holes, socket, wire, screws; a guess
RIM_NOTE = 'where the outer springs pull'


class Kit:
    """The kit of a table with the springs and block mass of a twin; sizes in mm, along x and y.

    Raises UsageError or ConfigError for sizes that cannot be built.
    """

    def __init__(self, table: Table = Table(), twin: TwinSettings | None = None) -> None:
        self.table, self.twin = table, twin or TwinSettings()
        self.side, self.height = 1e3 * table.block_side_m, 1e3 * table.body_height_m
        self.block_g = 1e3 * self.twin.block_kg
        self.shape = BodyShape(self.side, self.height).check()
        self.cover = CoverShape(self.side, lip_mm=self.shape.lip_mm).check()
        # of the steel plate: 1 mm of play to the bosses
        self.ballast = self.side - 2 * (self.shape.wall_mm + self.shape.boss_mm[1] + 1)
        self.board = min(BOARD[0], self.ballast), min(BOARD[1], self.ballast)
        self.places = table.columns, table.rows
        self.pitch, self.gaps, self.rim_mm, self.platform = (
            (1e3 * x, 1e3 * y)
            for x, y in (table.pitch_m, table.gaps_m, table.rim_m(), table.platform_m)
        )
        both = zip(self.places, self.pitch, self.platform, strict=True)
        self.alike = len(set(both)) == 1  # along x and y

    @cached_property
    def coil(self) -> float:
        """Mean diameter of a spring's coils: the first of COILS whose body fits its free length."""
        for found in COILS:
            if self.turns(found) * WIRE + 2 * found <= self.spring_lengths()[0] + 1:
                return float(found)
        raise ConfigError(
            f'a spring of {self.twin.stiffness:g} N/m and wire of {WIRE:g} mm is longer than '
            f'twin.spring_natural_m, {self.twin.spring_natural_m:g} m: make either larger'
        )

    def bars(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return half of the width and depth of the rim, inside and outside of its bars."""
        x, y = (size / 2 - BAR_INSIDE for size in self.rim_mm)
        return (x, y), (x + BAR[0], y + BAR[0])

    def turns(self, coil: float) -> float:
        """Return how many active coils give the stiffness of the table: k = G d^4 / (8 D^3 n)."""
        k = self.twin.stiffness * 1e-3  # N/mm
        return SHEAR * WIRE**4 / (8 * coil**3 * k)

    def spring_lengths(self) -> tuple[float, float, float]:
        """Return lengths from hook to hook: natural, and mounted along a row, and between rows."""
        ends = 2 * self.shape.inset_mm
        return 1e3 * self.twin.spring_natural_m + ends, *(gap + ends for gap in self.gaps)

    def masses(self, circuit: Circuit) -> list[tuple[str, float]]:
        """Return what a block is made of, g; the last is the steel that makes up its mass."""
        table = self.table
        land = landscape(1, table.rows, table.columns, 28)
        covers = [
            volume_mm3(cover_mesh(tile(land, *divmod(i, table.columns), 28), self.cover))
            for i in table.ids.tolist()
        ]
        rows = [
            ('electronics', sum(p.mass_g for p in circuit.parts.values() if p.ref != 'BT1')),
            ('cell', circuit.parts['BT1'].mass_g),
            ('board with holes, socket, wire, screws, pins', WIRES_G),
            ('body, printed', PLASTIC * volume_mm3(body_mesh(self.shape))),
            ('cover, printed, in the mean', PLASTIC * float(np.mean(covers))),
        ]
        return [*rows, ('steel plate, to make it up', self.block_g - sum(g for _, g in rows))]

    def mass_table(self, circuit: Circuit) -> list[str]:
        """Return the masses as rows of a table."""
        *parts, (steel, steel_g) = self.masses(circuit)
        light = steel_g < 0  # of the scene
        parts += [] if light else [(steel, steel_g)]
        all_g = sum(grams for _, grams in parts)
        rows = ['| part of a block | g |', '| --- | --- |']
        rows += [f'| {what} | {grams:.0f} |' for what, grams in parts]
        rows += [f'| **all** | **{all_g:.0f}** |', '']
        if light:
            return [
                *rows,
                f'Without a steel plate it is heavier than the {self.block_g:g} g of the scene: '
                f'set `twin.block_kg: {1e-3 * math.ceil(all_g):g}`.',
            ]
        return [
            *rows,
            f'The plate is {self.ballast:g} x {self.ballast:g} x '
            f'{steel_g / STEEL / self.ballast**2:.1f} mm; weigh each block '
            'with its own cover, and file or tape.',
        ]

    def body(self) -> Sheet:
        """The body of a block from above, and cut in the middle with its cover on."""
        s = Sheet('Body of a block, with its cover', 3.0)
        half, inner = self.side / 2, self.side / 2 - self.shape.wall_mm
        s.square(0, 0, self.side)
        s.square(0, 0, 2 * inner)
        s.rect(-self.board[0] / 2, -self.board[1] / 2, *self.board, layer='hidden')
        s.square(0, 0, self.ballast, layer='hidden')
        for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1)):

            def at(out: float, along: float, x: int = x, y: int = y) -> tuple[float, float]:
                return x * out + abs(y) * along, y * out + abs(x) * along

            boss, back = self.shape.boss_mm[0] / 2, inner - self.shape.boss_mm[1]
            s.circle(*at(half - self.shape.inset_mm, 0), self.shape.pin_mm)
            s.line(at(inner, -boss), at(back, -boss), at(back, boss), at(inner, boss))
            for along in (-self.shape.window_mm[0] / 2, self.shape.window_mm[0] / 2):
                s.line(at(half, along), at(half - self.shape.wall_mm, along), layer='hidden')
        for a, b in (((-half - 6, 0), (half + 6, 0)), ((0, -half - 6), (0, half + 6))):
            s.line(a, b, layer='centre')
        s.dim((-half, -half), (half, -half), -14)
        s.dim((-inner, -half), (inner, -half), -8, note='inside')
        s.dim((half - self.shape.inset_mm, 0), (half, 0), half + 10, note='pin to face')
        s.dim(
            (-half, -self.shape.window_mm[0] / 2),
            (-half, self.shape.window_mm[0] / 2),
            -8,
            vertical=True,
        )
        s.say(-half, half + 6, 'from above, without cover; dashed: board, ballast, pockets')

        cx, floor = self.side + 36, -half  # the cut, its platform at y = floor
        left, right = cx - half, cx + half
        s.line((left - 12, floor), (right + 12, floor), layer='centre')
        outer = [
            (left, floor + self.height),
            (left, floor),
            (right, floor),
            (right, floor + self.height),
        ]
        inside = [
            (right - self.shape.wall_mm, floor + self.height),
            (right - self.shape.wall_mm, floor + self.shape.floor_mm),
        ]
        inside += [
            (left + self.shape.wall_mm, floor + self.shape.floor_mm),
            (left + self.shape.wall_mm, floor + self.height),
        ]
        s.line(*outer, *inside, closed=True)
        rings = self.cover.rings()
        base, low = floor + self.height, self.cover.skirt_mm
        for side in (-1, 1):
            top = base + low - self.cover.wall_mm
            roof = [(cx, top), (cx + side * (half - self.cover.wall_mm), top)]
            rim = [(cx + side * x, base + z) for x, z in rings]
            s.line(*roof, *rim, (cx + side * half, base + low), (cx, base + low))
            pin = cx + side * (half - self.shape.inset_mm)
            s.line(
                (pin, floor + self.shape.spring_mm - 9),
                (pin, floor + self.shape.spring_mm + 9),
                layer='hidden',
            )
        s.rect(
            cx - self.ballast / 2, floor + self.shape.floor_mm, self.ballast, 2.5, layer='hidden'
        )
        cell = min(CELL, self.ballast)
        s.rect(cx - cell / 2, floor + self.shape.floor_mm + 2.5, cell, 7, layer='hidden')
        s.rect(
            cx - self.board[0] / 2,
            floor + self.shape.floor_mm + 13,
            self.board[0],
            1.6,
            layer='hidden',
        )
        s.say(cx - cell / 2 + 1, floor + self.shape.floor_mm + 4.6, 'cell, on the steel plate')
        s.say(cx - cell / 2 + 1, floor + self.shape.floor_mm + 16, 'board')
        s.line(
            (left - 6, floor + self.shape.spring_mm),
            (right + 6, floor + self.shape.spring_mm),
            layer='centre',
        )
        s.dim(
            (right, floor), (right, floor + self.shape.spring_mm), 10, vertical=True, note='springs'
        )
        s.dim((right, floor), (right, floor + self.height), 18, vertical=True)
        s.dim(
            (right, floor + self.height), (right, base + low), 26, vertical=True, note='lowest land'
        )
        s.dim((left, floor), (left, floor + self.shape.floor_mm), -8, vertical=True)
        s.dim((left, base - self.cover.lip_mm), (left, base), -8, vertical=True, note='lip')
        lip = max(x for x, z in rings if z < 0)
        s.dim(
            (cx - lip, base - self.cover.lip_mm),
            (cx + lip, base - self.cover.lip_mm),
            low + 20,
            note='lip',
        )
        s.say(left, base + low + 8, 'cut in the middle, with the lowest cover')
        return s

    def rim(self) -> Sheet:
        """The rim from above: bars, pins of the outer springs, casters under its corners."""
        s, table, inset = Sheet('Rim', 14.0), self.table, self.shape.inset_mm
        (inside, high), (outside, top) = self.bars()
        middle, centre = inside + BAR[0] / 2, high + BAR[0] / 2
        s.rect(-inside, -high, 2 * inside, 2 * high)
        s.rect(-outside, -top, 2 * outside, 2 * top)
        rest = np.column_stack([table.rest, np.zeros(table.cells)])
        pins = 1e3 * table.spring_ends(rest, np.zeros(3))[table.springs[:, 1] < 0]
        for a, b in pins:
            out = (b - a) / np.linalg.norm(b - a)
            s.circle(*(b + inset * out), 4.0)
        for x in (-middle, middle):
            for y in (-centre, centre):
                s.circle(x, y, 15.0, layer='hidden')
        for x in (-1, 1):  # mitres
            s.line((x * outside, -top), (x * inside, -high))
            s.line((x * outside, top), (x * inside, high))
        s.line((-outside - 20, 0), (outside + 20, 0), layer='centre')
        s.line((0, -top - 20), (0, top + 20), layer='centre')
        pin, below = (half / 2 + inset for half in self.rim_mm)
        s.dim((-outside, -top), (outside, -top), -90)
        s.dim((-inside, -high), (inside, -high), 60)
        s.dim((-pin, 0), (pin, 0), 120, note='from pin to pin')
        for k in range(table.columns - 1):
            x = (k - (table.columns - 1) / 2) * self.pitch[0]
            s.dim((x, -below), (x + self.pitch[0], -below), -60 - BAR_INSIDE)
        s.dim((-middle, centre), (middle, centre), 60, note='casters')
        s.dim((outside, -top), (outside, -high), 40, vertical=True)
        if not self.alike:
            s.dim((-outside, -top), (-outside, top), -90, vertical=True)
            s.dim((-inside, -high), (-inside, high), 60, vertical=True)
            s.dim((0, -below), (0, below), 120, vertical=True, note='from pin to pin')
            for k in range(table.rows - 1):
                y = (k - (table.rows - 1) / 2) * self.pitch[1]
                s.dim((-pin, y), (-pin, y + self.pitch[1]), -60 - BAR_INSIDE, vertical=True)
        s.say(
            -outside + 60,
            round(top) - 177,
            f'tube {BAR[0]:g} x {BAR[1]:g} x 2, four pieces, mitred;',
        )
        s.say(-outside + 60, round(top) - 202, f'{len(pins)} holes of 4 mm through both walls')
        s.say(-outside + 60, round(top) - 237, 'dashed: ball casters below, one under each corner')
        return s

    def section(self) -> Sheet:
        """Rim, caster, spring and the outermost block, cut, with their heights."""
        s = Sheet('Heights', 3.5)
        half = self.side / 2
        s.line((-half - 20, 0), (half + self.gaps[0] + 60, 0))
        s.say(-half - 20, -7, 'platform, sandpaper of grain 120')
        s.rect(-half, 0, self.side, self.height)
        s.rect(-half, self.height, self.side, self.cover.skirt_mm)
        s.say(-half + 4, self.height + 4, 'cover')
        s.say(-half + 4, 8, 'body')
        face = half + self.gaps[0]
        bar = face - BAR_INSIDE
        s.rect(bar, CASTER, *BAR)
        s.rect(bar + 2, CASTER + 2, BAR[0] - 4, BAR[1] - 4, layer='hidden')
        s.circle(bar + BAR[0] / 2, 7.5, 15.0)
        s.rect(bar + BAR[0] / 2 - 8, 11, 16, CASTER - 11)
        pin = face + self.shape.inset_mm
        s.rect(pin - 2, self.shape.spring_mm - 6, 4, CASTER + BAR[1] + 4 - self.shape.spring_mm + 6)
        s.rect(pin - 3.5, self.shape.spring_mm - 4.5, 7, 3)
        s.rect(pin - 3.5, self.shape.spring_mm + 1.5, 7, 3)
        self._coil(s, half - self.shape.inset_mm, pin, self.shape.spring_mm)
        s.dim((half, 0), (half, self.shape.spring_mm), 12, vertical=True)
        s.dim((bar + BAR[0], 0), (bar + BAR[0], CASTER), 12, vertical=True, note='caster')
        s.dim((bar + BAR[0], CASTER), (bar + BAR[0], CASTER + BAR[1]), 12, vertical=True)
        s.dim((-half, 0), (-half, self.height), -8, vertical=True)
        s.dim((half, self.height), (face, self.height), 24)
        s.dim((half - self.shape.inset_mm, 0), (pin, 0), -16, note='from pin to pin')
        return s

    def _coil(self, s: Sheet, left: float, right: float, y: float) -> None:
        """Draw a spring from pin to pin."""
        hook, turns = self.coil, 30
        a, b = left + hook, right - hook
        step = (b - a) / turns
        zigzag = [(a + k * step / 2, y + (self.coil / 2) * (-1) ** k) for k in range(2 * turns + 1)]
        s.line((left, y), (a, y), *zigzag, (b, y), (right, y))

    def spring(self) -> Sheet:
        """A spring unstretched, and as it is built in."""
        s = Sheet('Spring', 3.0)
        natural, installed, across = self.spring_lengths()
        k = self.twin.stiffness
        drawn = [(natural, 'free'), (installed, 'between two blocks')]
        if across != installed:
            drawn[1:] = [(installed, 'along a row'), (across, 'from row to row')]
        for n, (length, words) in enumerate(drawn):
            y = 0.0 - 22.0 * n  # not -0.0, which a DXF would show
            self._coil(s, 0, length, y)
            s.dim((0, y), (length, y), -8, note=words)
        force = k * 1e-3 * (installed - natural)
        lines = (
            f'{k:g} N/m; wire {WIRE:g} mm, mean diameter {self.coil:g} mm, '
            f'{self.turns(self.coil):.0f} coils',
            f'open hooks; music wire, G = {SHEAR / 1e3:g} kN/mm2; '
            f'built in it pulls with {force:.1f} N',
            'wound with initial tension F0 it may be F0/k longer when free',
        )
        for n, words in enumerate(lines):
            s.say(0, 12 - 5.0 * n + 8, words)
        return s

    def jig(self) -> Sheet:
        """A comb that holds a row of blocks at their places while springs are hooked in."""
        return self._comb('Jig, for a row of blocks', self.table.columns, self.pitch[0])

    def jig_across(self) -> Sheet:
        """The comb for a column of blocks, where it differs from that for a row."""
        return self._comb('Jig, for a column of blocks', self.table.rows, self.pitch[1])

    def _comb(self, title: str, count: int, pitch: float) -> Sheet:
        s = Sheet(f'{title}: two pieces of 6 mm plywood', 9.0)
        slot = self.side + JIG_PLAY
        left = -(count - 1) / 2 * pitch - self.side / 2 - 20
        points = [(left, 0.0), (left, JIG_WIDE)]
        for k in range(count):
            x = (k - (count - 1) / 2) * pitch
            a, b, deep = x - slot / 2, x + slot / 2, JIG_WIDE - JIG_DEEP
            points += [(a, JIG_WIDE), (a, deep), (b, deep), (b, JIG_WIDE)]
        s.line(*points, (-left, JIG_WIDE), (-left, 0.0), closed=True)
        edge = -(count - 1) / 2 * pitch - slot / 2
        s.dim((edge, JIG_WIDE), (edge + slot, JIG_WIDE), 18)
        s.dim((edge + slot, JIG_WIDE), (edge + pitch, JIG_WIDE), 18)
        for k in range(1, count - 1):
            a = edge + k * pitch
            s.dim((a, JIG_WIDE), (a + pitch, JIG_WIDE), 18)
        s.dim((left, 0), (-left, 0), -20)
        s.dim((-left, 0), (-left, JIG_WIDE), 20, vertical=True)
        s.dim((left, JIG_WIDE - JIG_DEEP), (left, JIG_WIDE), -16, vertical=True)
        return s

    def plan(self) -> Sheet:
        """The whole table from above, at rest."""
        s, table, (wide, deep) = Sheet('The table from above', 18.0), self.table, self.platform
        s.rect(-wide / 2, -deep / 2, wide, deep)
        for x, y in self.bars():
            s.rect(-x, -y, 2 * x, 2 * y)
        rest = np.column_stack([table.rest, np.zeros(table.cells)])
        for n in table.ids.tolist():
            x, y = 1e3 * table.rest[n]
            s.square(x, y, self.side)
            s.say(x, y - 7, str(n), 'middle')
        for a, b in 1e3 * table.spring_ends(rest, np.zeros(3)):
            s.line(tuple(a), tuple(b), layer='hidden')
        pitch, (rim, rim_deep) = self.pitch[0], self.rim_mm
        last, far = ((n - 1) / 2 * one for n, one in zip(self.places, self.pitch, strict=True))
        right, top = last + self.side / 2, far + self.side / 2
        s.dim((-wide / 2, -deep / 2), (wide / 2, -deep / 2), -60)
        s.dim((-rim / 2, -rim_deep / 2), (rim / 2, -rim_deep / 2), -110, note=RIM_NOTE)
        s.dim((-last, top), (-last + pitch, top), 200)
        s.dim((last - pitch - self.side / 2, top), (last - pitch + self.side / 2, top), 200)
        s.dim((right, top), (right + self.gaps[0], top), 200)
        if not self.alike:
            s.dim((-wide / 2, -deep / 2), (-wide / 2, deep / 2), -60, vertical=True)
            s.dim((-rim / 2, -rim_deep / 2), (-rim / 2, rim_deep / 2), -110, vertical=True)
            s.dim((right, -far), (right, -far + self.pitch[1]), 200, vertical=True)
            s.dim((right, top), (right, top + self.gaps[1]), 200, vertical=True)
        s.say(
            -wide / 2 + 20, -deep / 2 + 20,
            f'visitors stand here: block {table.ids[0]} is at the left',
        )  # fmt: skip
        return s

    def sheets(self) -> dict[str, Sheet]:
        """Return the drawings by the names of their files."""
        found = {
            'table': self.plan(), 'body': self.body(), 'section': self.section(),
            'spring': self.spring(), 'rim': self.rim(), 'jig': self.jig(),
        }  # fmt: skip
        return found if self.alike else {**found, 'jig_across': self.jig_across()}

    def coil_stress(self, stretch_mm: float) -> float:
        """Return a wire's shear stress, its spring stretched so far, N/mm^2: 8 F D / pi d^3."""
        force = self.twin.stiffness * 1e-3 * stretch_mm
        return 8 * force * self.coil / (math.pi * WIRE**3)

    def parts(self) -> list[str]:
        """Return what the table is made of as rows of a Markdown table."""
        table, count = self.table, self.table.count
        to_rim = int((table.springs[:, 1] < 0).sum())
        springs = len(table.springs)
        natural, along, across = self.spring_lengths()
        lengths = f'{along:g}' if along == across else f'{along:g} (along a row) or {across:g}'
        (_, _), (outside, top) = self.bars()
        rows: list[tuple[str, float, str]] = [
            ('bodies, covers', count, f'{self.side:g} mm; `python -m assets.covers --scene`'),
            ('circuits: LEDs, cells, boards', count, self._room()),
            ('springs', springs, f'{natural:g} mm free, {lengths} mm mounted, between hooks'),
            ('- of these between blocks', springs - to_rim, ''),
            ('- of these to the rim', to_rim, ''),
            ('steel pins in bodies, for hooks', 2 * springs - to_rim, '2 x 20 mm'),
            ('threaded rods in the rim, for hooks', to_rim, 'M4, two nuts each'),
            ('tubes of the rim, along x', 2, f'{2 * outside:g} mm, mitred'),
            ('tubes of the rim, along y', 2, f'{2 * top:g} mm, mitred'),
            ('ball casters', 4, f'{CASTER:g} mm high'),
            ('platform, sandpaper of grain 120', 1,
             f'{self.platform[0]:g} x {self.platform[1]:g} mm'),
            ('jigs', 2 if self.alike else 4, ''),
        ]  # fmt: skip
        return [
            '| part | number | size |', '| --- | --- | --- |',
            *(f'| {what} | {number} | {size} |' for what, number, size in rows),
        ]  # fmt: skip

    def _room(self) -> str:
        """Return which board and cell fit between the bosses."""
        board = f'board of {self.board[0]:g} x {self.board[1]:g} mm'
        if self.ballast >= CELL:
            return board
        return f'{board} at most, cell {self.ballast:g} mm long at most instead of {CELL:g} mm'
