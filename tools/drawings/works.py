# SPDX-License-Identifier: Apache-2.0
"""Left halves that are seen otherwise than as a section: a mine and an interchange from above, a
hall and a tunnel from within, a platform in the sea, cooling towers over a village."""

from itertools import pairwise

import numpy as np
from drawings.damage import Motif, turned
from drawings.sheet import HEIGHT, HORIZON, WIDTH, Point, Sheet, apart, waves
from scipy.spatial import ConvexHull


def open_cast(sheet: Sheet, rng: np.random.Generator) -> None:
    """A mine from above: benches, a haul road that winds down, a village at its rim."""
    look = sheet.palette
    sheet.stands, sheet.falls_to = None, None
    sheet.rect(0, 0, WIDTH, HEIGHT, look.layers[3])
    fields = apart(rng)
    for k in range(-4, 14):  # fields, ploughed in one direction each
        for row in range(6):
            corner: Point = (150.0 * k + 40 * row, 170.0 * row - 20)
            plot = turned([corner, (corner[0] + 138, corner[1]), (corner[0] + 138, corner[1] + 158),
                           (corner[0], corner[1] + 158)], (800, 450), -0.12)  # fmt: skip
            tone = fields.random()
            if all(-50 < x < WIDTH + 50 and -50 < y < HEIGHT + 50 for x, y in plot):
                sheet.polygon(plot, look.hills[0] if tone > 0.5 else look.layers[1], 0.5)
                a, b, c, d = np.array(plot)
                share = np.linspace(0.1, 0.9, 3 + int(5 * tone))[:, None]
                ends = (a + share * (b - a), d + share * (c - d)) if tone > 0.3 else (
                    a + share * (d - a), b + share * (c - b))  # fmt: skip
                sheet.marks(
                    ((tuple(p), tuple(q - p)) for p, q in zip(*ends, strict=True)), 1.1, 0.2
                )
    phase = rng.uniform(0, 2 * np.pi, 3)
    levels = 8

    def bench(angle: float | np.ndarray, level: float | np.ndarray) -> np.ndarray:
        """Points (n, 2) of the edge of a bench; the deeper, the nearer to the middle."""
        shape = 1 + 0.12 * np.sin(2 * angle + phase[0]) + 0.07 * np.sin(3 * angle + phase[1])
        shape = shape + 0.03 * np.sin(5 * angle + phase[2])
        wide = (1 - level / (levels + 1.6)) ** 1.15
        x = 760 + 26 * level * 0.6 + 560 * wide * shape * np.cos(angle)
        y = 440 + 6 * level + 345 * wide * shape * np.sin(angle)
        return np.stack([x, y], axis=-1)

    ring = np.linspace(0, 2 * np.pi, 97)
    for level in range(levels + 1):
        edge = bench(ring, float(level))
        points = [tuple(p) for p in edge]
        if level == 0:
            sheet.polygon(points, look.body)
        else:
            sheet.polygon(points, look.shade if level % 2 else look.layers[2], 0.42)
        sheet.line(points, width=2.4 if level == 0 else 1.5, opacity=0.95 if level == 0 else 0.6)
        if level < levels:  # where the slope lies towards us it is marked
            at = np.linspace(0, 2 * np.pi, 150)
            top, low = bench(at, float(level)), bench(at, level + 0.42)
            seen = np.sin(at - 0.7) < 0.25
            edges = zip(top[seen], low[seen], strict=True)
            sheet.marks(((tuple(p), tuple(q - p)) for p, q in edges), 1.1, 0.34)
    turn = np.linspace(0, 1, 150)
    begin = rng.uniform(2.7, 3.3)
    way = bench(begin + 4.4 * np.pi * turn, (levels - 0.3) * turn)
    come = np.linspace(1, 0, 12)[:, None]  # to the rim, along a tangent
    road = way[0] + come * (way[0] - way[1]) * 9 + come**2 * (-300, 330)
    sheet.thread([*map(tuple, road), *map(tuple, way)], 3.4)
    trucks = apart(rng)
    for share in np.sort(trucks.uniform(0.02, 0.97, 13)):
        k = min(int(share * 149), 148)
        here, ahead = way[k], way[k + 1] - way[k]
        size = 1.1 - 0.45 * share
        box: list[Point] = [(-13, -7), (13, -7), (13, 7), (-13, 7)]
        angle = float(np.arctan2(ahead[1], ahead[0]))
        body = turned(
            [(here[0] + size * x, here[1] + size * y) for x, y in box], tuple(here), angle
        )
        sheet.polygon(body, look.line)
        tray = turned([(here[0] + size * x * 0.55 - 3, here[1] + size * y * 0.7) for x, y in box],
                      tuple(here), angle)  # fmt: skip
        sheet.polygon(tray, look.shade)
    pool = bench(ring, levels + 0.55)
    sheet.polygon([tuple(p) for p in pool], look.sky[1])
    sheet.line([tuple(p) for p in pool], width=1.4, opacity=0.8)
    village = apart(rng)
    for _ in range(70):
        angle, far = village.uniform(-0.62, 0.42), village.uniform(1.0, 1.34)
        x, y = (bench(np.array([angle]), 0.0)[0] - (760, 440)) * far + (760, 440)
        turn_by, wide, lit = village.normal(0.2, 0.1), village.uniform(17, 27), village.random()
        if x > WIDTH - 30 or far < 1.03:
            continue
        roof = turned([(x, y), (x + wide, y), (x + wide, y + 15), (x, y + 15)], (x, y), turn_by)
        sheet.polygon(roof, look.thread if lit < 0.08 else look.shade, 1.0)
        sheet.line([*roof, roof[0]], width=1.3, opacity=0.85)
        ridge = turned([(x, y + 7.5), (x + wide, y + 7.5)], (x, y), turn_by)
        sheet.line(ridge, width=1.0, opacity=0.5)


def interchange(sheet: Sheet, rng: np.random.Generator) -> None:
    """Two motorways at night, from above: what drives on them is the thread."""
    look = sheet.palette
    sheet.stands, sheet.falls_to = None, None
    sheet.rect(0, 0, WIDTH, HEIGHT, look.layers[1])
    middle = np.array([800.0, 450.0])
    turn = rng.uniform(-0.16, -0.06)

    def placed(points: np.ndarray) -> list[Point]:
        c, s = np.cos(turn), np.sin(turn)
        at = points @ np.array([[c, s], [-s, c]]) + middle
        return [tuple(p) for p in at]

    blocks = apart(rng)
    for x in np.arange(-980, 980, 74.0):
        for y in np.arange(-640, 640, 66.0):
            w, h, tone, kept = blocks.uniform((34, 30, 0, 0), (62, 54, 1, 1))
            corner = np.array([x, y])
            far = np.abs(corner + (w / 2, h / 2))
            if min(far) < 96 or np.hypot(*np.maximum(780 - far, 0)) > 672 or kept < 0.12:
                continue
            box = placed(corner + np.array([[0, 0], [w, 0], [w, h], [0, h]]))
            if all(-40 < px < WIDTH + 40 and -40 < py < HEIGHT + 40 for px, py in box):
                sheet.polygon(box, look.shade if tone > 0.5 else look.hills[1])
                sheet.line([*box, box[0]], width=1.3, opacity=0.6)
                if tone < 0.07:
                    pane = placed(corner + np.array([[8, 8], [18, 8], [18, 18], [8, 18]]))
                    sheet.polygon(pane, look.thread, 0.7)
    trees = apart(rng)
    for _ in range(230):
        r, a, size = trees.uniform(110, 560), trees.uniform(0, 2 * np.pi), trees.uniform(4, 9)
        x, y = r * np.cos(a), r * np.sin(a)
        outside = 740 - np.hypot(abs(x) - 780, abs(y) - 780)  # of the outer ramps, where below 0
        loop = abs(np.hypot(abs(x) - 150, abs(y) - 150) - 95)
        if min(abs(x), abs(y)) > 70 and loop > 28 and outside < -26:
            sheet.ring(*placed(np.array([[x, y]]))[0], size, 1.1, 0.35)

    def road(way: np.ndarray, wide: float, lanes: tuple[float, ...] = ()) -> None:
        points = placed(way)
        sheet.line(points, look.line, wide + 5, 0.9)
        sheet.line(points, look.shade, wide)
        for lane in lanes:
            sheet.line(placed(beside(way, lane)), width=1.4, opacity=0.45, dash='16 18')

    def beside(way: np.ndarray, off: float) -> np.ndarray:
        along = np.gradient(way, axis=0)
        along /= np.hypot(along[:, 0], along[:, 1])[:, None]
        return way + off * np.stack([-along[:, 1], along[:, 0]], axis=1)

    def traffic(way: np.ndarray, off: float, count: int, bright: bool) -> None:
        lane = beside(way, off)
        for _ in range(count):
            long = int(rng.integers(4, max(len(lane) // 5, 6)))
            k = int(rng.integers(0, max(len(lane) - long, 1)))
            piece = placed(lane[k : k + long])
            if bright:
                sheet.thread(piece, 2.2)
            else:
                sheet.line(piece, width=1.8, opacity=0.8)

    reach = np.linspace(-960, 960, 97)
    under = np.stack([0 * reach, 0.53 * reach], axis=1)
    over = np.stack([0.9 * reach, 0 * reach], axis=1)
    road(under, 86, (-22, 22))
    quarter = np.linspace(0, np.pi / 2, 25)
    for sx in (-1, 1):
        for sy in (-1, 1):
            # from road to road on the outside, and the loop within it
            outer = np.stack([780 - 740 * np.sin(quarter), 780 - 740 * np.cos(quarter)], axis=1)
            outer = outer[outer[:, 1] < 505] * (sx, sy)
            road(outer, 24)
            bend = np.linspace(-np.pi / 2, np.pi, 40)
            loop = np.stack([150 + 95 * np.cos(bend), 150 + 95 * np.sin(bend)], axis=1)
            loop = np.concatenate([[(40, 36)], loop, [(36, 40)]]) * (sx, sy)
            road(loop, 22)
            traffic(outer, 0, 2, True)
            traffic(loop, 0, 2, sx == sy)
    for off in (-32, -11):
        traffic(under, off, 7, True)
    for off in (11, 32):
        traffic(under, off, 7, False)
    road(over, 92, (-24, 24))
    sheet.line(placed(beside(over, 0)), width=3.0, opacity=0.9)
    sheet.line(placed(beside(under[:44], 0)), width=3.0, opacity=0.9)
    sheet.line(placed(beside(under[54:], 0)), width=3.0, opacity=0.9)
    for off in (-35, -13):
        traffic(over, off, 8, True)
    for off in (13, 35):
        traffic(over, off, 8, False)


def turbine_hall(sheet: Sheet, rng: np.random.Generator) -> None:
    """A hall of turbines from within; their one shaft goes on, down through the floor."""
    look = sheet.palette
    sheet.stands, sheet.falls_to = None, None
    vanish, floor, roof, side = np.array([760.0, 380.0]), -350.0, 384.0, 880.0

    def seen(x: float, y: float, depth: float) -> Point:
        s = 1 / (1 + depth)
        return (float(vanish[0] + x * s), float(vanish[1] - y * s))

    end = 5.2
    for corners, fill in (
        (((-side, roof), (side, roof)), look.layers[0]),
        (((side, roof), (side, floor)), look.layers[1]),
        (((side, floor), (-side, floor)), look.layers[5]),
        (((-side, floor), (-side, roof)), look.layers[1]),
    ):
        (ax, ay), (bx, by) = corners
        near, far = [seen(ax, ay, 0), seen(bx, by, 0)], [seen(bx, by, end), seen(ax, ay, end)]
        sheet.polygon([*near, *far], fill)
        sheet.line([near[0], far[1]], width=2.2)
    wall = [seen(-side, roof, end), seen(side, roof, end), seen(side, floor, end),
            seen(-side, floor, end)]  # fmt: skip
    sheet.polygon(wall, look.hills[1])
    sheet.line([*wall, wall[0]], width=2.0)
    gate = [seen(x, y, end) for x, y in ((-170, floor), (-170, 40), (170, 40), (170, floor))]
    sheet.polygon(gate, look.sky[1])
    sheet.line(gate, width=1.6)
    ribs = np.linspace(0, end, 12)
    for near, far in pairwise(ribs):
        a, b = near + 0.18 * (far - near), near + 0.82 * (far - near)
        for x in (-side, side):
            for low, high in ((-40.0, 250.0),):
                pane = [seen(x, low, a), seen(x, high, a), seen(x, high, b), seen(x, low, b)]
                sheet.polygon(pane, look.sky[1], 0.85)
                sheet.line([*pane, pane[0]], width=1.3, opacity=0.8)
                for share in (1 / 3, 2 / 3):
                    y = low + share * (high - low)
                    sheet.line([seen(x, y, a), seen(x, y, b)], width=1.0, opacity=0.5)
    for depth in ribs[::-1]:  # trusses under the roof
        s = 1 / (1 + depth)
        xs = np.linspace(-side, side, 17)
        zigzag = [seen(x, roof - 92 * (k % 2), depth) for k, x in enumerate(xs)]
        sheet.line(zigzag, width=1.6 * s + 0.5, opacity=0.7)
        sheet.line([seen(-side, roof - 92, depth), seen(side, roof - 92, depth)],
                   width=2.6 * s + 0.4, opacity=0.9)  # fmt: skip
        for x in (-side, side):
            sheet.line(
                [seen(x, floor, depth), seen(x, roof, depth)], width=2.4 * s + 0.4, opacity=0.6
            )
    for x in (-side, side):  # what the crane runs on
        sheet.line([seen(x * 0.985, 268, 0), seen(x * 0.985, 268, end)], width=2.6)
    for x in np.linspace(-side, side, 12)[1:-1]:
        sheet.line([seen(x, floor, 0), seen(x, floor, end)], width=1.0, opacity=0.16)
    axis, tall = 330.0, -188.0  # of the shaft
    units = np.array([4.1, 2.6, 1.45, 0.32])
    arc = np.linspace(0, np.pi, 19)
    behind = end
    for number, near in enumerate(units):
        far = near + 0.24 * (1 + near)
        sheet.thread([seen(axis, tall, behind), seen(axis, tall, far)], max(5 / (1 + near), 1.4))
        behind = near
        for wide, base, round_top, fill in (
            (215, floor, 0.0, look.shade),
            (158, tall, 1.0, look.body),
        ):
            if round_top:
                outline = [(axis + wide * np.cos(a), base + 1.06 * wide * np.sin(a)) for a in arc]
            else:
                outline = [(axis - wide, base), (axis + wide, base), (axis + wide, tall),
                           (axis - wide, tall)]  # fmt: skip
            front = [seen(x, y, near) for x, y in outline]
            both = np.array(front + [seen(x, y, far) for x, y in outline])
            hull = [tuple(p) for p in both[ConvexHull(both).vertices]]
            sheet.polygon(hull, look.layers[3])
            sheet.line([*hull, hull[0]], width=1.4 + 1 / (1 + near))
            sheet.polygon(front, fill)
            sheet.line([*front, front[0]], width=1.4 + 1.4 / (1 + near))
        for ring in (0.74, 0.46):
            sheet.line([seen(axis + 158 * ring * np.cos(a), tall + 167 * ring * np.sin(a), near)
                        for a in arc], width=1.3, opacity=0.75)  # fmt: skip
        for a in arc[1:-1:2]:
            sheet.line([seen(axis + 73 * np.cos(a), tall + 77 * np.sin(a), near),
                        seen(axis + 117 * np.cos(a), tall + 124 * np.sin(a), near)],
                       width=1.2, opacity=0.6)  # fmt: skip
        x, y = seen(axis, tall, near)
        sheet.disc(x, y, 26 / (1 + near), look.shade)
        sheet.ring(x, y, 26 / (1 + near), 1.8)
        if number == 2:  # the crane, over the second of them, with a rotor on its hook
            for high in (268.0, 232.0):
                sheet.line(
                    [seen(-0.985 * side, high, near), seen(0.985 * side, high, near)], width=3
                )
            corners = [seen(x * side, y, near) for x in (-0.98, 0.98) for y in (268, 232)]
            sheet.truss(*corners, 22, 1.1)
            hook = -330.0
            trolley = (-46, 232), (46, 232), (46, 196), (-46, 196)
            sheet.polygon([seen(hook + x, y, near) for x, y in trolley], look.line)
            sheet.line([seen(hook, 196, near), seen(hook, 20, near)], width=1.8)
            sling = (-90, -40), (0, 20), (90, -40)
            sheet.line([seen(hook + x, y, near) for x, y in sling], width=1.5)
            sheet.line(
                [seen(hook - 130, -52, near), seen(hook + 130, -52, near)], width=18 / (1 + near)
            )
            sheet.line(
                [seen(hook - 100, -52, near), seen(hook + 100, -52, near)], width=40 / (1 + near)
            )
    people = apart(rng)
    for x, depth in ((-430.0, 0.25), (-360.0, 0.34), (-520.0, 1.3), (-250.0, 2.4)):
        px, py = seen(x, floor, depth)
        sheet.person(px, py, 68 / (1 + depth), people)
    x, y = seen(axis, tall, units[-1])
    low = seen(axis, floor, 0)[1]
    sheet.polygon([(x - 30, low), (x + 30, low), (x + 30, HEIGHT), (x - 30, HEIGHT)], look.shade)
    for off in (-30, 30):
        sheet.line([(x + off, low), (x + off, HEIGHT)], width=2.2, opacity=0.8)
    sheet.thread([(x, y), (x, HEIGHT)], 4.6)
    sheet.line([(0, low), (x - 30, low)], width=2.6)
    sheet.line([(x + 30, low), (WIDTH, low)], width=2.6)


def platform(sheet: Sheet, rng: np.random.Generator) -> None:
    """An oil platform in heavy sea, its legs on the bed, its wells spread into the layers."""
    look = sheet.palette
    sea = HORIZON - 172.0
    sheet.stands, sheet.falls_to = None, sea
    x = np.linspace(0, WIDTH, 161)
    swells = apart(rng)

    def swell(height: float) -> np.ndarray:
        y = np.abs(np.sin(x / 94 + swells.uniform(0, 6))) * height  # sharp above, round below
        return height / 2 - y + waves(swells, x, 0.5 * height, 700)

    back = sea - 16 - swell(16)
    sheet.polygon([*zip(x, back, strict=True), (WIDTH, HORIZON), (0, HORIZON)], look.hills[1])
    sheet.line(zip(x, back, strict=True), width=1.4, opacity=0.5)
    deck, left, right = sea - 112.0, 560.0, 1010.0
    middle = (left + right) / 2
    for a in (left + 40, right - 40):  # legs
        lean = 46 if a < middle else -46
        sheet.truss(
            (a - lean - 16, HORIZON),
            (a - lean + 16, HORIZON),
            (a - 13, deck),
            (a + 13, deck),
            12,
            2,
        )
    for low, high in ((0.1, 0.5), (0.5, 0.9)):  # braces from leg to leg
        y0, y1 = HORIZON + low * (deck - HORIZON), HORIZON + high * (deck - HORIZON)
        in0, in1 = 46 * (1 - low) - 56, 46 * (1 - high) - 56
        sheet.line([(left - in0 - 16, y0), (right + in1 + 16, y1)], width=1.8, opacity=0.75)
        sheet.line([(right + in0 + 16, y0), (left - in1 - 16, y1)], width=1.8, opacity=0.75)
        sheet.line([(left - in1 - 16, y1), (right + in1 + 16, y1)], width=1.8, opacity=0.75)
    bores = np.linspace(middle - 60, middle + 60, 5)
    for k, bore in enumerate(bores):  # wells, spread below the bed
        turn = np.linspace(0, 1, 16)
        spread = (k - 2) * 150 + rng.uniform(-30, 30)
        deep = HORIZON + 300 - 26 * abs(k - 2) + rng.uniform(-16, 16)
        way = [(bore + spread * t**1.8, HORIZON + 40 + (deep - HORIZON - 40) * t) for t in turn]
        sheet.thread([(bore, deck + 34), (bore, HORIZON + 40), *way], 2.6)
    for step in (20.0, 56.0):  # decks
        sheet.rect(left, deck - step, right - left, 22, look.shade)
        box = [
            (left, deck - step),
            (right, deck - step),
            (right, deck - step + 22),
            (left, deck - step + 22),
        ]
        sheet.line([*box, box[0]], width=2.2)
    sheet.rect(left + 20, deck + 2, right - left - 40, 32, look.body)
    sheet.line([(left + 20, deck + 2), (left + 20, deck + 34), (right - 20, deck + 34),
                (right - 20, deck + 2)], width=2)  # fmt: skip
    for a in np.arange(left + 6, right, 40):
        sheet.line([(a, deck - 34), (a, deck - 20)], width=2)
    top = deck - 56
    sheet.truss(
        (middle - 46, top),
        (middle + 46, top),
        (middle - 12, top - 138),
        (middle + 12, top - 138),
        7,
        2,
    )
    sheet.rect(middle - 18, top - 152, 36, 14, look.line)
    house_x = right - 130
    sheet.rect(house_x, top - 92, 118, 92, look.shade)  # where they live, and a helicopter lands
    walls = (0, 0), (0, 92), (118, 92), (118, 0)
    sheet.line([(house_x + x, top - y) for x, y in walls], width=2.2)
    lit = apart(rng)
    for row in range(3):
        for column in range(6):
            sheet.rect(house_x + 9 + 18 * column, top - 82 + 28 * row, 10, 12,
                       look.thread if lit.random() < 0.4 else look.line,
                       0.8 if lit.random() < 0.5 else 0.2)  # fmt: skip
    sheet.line([(house_x - 14, top - 104), (house_x + 150, top - 104)], width=6)
    sheet.line([(house_x + 118, top - 60), (house_x + 146, top - 100)], width=2)
    sheet.line(
        [(left + 120, top), (left + 120, top - 74), (left + 20, top - 128)], width=4
    )  # crane
    sheet.line([(left + 120, top - 74), (left + 142, top - 104), (left + 20, top - 128)], width=1.5)
    sheet.line([(left + 20, top - 128), (left + 20, top - 40)], width=1.3)
    sheet.truss(
        (left + 2, top + 30),
        (left + 2, top + 4),
        (left - 172, top - 50),
        (left - 178, top - 66),
        9,
        1.6,
    )
    flame = np.array([left - 176, top - 60])
    for size, opacity in ((58, 0.07), (34, 0.16), (16, 0.9)):
        sheet.disc(flame[0] - 0.7 * size, flame[1] - 0.8 * size, size, look.thread, opacity)
    tongue = [(2, 6), (-20, -6), (-50, -4), (-84, -22), (-112, -18), (-86, -36), (-100, -52),
              (-62, -44), (-38, -52), (-12, -30), (6, -8)]  # fmt: skip
    sheet.polygon([tuple(flame + p) for p in tongue], look.thread)
    people = apart(rng)
    for px in (middle + 66, middle + 92, left + 60):
        sheet.person(px, top, 17, people)
    # the sea before the legs: they are seen through it
    front = sea - swell(38)
    water = [*zip(x, front, strict=True), (WIDTH, HORIZON), (0, HORIZON)]
    sheet.polygon(water, look.hills[0], 0.8)
    sheet.line(zip(x, front, strict=True), width=2.6)
    foam = apart(rng)
    crests = [k for k in range(2, 159) if front[k] < front[k - 1] and front[k] <= front[k + 1]]
    for k in crests:
        for _ in range(9):
            dx, dy = foam.uniform(-44, 26), foam.uniform(2, 34)
            y = float(np.interp(x[k] + dx, x, front)) + dy
            sheet.line(
                [(x[k] + dx, y), (x[k] + dx - foam.uniform(8, 30), y + 4)], width=1.4, opacity=0.6
            )
    for _ in range(46):
        px, py = foam.uniform(0, WIDTH), foam.uniform(sea + 50, HORIZON - 14)
        sheet.line([(px, py), (px + foam.uniform(16, 60), py)], width=1.2, opacity=0.25)
    bx = 1255.0  # a supply ship, pitching
    by = float(np.interp(bx + 70, x, front)) + 14
    hull = turned([(bx, by - 26), (bx + 96, by - 26), (bx + 150, by - 44), (bx + 126, by + 16),
                   (bx + 12, by + 16)], (bx + 70, by), -0.13)  # fmt: skip
    cabin = [(bx + 84, by - 26), (bx + 84, by - 66), (bx + 122, by - 66), (bx + 126, by - 36)]
    cabin = turned(cabin, (bx + 70, by), -0.13)
    mast = turned([(bx + 102, by - 66), (bx + 102, by - 104)], (bx + 70, by), -0.13)
    sheet.line(mast, width=2)
    for shape, fill in ((cabin, look.body), (hull, look.shade)):
        sheet.polygon(shape, fill)
        sheet.line([*shape, shape[0]], width=2.2)
    near = (x > bx - 60) & (x < bx + 220)
    wave = [*zip(x[near], front[near] + 10, strict=True)]
    sheet.polygon(
        [*wave, (wave[-1][0], wave[-1][1] + 50), (wave[0][0], wave[0][1] + 50)], look.hills[0]
    )


def tunnel(sheet: Sheet, rng: np.random.Generator) -> None:
    """A tunnel from within, deep in the layers, its boring machine far ahead."""
    look = sheet.palette
    sheet.stands, sheet.falls_to = None, None
    x = np.linspace(0, WIDTH, 81)
    for number, colour in enumerate(look.layers):
        seam = 160.0 * number - 30 + (waves(rng, x, 26, 1400) if number else 0)
        sheet.polygon(
            [*zip(x, np.full(81, 1.0) * seam, strict=True), (WIDTH, HEIGHT), (0, HEIGHT)], colour
        )
        if number:
            sheet.line(zip(x, seam, strict=True), width=1.3, opacity=0.3)
        strokes = rng.uniform(
            (0, seam.mean() if number else 0), (WIDTH, 160.0 * number + 130), (60, 2)
        )
        step = ((0.0, 0.0), (26.0, 0.0), (9.0, -14.0))[number % 3]
        sheet.marks((((px, py), step) for px, py in strokes), 3.0 if number % 3 == 0 else 1.2, 0.14)
    vanish, radius, end = np.array([775.0, 425.0]), 415.0, 9.0
    near = np.array([800.0, 462.0])

    def seen(u: float, v: float, depth: float) -> Point:
        """Where (u right, v down, in radii from the axis) appears at a depth."""
        s = 1 / (1 + depth)
        at = vanish + (near - vanish) * s + radius * s * np.array([u, v])
        return float(at[0]), float(at[1])

    def ring(depth: float, size: float = 1.0) -> list[Point]:
        return [
            seen(size * np.cos(a), size * np.sin(a), depth) for a in np.linspace(0, 2 * np.pi, 73)
        ]

    sheet.polygon(ring(0, 1.07), look.line, 0.35)
    depths = np.concatenate([[0.0], 0.16 * 1.29 ** np.arange(16)])
    depths = depths[depths < end]
    for number, depth in enumerate(depths):
        sheet.polygon(
            ring(depth), (look.body, look.layers[1], look.layers[2])[number % 2 + (number > 9)]
        )
        sheet.line(ring(depth), width=2.6 / (1 + 0.6 * depth), opacity=0.85)
    for number, (a, b) in enumerate(pairwise(depths)):  # segments, staggered
        for k in range(9):
            angle = 2 * np.pi * (k + 0.5 * (number % 2)) / 9
            u, v = np.cos(angle), np.sin(angle)
            sheet.line([seen(u, v, a), seen(u, v, b)], width=1.8 / (1 + 0.6 * a), opacity=0.55)
            mid = (a + b) / 2
            bolt = angle + np.pi / 9
            if number < 7:
                sheet.disc(*seen(np.cos(bolt), np.sin(bolt), mid), 4.5 / (1 + mid), look.line, 0.4)
    face = seen(0, 0, end - 1.0)
    size = radius / end
    sheet.disc(*face, size, look.shade)
    sheet.ring(*face, size, 2.0)
    for a in np.arange(8) * np.pi / 4 + rng.uniform(0, 0.7):
        sheet.line([face, (face[0] + size * np.cos(a), face[1] + size * np.sin(a))], width=1.8)
    for k in range(3):
        sheet.disc(*face, 14 - 4 * k, look.thread, 0.2 + 0.35 * k)
    floor, wide = 0.62, float(np.sqrt(1 - 0.62**2))
    way = [
        seen(-wide, floor, 0),
        seen(wide, floor, 0),
        seen(wide, floor, end),
        seen(-wide, floor, end),
    ]
    low = np.linspace(np.arcsin(floor), np.pi - np.arcsin(floor), 25)
    sheet.polygon([seen(np.cos(a), np.sin(a), 0) for a in low], look.shade)
    sheet.polygon(way, look.layers[5])
    sheet.line(way[:2], width=3)
    for depth in 0.06 * 1.24 ** np.arange(24):
        if depth < end:
            sheet.line([seen(-0.34, floor, depth), seen(0.34, floor, depth)],
                       width=max(6 / (1 + depth) ** 1.7, 0.7), opacity=0.5)  # fmt: skip
    for u in (-0.24, 0.24):
        sheet.line([seen(u, floor, 0), seen(u, floor, end)], width=3.2)
    for u in (-wide, wide):
        sheet.line([seen(u, floor, 0), seen(u, floor, end)], width=2)
    for angle, off in ((-2.45, 0.96), (-0.7, 0.96)):  # light along both haunches
        u, v = off * np.cos(angle), off * np.sin(angle)
        for a, b in pairwise(depths):
            sheet.thread([seen(u, v, a + 0.3 * (b - a)), seen(u, v, b - 0.3 * (b - a))],
                         max(5.2 / (1 + a), 1.2))  # fmt: skip
    for k in range(4):  # pipes and cables
        u, v = 0.93 * np.cos(2.62 + 0.1 * k), 0.93 * np.sin(2.62 + 0.1 * k)
        sheet.line([seen(u, v, 0), seen(u, v, end)], width=(5, 2, 2, 3)[k], opacity=0.8)
    duct = [
        seen(0.1 + 0.17 * np.cos(a), -0.76 + 0.17 * np.sin(a), 0)
        for a in np.linspace(0, 2 * np.pi, 33)
    ]
    far = [
        seen(0.1 + 0.17 * np.cos(a), -0.76 + 0.17 * np.sin(a), 3.4)
        for a in np.linspace(0, 2 * np.pi, 33)
    ]
    both = np.array(duct + far)
    sheet.polygon([tuple(p) for p in both[ConvexHull(both).vertices]], look.layers[3])
    for depth in np.linspace(0, 3.4, 14) ** 1.0:
        arc = [
            seen(0.1 + 0.17 * np.cos(a), -0.76 + 0.17 * np.sin(a), depth)
            for a in np.linspace(0.2, np.pi - 0.2, 17)
        ]
        sheet.line(arc, width=1.6 / (1 + depth) + 0.4, opacity=0.8)
    sheet.polygon(duct, look.shade)
    sheet.line(duct, width=2.4)
    people = apart(rng)
    for u, depth in ((-0.56, 0.5), (-0.42, 0.72), (0.55, 1.5), (-0.5, 2.6)):
        px, py = seen(u, floor, depth)
        sheet.person(px, py, 150 / (1 + depth), people)


def cooling_towers(sheet: Sheet, rng: np.random.Generator) -> None:
    """A power station over a village: towers and their steam, a seam burnt from below."""
    look = sheet.palette
    seam = HORIZON + 215 + waves(rng, np.linspace(0, WIDTH, 81), 26, 1300)
    along = np.linspace(0, WIDTH, 81)
    sheet.polygon(
        [*zip(along, seam, strict=True), *zip(along[::-1], seam[::-1] + 46, strict=True)],
        look.shade,
    )
    sheet.line(zip(along, seam, strict=True), width=1.4, opacity=0.6)
    towers = ((300.0, 150.0, 372.0), (640.0, 158.0, 396.0), (1010.0, 150.0, 366.0))
    for x, wide, tall in towers:
        t = np.linspace(0, 1, 25)
        half = wide * np.sqrt(0.33 + 0.67 * ((t - 0.76) / 0.76) ** 2)
        y = HORIZON - 22 - tall * t
        outline = [*zip(x - half, y, strict=True), *zip((x + half)[::-1], y[::-1], strict=True)]
        steam = apart(rng)
        cx, cy, size = x, HORIZON - 22 - tall, half[-1]
        for _ in range(13):  # before the tower, so that it rises from within
            sheet.ellipse(cx, cy, 1.25 * size, 0.72 * size, look.line, 0.06)
            cx, cy = cx + steam.uniform(10, 44), cy - steam.uniform(16, 34)
            size += steam.uniform(2, 13)
        sheet.polygon(outline, look.shade)
        sheet.line(outline, width=2.8)
        sheet.line([outline[0], outline[-1]], width=1.4)
        for level in (2, 6, 10, 14, 18, 22):
            bend = np.linspace(-1, 1, 17)
            sag = y[level] + 9 * np.sqrt(1 - bend**2)
            sheet.line(zip(x + half[level] * bend, sag, strict=True), width=1.1, opacity=0.35)
        for lean in (-0.72, -0.38, 0.0, 0.38, 0.72):
            sheet.line(zip(x + half * lean, y, strict=True), width=1.0, opacity=0.22)
        feet = np.linspace(x - half[0], x + half[0], 15)
        for a, b in pairwise(feet):
            sheet.line([(a, HORIZON - 22), ((a + b) / 2, HORIZON), (b, HORIZON - 22)], width=1.6)
    boiler, stack = 1230.0, 1475.0
    sheet.rect(boiler, HORIZON - 190, 170, 190, look.shade)
    sheet.rect(boiler + 34, HORIZON - 250, 96, 60, look.shade)
    sheet.line([(boiler, HORIZON), (boiler, HORIZON - 190), (boiler + 34, HORIZON - 190),
                (boiler + 34, HORIZON - 250), (boiler + 130, HORIZON - 250),
                (boiler + 130, HORIZON - 190), (boiler + 170, HORIZON - 190),
                (boiler + 170, HORIZON)], width=2.6)  # fmt: skip
    lit = apart(rng)
    for row in range(6):
        for column in range(6):
            sheet.rect(boiler + 16 + 25 * column, HORIZON - 172 + 26 * row, 12, 12,
                       look.thread if lit.random() < 0.35 else look.line,
                       0.8 if lit.random() < 0.4 else 0.15)  # fmt: skip
    chimney = [
        (stack, HORIZON),
        (stack + 9, HORIZON - 440),
        (stack + 31, HORIZON - 440),
        (stack + 40, HORIZON),
    ]
    sheet.polygon(chimney, look.shade)
    sheet.line(chimney, width=2.4)
    for y in (424, 396, 368):
        sheet.line([(stack + 10, HORIZON - y), (stack + 30, HORIZON - y)], width=8)
    smoke = apart(rng)
    cx, cy, size = stack + 20.0, HORIZON - 450.0, 15.0
    for _ in range(10):
        sheet.ellipse(cx, cy, 1.6 * size, 0.8 * size, look.line, 0.1)
        cx, cy, size = cx + smoke.uniform(14, 30), cy - smoke.uniform(1, 10), size + 3
    sheet.line([(boiler + 170, HORIZON - 70), (stack + 4, HORIZON - 70)], width=7)
    mouth = boiler + 85.0  # of the shaft: coal comes up it into the boiler
    sheet.thread([(mouth, HORIZON - 66), (mouth, float(np.interp(mouth, along, seam)) + 23)], 4.2)
    way = [(px, float(np.interp(px, along, seam)) + 23) for px in np.linspace(130, mouth, 40)]
    sheet.thread(way, 3.2)
    for px in np.linspace(180, mouth - 90, 12):
        y = float(np.interp(px, along, seam))
        sheet.line([(px, y), (px, y + 46)], width=2.0, opacity=0.55)
    for number, px in enumerate((40.0, 108.0, 420.0, 492.0, 800.0, 862.0, 1150.0)):
        cottage(sheet, px, 44 + 6.0 * (number % 3), rng)


def cottage(sheet: Sheet, x: float, wide: float, rng: np.random.Generator) -> None:
    """A house so far away that it has two windows."""
    look, tall = sheet.palette, 0.55 * wide
    box: list[Point] = [
        (x, HORIZON),
        (x, HORIZON - tall),
        (x + wide, HORIZON - tall),
        (x + wide, HORIZON),
    ]
    roof = [
        (x - 4, HORIZON - tall),
        (x + wide / 2, HORIZON - 1.75 * tall),
        (x + wide + 4, HORIZON - tall),
    ]
    for shape in (box, roof):
        sheet.polygon(shape, look.body)
        sheet.line([*shape, shape[0]], width=1.8)
    for share in (0.2, 0.6):
        sheet.rect(x + share * wide, HORIZON - 0.75 * tall, 0.2 * wide, 0.35 * tall,
                   look.thread if rng.random() < 0.4 else look.line, 0.6)  # fmt: skip


MOTIFS: dict[str, Motif] = {
    'open-cast mine': open_cast,
    'turbine hall': turbine_hall,
    'interchange': interchange,
    'tunnel': tunnel,
    'oil platform': platform,
    'cooling towers': cooling_towers,
}
WITHOUT_SKY = ('open-cast mine', 'turbine hall', 'interchange', 'tunnel')
