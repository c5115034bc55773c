# SPDX-License-Identifier: Apache-2.0
"""Right halves: the fault that comes up through the layers, and what it breaks.

`sheet.damage` says how far, 0.25 to 1. What is random is drawn in the same order whatever it is, or
from a generator of its own, so that the degrees of an image are one place at different times.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from drawings.sheet import (
    FAULT_LEAN,
    FAULT_X,
    HEIGHT,
    HORIZON,
    WIDTH,
    Point,
    Sheet,
    apart,
    jagged,
)


def fault(sheet: Sheet, rng: np.random.Generator, top: float = HORIZON) -> None:
    """Draw the fault itself, from the deep up to `top`, or not so far yet, where one is."""
    if not sheet.broken:
        return
    foot = (FAULT_X + FAULT_LEAN * (HEIGHT - HORIZON), float(HEIGHT))
    share = min(0.35 + 0.9 * sheet.damage, 1.0)
    sheet.crack(rng, foot, (FAULT_X, top), 13.0, 1.8 + 2.4 * sheet.damage, share)


def some(sheet: Sheet, count: int) -> int:
    """How many of `count` things have fallen by now."""
    return round(count * sheet.damage**1.5)


def turned(points: list[Point], pivot: Point, angle: float) -> list[Point]:
    c, s = np.cos(angle), np.sin(angle)
    return [
        (
            pivot[0] + c * (x - pivot[0]) - s * (y - pivot[1]),
            pivot[1] + s * (x - pivot[0]) + c * (y - pivot[1]),
        )
        for x, y in points
    ]


def house(
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
    sheet.polygon(turned(box, (x, y), angle), look.shade)
    sheet.line(turned([*box, box[0]], (x, y), angle), width=2.6)
    sheet.polygon(turned(roof, (x, y), angle), look.body)
    sheet.line(turned([*roof, roof[0]], (x, y), angle), width=2.6)
    columns = max(int(wide // 56), 2)
    for floor in range(floors):
        for column in range(columns):
            wx = x + (column + 0.5) * wide / columns - 13
            wy = y - 32 - floor * 62 - 30
            pane = [(wx, wy), (wx + 26, wy), (wx + 26, wy + 36), (wx, wy + 36)]
            lit = rng.random() < 0.16
            sheet.polygon(
                turned(pane, (x, y), angle),
                look.thread if lit else look.line,
                0.75 if lit else 0.13,
            )
            sheet.line(turned([*pane, pane[0]], (x, y), angle), width=1.4, opacity=0.7)


def cracked_wall(sheet: Sheet, rng: np.random.Generator) -> None:
    """A long wall of blocks, opened from the ground to its top."""
    look = sheet.palette
    left, right, top = 210.0, 1390.0, HORIZON - 330
    rows, tall = 11, 30.0
    gap = jagged(rng, (FAULT_X, HORIZON), (FAULT_X + rng.uniform(-150, 150), top), 34)
    way = np.array(gap)[::-1]
    reach = 330 * (0.15 + 1.2 * sheet.damage)  # of the crack, up the wall

    def cut(y: float) -> float:
        return float(np.interp(y, way[:, 1], way[:, 0]))

    def wide(y: float) -> float:
        return 26 * sheet.damage * max(1 - (HORIZON - y) / reach, 0.0)

    open_gap = [(px, py + 6) for px, py in gap if wide(py) > 0.5]
    if len(open_gap) > 1:
        sheet.thread(
            open_gap, 3.0
        )  # its halo is seen through the gap alone: the bricks lie over it
    for side, drop in ((-1, 0.0), (1, sheet.throw)):
        edge = [(px + side * wide(py), py + drop) for px, py in gap]
        far = left if side < 0 else right
        sheet.polygon([(far, HORIZON + drop), *edge, (far, top + drop)], look.shade)
        for row in range(rows + 1):
            y = HORIZON - row * tall
            near = cut(max(y, top)) + side * wide(y)
            sheet.line(
                [(far, y + drop), (near, y + drop)],
                width=2.4 if row == rows else 1.3,
                opacity=0.9 if row == rows else 0.42,
            )
            if row == rows:
                break
            shift = 48.0 if row % 2 else 0.0
            for x in np.arange(left + shift, right, 96.0):
                if (x - cut(y - tall / 2)) * side > 10 + wide(y - tall / 2):
                    sheet.line([(x, y + drop), (x, y - tall + drop)], width=1.3, opacity=0.42)
        sheet.line([p for p in edge if wide(p[1] - drop) > 0.5], width=2.4)
        sheet.line([(far, HORIZON + drop), (far, top + drop)], width=2.0, opacity=0.8)
    deep = apart(rng)
    for _ in range(some(sheet, 16)):
        x, y = rng.uniform(620, 1000), HORIZON + rng.uniform(-14, 0)
        stone(sheet, rng, x, y + (sheet.throw if x > FAULT_X else 0), rng.uniform(8, 22))
    fault(sheet, deep)


def stone(sheet: Sheet, rng: np.random.Generator, x: float, y: float, r: float) -> None:
    angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
    shape = [(x + r * np.cos(a), y + 0.7 * r * np.sin(a)) for a in angles]
    sheet.polygon(shape, sheet.palette.body)
    sheet.line([*shape, shape[0]], width=1.6, opacity=0.8)


def tilted_house(sheet: Sheet, rng: np.random.Generator) -> None:
    """A street of houses; the one over the fault has leaned and sunk."""
    lean = rng.uniform(0.24, 0.3) * sheet.damage**1.3
    for x, wide, floors, gable in ((120, 150, 3, False), (285, 190, 2, True), (490, 170, 4, False)):
        house(sheet, x, HORIZON, wide, floors, rng.normal(0, 0.006), rng, gable)
    for x, wide, floors, gable in ((1110, 180, 2, True), (1305, 160, 4, False)):
        house(
            sheet,
            x,
            HORIZON + sheet.throw,
            wide,
            floors,
            rng.normal(0.012, 0.006) * sheet.damage,
            rng,
            gable,
        )
    sunk = 30 * sheet.damage
    house(sheet, 742, HORIZON + sunk, 230, 4, lean, rng, bool(rng.random() < 0.5))
    fault(sheet, apart(rng), HORIZON + 14)
    for _ in range(some(sheet, 12)):
        px = rng.uniform(700, 1080)
        stone(sheet, rng, px, sheet.ground(px) - 4, rng.uniform(6, 15))


def broken_road(sheet: Sheet, rng: np.random.Generator) -> None:
    """A road seen along its length, torn and displaced where the fault crosses it."""
    look = sheet.palette
    vanish = (rng.uniform(720, 880), HORIZON - 26)
    sheet.stands = lambda x: HORIZON

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
    upper, lower = tear + 4 - 22 * sheet.damage, tear + 4 + 30 * sheet.damage
    halves = (HORIZON + 1.0, upper, 0.0), (lower, float(HEIGHT), 190 * sheet.damage**1.4)
    for y0, y1, offset in halves:
        (a0, b0), (a1, b1) = across(y0, offset), across(y1, offset)
        far, near = [(a0, y0), (b0, y0)], [(b1, y1), (a1, y1)]
        if offset:
            far = jagged(rng, (a0, y0), (b0, y0), 20 * sheet.damage)
        else:
            near = jagged(rng, (b1, y1), (a1, y1), 14 * sheet.damage)
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
    ends = (max(a - 420, 0), tear + 40), (min(b + 480, WIDTH), tear - 24)
    sheet.crack(apart(rng), *ends, 17, 1.6 + 3.8 * sheet.damage, 0.25 + 0.75 * sheet.damage)
    for k, x in enumerate((vanish[0] - 330, vanish[0] - 520, vanish[0] - 800)):
        pylon(sheet, x, HORIZON, 120 + 62 * k, (-0.02 - 0.12 * k) * sheet.damage)


def pylon(sheet: Sheet, x: float, y: float, tall: float, lean: float) -> None:
    foot = (x, y)
    wide = tall * 0.11

    def t(points: list[Point]) -> list[Point]:
        return turned(points, foot, lean)

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
    d = sheet.damage
    for i, x in enumerate((150.0, 430.0, 710.0, 1010.0, 1290.0, 1510.0)):
        y, top = sheet.ground(x), deck + thick + (sheet.throw * 0.7 if x > FAULT_X else 0.0)
        lean = {2: -0.06, 3: 0.13}.get(i, 0.0) * d
        head = top + 6  # under the deck, into which no pier reaches
        shape = turned([(x - 20, y), (x - 15, head), (x + 15, head), (x + 20, y)], (x, y), lean)
        sheet.polygon(shape, look.shade)
        sheet.line(shape, width=2.4)
    # Two spans over the fault: they crack, sag, and fall one after the other.
    right = deck + 0.7 * sheet.throw
    fall, fell = min(max((d - 0.25) / 0.5, 0), 1), min(max((d - 0.5) / 0.5, 0), 1)
    middle = 862.0 + 4 * d
    spans: list[list[Point]] = [
        [(0, deck), (700, deck)],
        [(704, deck + 6 * d), (middle + 46 * fall, deck + 10 * d + (HORIZON - deck - 4) * fall)],
        [(1018, right), (middle + 60 * fell, right + (HORIZON + sheet.throw - right - 8) * fell)],
        [(1022, right), (WIDTH, right)],
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
    bars = apart(rng)
    for x0, way, torn in ((704.0, 1, fall), (1018.0, -1, fell)):
        for k in range(4 if torn > 0.3 else 0):  # what reinforced it sticks out of the break
            end = (x0 + way * bars.uniform(18, 40), deck + 30 + k * 9)
            sheet.line(jagged(bars, (x0, deck + 6 + k * 6), end, 5), width=1.5)
    deep = apart(rng)
    for _ in range(some(sheet, 18)):
        x = rng.uniform(720, 1010)
        stone(sheet, rng, x, sheet.ground(x) - 4, rng.uniform(7, 24))
    fault(sheet, deep, HORIZON + 6)


def sinkhole(sheet: Sheet, rng: np.random.Generator) -> None:
    """A hole opened under a field; a house stands over its edge, a fence hangs across."""
    look = sheet.palette
    reach = 0.3 + 0.7 * sheet.damage
    left, right = FAULT_X + 40 - 280 * reach, FAULT_X + 40 + 280 * reach
    deep = HORIZON + 275 * reach
    slope = 100 * reach
    crack, rng_hole = apart(rng), apart(rng)
    sheet.stands = lambda x: np.nan if left - 15 < x < right + 15 else sheet.footing(x)
    rim_l = jagged(rng_hole, (left, HORIZON), (left + slope, deep), 22 * reach)
    low = (right - slope, deep + sheet.throw * 0.5)
    rim_r = jagged(rng_hole, low, (right, HORIZON + sheet.throw), 22 * reach)
    hole = [*rim_l, *rim_r]
    sheet.polygon(hole, look.shade)
    for k in range(1, 6):
        y = HORIZON + k * 46 * reach
        inset = (22 + k * 13) * reach
        sheet.line(
            jagged(rng_hole, (left + inset, y), (right - inset, y + 16), 9), width=1.2, opacity=0.24
        )
    sheet.line(hole, width=2.6)
    width = 1.8 + 2.4 * sheet.damage
    sheet.crack(crack, (FAULT_X + 40, float(HEIGHT)), (FAULT_X + 20, deep + 6), 12, width)
    for x0 in (left + 1.7 * slope, right - 1.8 * slope):
        end = (x0, HORIZON + 200 * reach)
        sheet.crack(crack, (FAULT_X + 20, deep + 6), end, 14, 0.5 * width)
    # The house stood 60 m from the edge; the hole comes to it, and it leans in.
    lean = rng.uniform(0.07, 0.12) * max(sheet.damage - 0.4, 0) / 0.6
    house(sheet, 434, HORIZON + 3, 200, 2, lean, rng, True)
    house(sheet, 190, HORIZON, 150, 2, 0.0, rng, True)
    # A fence to the edge: the posts that have lost their ground have gone, their wires hang down.
    ground = HORIZON + sheet.throw
    posts = [x for x in np.arange(WIDTH - 40.0, 900.0, -62.0) if x > right + 8]
    for x in posts:
        sheet.line([(x, ground), (x, ground - 58)], width=3)
    for level in (22, 44):
        end, torn = posts[-1], ground - 78 + level + 20
        sheet.line([(end, torn), (WIDTH - 40, torn)], width=1.3, opacity=0.7)
        curl = [(end, torn), (end - 12, torn + 8), (right - 4, ground - 10 + level / 2)]
        sheet.line([*curl, (right - 14, ground + 26 + level)], width=1.3, opacity=0.7)
    for _ in range(some(sheet, 12)):
        stone(
            sheet,
            rng,
            rng.uniform(left + slope + 10, right - slope - 20),
            deep + rng.uniform(-16, 12),
            rng.uniform(8, 20),
        )


def fallen_pylons(sheet: Sheet, rng: np.random.Generator) -> None:
    """A line of pylons that lean towards the fault, their wires down."""
    # Lean of each when the damage is whole: the two at the fault lie on the ground.
    feet = (
        (190.0, 330.0, 0.1),
        (500.0, 300.0, 1.46),
        (1150.0, 300.0, -1.5),
        (1430.0, 330.0, -0.12),
    )
    house(sheet, 700, HORIZON, 96, 2, -0.05 * sheet.damage, rng, True)
    house(sheet, 1250, HORIZON + sheet.throw, 110, 1, 0.05 * sheet.damage, rng, True)
    arms: list[tuple[Point, Point]] = []
    for x, tall, most in feet:
        lean = (most + rng.normal(0, 0.015)) * sheet.damage**2
        y = sheet.ground(x)
        pylon(sheet, x, y, tall, lean)
        tips = [(x - 0.28 * tall, y - 0.84 * tall), (x + 0.28 * tall, y - 0.84 * tall)]
        left, right = turned(tips, (x, y), lean)
        arms.append((left, right))
    for (left0, right0), (left1, right1) in pairwise(arms):
        for (x0, y0), (x1, y1) in ((left0, left1), (right0, right1)):
            s = np.linspace(0, 1, 24)
            xs = x0 + (x1 - x0) * s
            sagged = y0 + (y1 - y0) * s + 52 * 4 * s * (1 - s)
            ys = np.minimum(sagged, [sheet.ground(v) - 3 for v in xs])  # what hangs lower lies
            sheet.line(zip(xs, ys, strict=True), width=1.4, opacity=0.85)
    fault(sheet, apart(rng), HORIZON - 2)
    for _ in range(some(sheet, 10)):
        x = rng.uniform(700, 980)
        stone(sheet, rng, x, sheet.ground(x) - 4, rng.uniform(6, 15))


Motif = Callable[[Sheet, np.random.Generator], None]
MOTIFS: dict[str, Motif] = {
    'cracked wall': cracked_wall,
    'tilted house': tilted_house,
    'broken road': broken_road,
    'collapsed bridge': collapsed_bridge,
    'sinkhole': sinkhole,
    'fallen pylons': fallen_pylons,
}
