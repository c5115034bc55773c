# SPDX-License-Identifier: Apache-2.0
"""Right halves: the fault that comes up through the layers, and what it breaks."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from drawings.sheet import (
    FAULT_LEAN,
    FAULT_THROW,
    FAULT_X,
    HEIGHT,
    HORIZON,
    WIDTH,
    Point,
    Sheet,
    jagged,
)


def _fault(sheet: Sheet, rng: np.random.Generator, top: float = HORIZON) -> None:
    """Draw the fault itself, from the deep up to `top`."""
    foot = (FAULT_X + FAULT_LEAN * (HEIGHT - HORIZON), float(HEIGHT))
    sheet.crack(rng, foot, (FAULT_X, top), 13.0, 4.2)


def _turned(points: list[Point], pivot: Point, angle: float) -> list[Point]:
    c, s = np.cos(angle), np.sin(angle)
    return [
        (
            pivot[0] + c * (x - pivot[0]) - s * (y - pivot[1]),
            pivot[1] + s * (x - pivot[0]) + c * (y - pivot[1]),
        )
        for x, y in points
    ]


def _house(
    sheet: Sheet,
    x: float,
    y: float,
    wide: float,
    floors: int,
    angle: float,
    rng: np.random.Generator,
    gable: bool,
) -> None:
    """A house with its lower left corner at (x, y), turned by `angle` about that corner."""
    look = sheet.palette
    tall = floors * 62.0 + 20
    box = [(x, y), (x, y - tall), (x + wide, y - tall), (x + wide, y)]
    roof = [(x - 14, y - tall), (x + wide / 2, y - tall - wide * 0.4), (x + wide + 14, y - tall)]
    if not gable:
        roof = [
            (x - 8, y - tall),
            (x - 8, y - tall - 16),
            (x + wide + 8, y - tall - 16),
            (x + wide + 8, y - tall),
        ]
    sheet.polygon(_turned(box, (x, y), angle), look.shade)
    sheet.line(_turned([*box, box[0]], (x, y), angle), width=2.6)
    sheet.polygon(_turned(roof, (x, y), angle), look.body)
    sheet.line(_turned([*roof, roof[0]], (x, y), angle), width=2.6)
    columns = max(int(wide // 56), 2)
    for floor in range(floors):
        for column in range(columns):
            wx = x + (column + 0.5) * wide / columns - 13
            wy = y - 32 - floor * 62 - 30
            pane = [(wx, wy), (wx + 26, wy), (wx + 26, wy + 36), (wx, wy + 36)]
            lit = rng.random() < 0.16
            sheet.polygon(
                _turned(pane, (x, y), angle),
                look.thread if lit else look.line,
                0.75 if lit else 0.13,
            )
            sheet.line(_turned([*pane, pane[0]], (x, y), angle), width=1.4, opacity=0.7)


def cracked_wall(sheet: Sheet, rng: np.random.Generator) -> None:
    """A long wall of blocks, opened from the ground to its top."""
    look = sheet.palette
    left, right, top = 210.0, 1390.0, HORIZON - 330
    rows, tall = 11, 30.0
    gap = jagged(rng, (FAULT_X, HORIZON), (FAULT_X + rng.uniform(-150, 150), top), 34)
    way = np.array(gap)[::-1]

    def cut(y: float) -> float:
        return float(np.interp(y, way[:, 1], way[:, 0]))

    for side, drop in ((-1, 0.0), (1, FAULT_THROW)):
        edge = [(px + side * 7, py + drop) for px, py in gap]
        far = left if side < 0 else right
        sheet.polygon([(far, HORIZON + drop), *edge, (far, top + drop)], look.shade, 0.94)
        for row in range(rows + 1):
            y = HORIZON - row * tall
            near = cut(max(y, top)) + side * 7
            sheet.line(
                [(far, y + drop), (near, y + drop)],
                width=2.4 if row == rows else 1.3,
                opacity=0.9 if row == rows else 0.42,
            )
            if row == rows:
                break
            shift = 48.0 if row % 2 else 0.0
            for x in np.arange(left + shift, right, 96.0):
                if (x - cut(y - tall / 2)) * side > 16:
                    sheet.line([(x, y + drop), (x, y - tall + drop)], width=1.3, opacity=0.42)
        sheet.line(edge, width=2.4)
    sheet.crack(rng, (FAULT_X, HORIZON + 12), gap[-1], 3.0, 3.0)
    sheet.thread([(px, py + 6) for px, py in gap], 3.6)
    for _ in range(13):
        x, y = rng.uniform(560, 1040), HORIZON + rng.uniform(-14, 0)
        _stone(sheet, rng, x, y + (FAULT_THROW if x > FAULT_X else 0), rng.uniform(8, 22))
    _fault(sheet, rng)


def _stone(sheet: Sheet, rng: np.random.Generator, x: float, y: float, r: float) -> None:
    angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
    shape = [(x + r * np.cos(a), y + 0.7 * r * np.sin(a)) for a in angles]
    sheet.polygon(shape, sheet.palette.body)
    sheet.line([*shape, shape[0]], width=1.6, opacity=0.8)


def tilted_house(sheet: Sheet, rng: np.random.Generator) -> None:
    """A street of houses; the one over the fault has leaned and sunk."""
    lean = rng.uniform(0.15, 0.21)
    for x, wide, floors, gable in ((120, 150, 3, False), (285, 190, 2, True), (490, 170, 4, False)):
        _house(sheet, x, HORIZON, wide, floors, rng.normal(0, 0.006), rng, gable)
    for x, wide, floors, gable in ((1110, 180, 2, True), (1305, 160, 4, False)):
        _house(sheet, x, HORIZON + FAULT_THROW, wide, floors, rng.normal(0.012, 0.006), rng, gable)
    _house(sheet, 742, HORIZON + 18, 230, 4, lean, rng, bool(rng.random() < 0.5))
    _fault(sheet, rng, HORIZON + 14)
    for _ in range(9):
        px = rng.uniform(700, 1080)
        _stone(sheet, rng, px, sheet.ground(px) - 4, rng.uniform(6, 15))


def broken_road(sheet: Sheet, rng: np.random.Generator) -> None:
    """A road seen along its length, torn and displaced where the fault crosses it."""
    look = sheet.palette
    vanish = (rng.uniform(720, 880), HORIZON - 26)

    def across(y: float, offset: float = 0.0) -> tuple[float, float]:
        near = (y - vanish[1]) / (HEIGHT - vanish[1])
        middle = vanish[0] + (800 - vanish[0]) * near + offset
        return middle - 560 * near, middle + 560 * near

    sheet.rect(0, HORIZON, WIDTH, HEIGHT - HORIZON, look.hills[1])
    for ray in np.linspace(-4.2, 4.2, 29):
        y = np.array([HORIZON, HEIGHT])
        reach = (y - vanish[1]) / (HEIGHT - vanish[1]) * 560 * ray
        sheet.line(zip(vanish[0] + reach, y, strict=True), width=1.2, opacity=0.16)
    sheet.line([(0, HORIZON), (WIDTH, HORIZON)], width=2.5, opacity=0.9)
    tear = HORIZON + 168.0
    for y0, y1, offset in ((HORIZON + 1.0, tear - 16, 0.0), (tear + 26, float(HEIGHT), 118.0)):
        (a0, b0), (a1, b1) = across(y0, offset), across(y1, offset)
        far, near = [(a0, y0), (b0, y0)], [(b1, y1), (a1, y1)]
        if offset:
            far = jagged(rng, (a0, y0), (b0, y0), 20)
        else:
            near = jagged(rng, (b1, y1), (a1, y1), 14)
        sheet.polygon([*far, *near], look.shade)
        sheet.line([*far, *near, far[0]], width=2.6)
        for share in (0.06, 0.94):
            sheet.line(
                [(a0 + share * (b0 - a0), y0 + 14), (a1 + share * (b1 - a1), y1 - 14)],
                width=1.8,
                opacity=0.7,
            )
        for k in range(9):
            s, e = (y0 + 16 + (y1 - y0 - 32) * ((k + d) / 9) ** 1.5 for d in (0.0, 0.55))
            (sa, sb), (ea, eb) = across(s, offset), across(e, offset)
            sw, ew = 0.012 * (sb - sa), 0.012 * (eb - ea)
            sm, em = (sa + sb) / 2, (ea + eb) / 2
            sheet.polygon([(sm - sw, s), (sm + sw, s), (em + ew, e), (em - ew, e)], look.line, 0.9)
    a, b = across(tear)
    sheet.crack(rng, (max(a - 420, 0), tear + 40), (min(b + 480, WIDTH), tear - 24), 17, 5.0)
    for k, x in enumerate((vanish[0] - 330, vanish[0] - 520, vanish[0] - 800)):
        _pylon(sheet, x, HORIZON, 120 + 62 * k, -0.02 - 0.05 * k)


def _pylon(sheet: Sheet, x: float, y: float, tall: float, lean: float) -> None:
    foot = (x, y)
    wide = tall * 0.11

    def t(points: list[Point]) -> list[Point]:
        return _turned(points, foot, lean)

    a, b, ta, tb = t([(x - wide, y), (x + wide, y), (x - 4, y - tall), (x + 4, y - tall)])
    sheet.truss(a, b, ta, tb, 7, 1.7)
    for level, reach in ((0.98, 0.2), (0.84, 0.28), (0.7, 0.2)):
        sheet.line(
            t([(x - reach * tall, y - level * tall), (x + reach * tall, y - level * tall)]), width=2
        )


def collapsed_bridge(sheet: Sheet, rng: np.random.Generator) -> None:
    """A bridge on piers; its middle spans hang into the gap."""
    look = sheet.palette
    deck, thick = HORIZON - 168.0, 26.0
    piers = [150.0, 430.0, 710.0, 1010.0, 1290.0, 1510.0]
    for i, x in enumerate(piers):
        y = sheet.ground(x)
        top = deck + thick
        lean = 0.0 if i not in (2, 3) else (-0.06 if i == 2 else 0.13)
        shape = _turned([(x - 20, y), (x - 15, top), (x + 15, top), (x + 20, y)], (x, y), lean)
        sheet.polygon(shape, look.shade)
        sheet.line(shape, width=2.4)
    spans: list[list[Point]] = [
        [(0, deck), (692, deck - 4)],
        [(700, deck + 8), (908, HORIZON + 6)],
        [(1046, deck + 26), (930, HORIZON + FAULT_THROW - 8)],
        [(1052, deck + 22), (WIDTH, deck + 34)],
    ]
    for (x0, y0), (x1, y1) in spans:
        along = np.array([x1 - x0, y1 - y0]) / np.hypot(x1 - x0, y1 - y0)
        nx, ny = (-along[1], along[0]) if along[0] > 0 else (along[1], -along[0])
        shape = [
            (x0, y0),
            (x1, y1),
            (x1 + nx * thick, y1 + ny * thick),
            (x0 + nx * thick, y0 + ny * thick),
        ]
        sheet.polygon(shape, look.body)
        sheet.line([*shape, shape[0]], width=2.6)
        rail = [(x0 - nx * 24, y0 - ny * 24), (x1 - nx * 24, y1 - ny * 24)]
        sheet.line(rail, width=1.8, opacity=0.9)
        steps = max(int(np.hypot(x1 - x0, y1 - y0) / 34), 2)
        for k in range(steps + 1):
            px, py = x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps
            sheet.line([(px, py), (px - nx * 24, py - ny * 24)], width=1.3, opacity=0.7)
    for x0, x1 in ((700.0, 640.0), (1046.0, 1110.0)):
        for k in range(4):
            sheet.line(
                jagged(rng, (x0, deck + 8 + k * 7), (x0 + (x1 - x0) * -0.5, deck + 40 + k * 16), 8),
                width=1.5,
            )
    for _ in range(16):
        x = rng.uniform(700, 1120)
        _stone(sheet, rng, x, sheet.ground(x) - 4, rng.uniform(7, 24))
    _fault(sheet, rng, HORIZON + 6)


def sinkhole(sheet: Sheet, rng: np.random.Generator) -> None:
    """A hole opened under a field; a house stands over its edge, a fence hangs across."""
    look = sheet.palette
    left, right, deep = 560.0, 1120.0, HORIZON + 275
    rim_l = jagged(rng, (left, HORIZON), (left + 96, deep), 22)
    rim_r = jagged(rng, (right - 110, deep + FAULT_THROW * 0.5), (right, HORIZON + FAULT_THROW), 22)
    hole = [*rim_l, *rim_r]
    sheet.polygon(hole, look.shade)
    for k in range(1, 6):
        y = HORIZON + k * 46
        inset = 22 + k * 13
        sheet.line(
            jagged(rng, (left + inset, y), (right - inset, y + 16), 9), width=1.2, opacity=0.24
        )
    sheet.line(hole, width=2.6)
    sheet.crack(rng, (FAULT_X + 40, float(HEIGHT)), (FAULT_X + 20, deep + 6), 12, 4.2)
    for x0, x1 in ((left + 96, left + 250), (right - 110, right - 260)):
        sheet.crack(rng, (FAULT_X + 20, deep + 6), ((x0 + x1) / 2, HORIZON + 200), 14, 2.2)
    _house(sheet, left - 126, HORIZON + 3, 200, 2, rng.uniform(0.07, 0.12), rng, True)
    _house(sheet, 190, HORIZON, 150, 2, 0.0, rng, True)
    posts = np.linspace(right - 30, WIDTH - 40, 8)
    ground = HORIZON + FAULT_THROW
    for x in posts:
        sheet.line(
            [(x, ground + (26 if x < right else 0)), (x - (12 if x < right else 0), ground - 58)],
            width=3,
        )
    wire_x = np.linspace(left + 80, right - 40, 20)
    for level in (22, 44):
        sag = 90 * np.sin(np.pi * (wire_x - wire_x[0]) / np.ptp(wire_x)) + level
        sheet.line(zip(wire_x, HORIZON - 60 + sag, strict=True), width=1.3, opacity=0.7)
        sheet.line(
            [(right - 40, ground - 78 + level), (WIDTH - 40, ground - 70 + level)],
            width=1.3,
            opacity=0.7,
        )
    for _ in range(12):
        _stone(
            sheet,
            rng,
            rng.uniform(left + 110, right - 130),
            deep + rng.uniform(-16, 12),
            rng.uniform(8, 20),
        )


def fallen_pylons(sheet: Sheet, rng: np.random.Generator) -> None:
    """A line of pylons that lean towards the fault, their wires down."""
    feet = (
        (190.0, 330.0, 0.03),
        (520.0, 300.0, 0.17),
        (1040.0, 300.0, -0.36),
        (1400.0, 330.0, -0.05),
    )
    tips: list[Point] = []
    for x, tall, lean in feet:
        lean += rng.normal(0, 0.015)
        y = sheet.ground(x)
        _pylon(sheet, x, y, tall, lean)
        tips += _turned([(x, y - 0.84 * tall)], (x, y), lean)
    for (x0, y0), (x1, y1) in pairwise(tips):
        for shift in (0.0, 26.0):
            s = np.linspace(0, 1, 24)
            sag = (52 + shift) * 4 * s * (1 - s)
            xs = x0 + (x1 - x0) * s
            ys = np.minimum(y0 + (y1 - y0) * s + sag, [sheet.ground(v) - 3 for v in xs])
            sheet.line(zip(xs, ys, strict=True), width=1.4, opacity=0.85)
    sheet.line(
        jagged(rng, (FAULT_X + 30, HORIZON - 12), (FAULT_X - 130, HORIZON - 2), 6), width=1.6
    )
    _house(sheet, 640, HORIZON, 118, 2, -0.04, rng, True)
    _house(sheet, 1180, HORIZON + FAULT_THROW, 130, 1, 0.05, rng, True)
    _fault(sheet, rng, HORIZON - 2)
    for _ in range(8):
        x = rng.uniform(700, 980)
        _stone(sheet, rng, x, sheet.ground(x) - 4, rng.uniform(6, 15))


MOTIFS: dict[str, Callable[[Sheet, np.random.Generator], None]] = {
    'cracked wall': cracked_wall,
    'tilted house': tilted_house,
    'broken road': broken_road,
    'collapsed bridge': collapsed_bridge,
    'sinkhole': sinkhole,
    'fallen pylons': fallen_pylons,
}
