# SPDX-License-Identifier: Apache-2.0
"""Right halves that are seen otherwise than as a section: a town from above, a room, a slope, a
flood, a harbour, a tower that fills the sheet.

For their degrees holds what holds in `damage`; without damage they are whole (see `before`).
"""

from typing import Any

import numpy as np
from drawings.damage import Motif, fault, house, pylon, some, stone, turned
from drawings.sheet import FAULT_X, HEIGHT, HORIZON, WIDTH, Point, Sheet, apart, jagged


def _part(damage: float, begin: float, end: float) -> float:
    """How much of a thing that happens between two degrees of damage has happened, 0 to 1."""
    return float(np.clip((damage - begin) / (end - begin), 0.0, 1.0))


def offset_streets(sheet: Sheet, rng: np.random.Generator) -> None:
    """A town from above: the fault crosses it, and beyond it all streets have moved along."""
    look, d = sheet.palette, sheet.damage
    sheet.stands, sheet.falls_to = None, None
    sheet.rect(0, 0, WIDTH, HEIGHT, look.layers[3])
    foot, head = np.array([560.0, 900.0]), np.array([1010.0, 0.0])
    along = (head - foot) / np.hypot(*(head - foot))
    slip = -84 * d**1.4 * along  # half a street: what was a crossing is a wall now
    turn = np.array([[np.cos(0.14), np.sin(0.14)], [-np.sin(0.14), np.cos(0.14)]])

    def beyond(p: np.ndarray) -> float:
        return float(along[0] * (p[1] - foot[1]) - along[1] * (p[0] - foot[0]))

    def placed(points: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return where points (n, 2) of the town's grid lie, and whether they are in view."""
        at = points @ turn + (800.0, 450.0)
        at = at + slip * (beyond(at.mean(axis=0)) > 0)
        low, high = at.min(axis=0), at.max(axis=0)
        return at, bool((low > -55).all() and high[0] < WIDTH + 55 and high[1] < HEIGHT + 55)

    step, wide = np.array([156.0, 128.0]), 34.0
    for column in range(-8, 9):
        for row in range(-7, 8):
            corner = np.array([column, row]) * step
            park = rng.random() < 0.07
            for number in range(6):
                place = corner + (number % 3 * 41.0, number // 3 * 47.0)
                size = rng.uniform(0.72, 1.0, 2) * (38.0, 43.0)
                tone, rubble = rng.random(), apart(rng)
                box = place + np.array([[0, 0], [size[0], 0], size, [0, size[1]]])
                at, seen = placed(box)
                if not seen:
                    continue
                near = abs(beyond(at.mean(axis=0) - slip * (beyond(at.mean(axis=0)) > 0)))
                if park:
                    sheet.ring(*at.mean(axis=0), 6 + 9 * tone, 1.3, 0.45)
                elif near < 26 + 34 * d and tone < 1.5 * d:
                    for _ in range(3):
                        stone(sheet, rubble, *(at.mean(axis=0) + rubble.normal(0, 12, 2)), 8.0)
                else:
                    roof = [tuple(p) for p in at]
                    sheet.polygon(roof, (look.shade, look.hills[1], look.body)[int(3 * tone)])
                    sheet.line([*roof, roof[0]], width=1.5, opacity=0.8)
                    if tone > 0.6:
                        ridge = (at[0] + at[3]) / 2, (at[1] + at[2]) / 2
                        sheet.line(ridge, width=1.1, opacity=0.5)
                    elif tone < 0.08:
                        sheet.polygon(0.5 * at + 0.5 * at.mean(axis=0), look.thread, 0.7)

    def street(begin: np.ndarray, end: np.ndarray, **style: Any) -> None:
        """Draw a straight line of the grid, in one piece on either side of the fault."""
        joints = begin + np.linspace(0, 1, 129)[:, None] * (end - begin)
        pieces: dict[bool, list[np.ndarray]] = {False: [], True: []}
        for joint in joints:
            at, seen = placed(joint[None])
            if seen:
                pieces[sheet.broken and beyond(joint @ turn + (800.0, 450.0)) > 0].append(at[0])
        for piece in pieces.values():
            if len(piece) > 1:
                sheet.line([tuple(piece[0]), tuple(piece[-1])], **style)

    whole = np.array([9.0, 8.0]) * step
    for number in range(-8, 9):
        for axis in (0, 1):
            ends = np.array([-whole, whole])
            ends[:, axis] = number * step[axis] - (wide / 2, wide / 2 - 8)[axis]
            street(*ends, width=1.4, opacity=0.55, dash='16 15')
    # what tells most of it: a railway on its bed, and an avenue
    for row, bed in ((2, True), (-1, False)):
        y = row * step[1] - wide / 2 + 8
        for off in (-7.0, 7.0):
            street(np.array([-whole[0], y + off]), np.array([whole[0], y + off]), width=3.2)
        if bed:
            street(np.array([-whole[0], y]), np.array([whole[0], y]), width=24, opacity=0.2)
    if sheet.broken:
        share = min(0.35 + 0.9 * d, 1.0)
        ends = (float(foot[0]), 900.0), (float(head[0]), 0.0)
        sheet.crack(apart(rng), *ends, 20, 2.4 + 3.6 * d, share)


def cracked_room(sheet: Sheet, rng: np.random.Generator) -> None:
    """Indoors: the floor opens, the crack climbs the far wall, what hung and stood has fallen."""
    look, d = sheet.palette, sheet.damage
    sheet.stands, sheet.falls_to = None, None
    x0, x1, y0, y1, vanish = 400.0, 1200.0, 150.0, 610.0, (800.0, 320.0)
    sheet.polygon([(0, 0), (WIDTH, 0), (x1, y0), (x0, y0)], look.layers[0])
    sheet.polygon([(0, 0), (x0, y0), (x0, y1), (0, HEIGHT)], look.layers[1])
    sheet.polygon([(WIDTH, 0), (x1, y0), (x1, y1), (WIDTH, HEIGHT)], look.layers[1])
    sheet.polygon([(0, HEIGHT), (x0, y1), (x1, y1), (WIDTH, HEIGHT)], look.layers[5])
    sheet.rect(x0, y0, x1 - x0, y1 - y0, look.hills[1])
    k = (y1 - vanish[1]) / (HEIGHT - vanish[1])
    for x in np.linspace(0, WIDTH, 19)[1:-1]:  # boards of the floor
        sheet.line([(vanish[0] + k * (x - vanish[0]), y1), (x, HEIGHT)], width=1.2, opacity=0.3)
    for a, b in (((0, 0), (x0, y0)), ((WIDTH, 0), (x1, y0)), ((0, HEIGHT), (x0, y1)),
                 ((WIDTH, HEIGHT), (x1, y1))):  # fmt: skip
        sheet.line([a, b], width=2.4)
    sheet.line([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], width=2.4)
    # a window, and what stands outside
    left, right, top, low = 470.0, 690.0, 225.0, 430.0
    sheet.rect(left, top, right - left, low - top, look.sky[1])
    ridge = [(left, 395.0), (530.0, 370.0), (600.0, 392.0), (650.0, 360.0), (right, 385.0)]
    sheet.polygon([*ridge, (right, low), (left, low)], look.hills[0])
    pylon(sheet, 640.0, 385.0, 92.0, 0.9 * _part(d, 0.5, 1.0))
    sheet.line([(left, top), (right, top), (right, low), (left, low), (left, top)], width=3.2)
    for bar in (((left + right) / 2, top, (left + right) / 2, low), (left, 318.0, right, 318.0)):
        sheet.line([bar[:2], bar[2:]], width=2.2)
    panes = apart(rng)
    for _ in range(some(sheet, 9)):
        begin = (panes.uniform(left, right), panes.uniform(top, low))
        sheet.line(jagged(panes, begin, (right, panes.uniform(top, low)), 8), width=1.1)
    # a picture on its nail, shelves with books
    swing = 0.75 * d**1.5
    frame: list[Point] = [(930, 250), (1090, 250), (1090, 360), (930, 360)]
    hung = turned(frame, (940.0, 244.0), swing)
    sheet.polygon(hung, look.shade)
    sheet.line([*hung, hung[0]], width=3)
    view = turned(
        [(945, 335), (985, 292), (1010, 318), (1040, 280), (1075, 340)], (940, 244), swing
    )
    sheet.line(view, width=1.6, opacity=0.8)
    books = apart(rng)
    for level, y in enumerate((440.0, 505.0)):
        tilt = 0.16 * d * (1 - 2 * level)
        board = turned([(900, y), (1150, y)], (900.0 if level else 1150.0, y), tilt)
        sheet.line(board, width=3.4)
        for k in range(11):
            tall, thick, gone = books.uniform(30, 48), books.uniform(9, 15), books.random()
            x = 908.0 + 21 * k
            if gone < 1.1 * d - 0.25:  # it lies on the floor
                fx, fy = books.uniform(820, 1230), books.uniform(628, 690)
                spine = turned([(fx, fy), (fx + tall, fy)], (fx, fy), books.uniform(-0.3, 0.3))
                sheet.line(spine, width=thick * 0.6, opacity=0.75)
                continue
            books.uniform(size=3)
            box = turned([(x, y - 2), (x, y - tall), (x + thick, y - tall), (x + thick, y - 2)],
                         (900.0 if level else 1150.0, y), tilt)  # fmt: skip
            sheet.polygon(box, look.body)
            sheet.line([*box, box[0]], width=1.3, opacity=0.8)
    # the floor opens
    crack, gap = apart(rng), 74 * d**1.2
    seam = jagged(apart(rng), (850.0, float(HEIGHT)), (806.0, y1), 22)
    wide = [gap * (y - y1) / (HEIGHT - y1) for _, y in seam]
    edge = [(x + w, y) for (x, y), w in zip(seam, wide, strict=True)]
    hole = [*((x - w, y) for (x, y), w in zip(seam, wide, strict=True)), *edge[::-1]]
    if sheet.broken:
        sheet.polygon(hole, look.shade)
        sheet.line([*hole, hole[0]], width=2.2)
        share = min(0.2 + 0.9 * d, 1.0)
        floor = sheet.crack(crack, (850.0, 896.0), (806.0, y1), 12, 3 + 4 * d, min(3 * share, 1.0))
        wall = sheet.crack(crack, floor[-1], (745.0, y0), 20, 2 + 3 * d, share)
        if share == 1.0:
            sheet.crack(crack, wall[-1], (640.0, 4.0), 14, 2 + 3 * d)
    # table, chair, lamp
    drop = 26 * d
    top_board: list[Point] = [(500, 640), (760, 640 + drop), (790, 700 + drop), (470, 700)]
    for x, y in ((482.0, 700.0), (778.0, 700 + drop), (512.0, 640.0), (750.0, 640 + drop)):
        sheet.line([(x, y), (x, y + 118)], width=4)
    sheet.polygon(top_board, look.body)
    sheet.line([*top_board, top_board[0]], width=2.6)
    fall = 1.5 * _part(d, 0.3, 0.75)
    for part in ([(1000, 850), (1000, 640)], [(1090, 850), (1090, 750), (1000, 750)],
                 [(1000, 640), (1000, 690)], [(1018, 838), (1018, 752)]):  # fmt: skip
        sheet.line(turned([(float(x), float(y)) for x, y in part], (1090.0, 850.0), fall), width=5)
    swing = 0.45 * d
    cord = turned([(800, 60), (800, 205)], (800.0, 60.0), swing)
    sheet.line(cord, width=1.8)
    bx, by = cord[1]
    shade = turned([(bx - 42, by + 34), (bx - 14, by), (bx + 14, by), (bx + 42, by + 34)],
                   (bx, by), swing)  # fmt: skip
    if d < 0.6:  # then the light goes out
        sheet.disc(bx, by + 30, 84, look.thread, 0.1)
        sheet.disc(bx, by + 36, 11, look.thread, 0.9)
    sheet.polygon(shade, look.shade)
    sheet.line([*shade, shade[0]], width=2.4)
    plaster = apart(rng)
    for _ in range(some(sheet, 26)):
        place = plaster.uniform(640, 980), plaster.uniform(640, 860)
        stone(sheet, plaster, *place, plaster.uniform(5, 17))


def breached_dyke(sheet: Sheet, rng: np.random.Generator) -> None:
    """A river behind a dyke that the fault has opened: the low land fills."""
    look, d = sheet.palette, sheet.damage
    level_l = HORIZON - 92 + 34 * d
    level_r = HORIZON + sheet.throw + 6 - 118 * _part(d, 0.2, 1.0)
    for k, (x, wide, floors) in enumerate(((1010, 150, 2), (1195, 120, 1), (1345, 170, 3))):
        lean = 0.03 * d * (k - 1)
        house(sheet, x, HORIZON + sheet.throw, wide, floors, lean, rng, k != 2)
    for k in range(5):
        x = 975.0 + 138 * k
        sheet.line([(x, HORIZON + sheet.throw), (x, HORIZON + sheet.throw - 84)], width=2.2)
        sheet.disc(x, HORIZON + sheet.throw - 88, 4.5, look.thread, 0.9 if d < 0.7 else 0.15)
    crest = 96 * _part(d, 0.1, 0.9)
    face = [(560, HORIZON), (715, HORIZON - 128), (FAULT_X - 10 - 0.4 * crest, HORIZON - 128)]
    notch = [(FAULT_X - 4, HORIZON - 128 + crest), (FAULT_X + 6, HORIZON - 128 + crest)]
    lee = [(FAULT_X + 14 + 0.5 * crest, HORIZON - 128 + sheet.throw),
           (885, HORIZON - 128 + sheet.throw), (1040, HORIZON + sheet.throw)]  # fmt: skip
    bank = [*face, *notch, *lee]
    sheet.polygon([(0, level_l), (648, level_l), (560, HORIZON), (0, HORIZON)], look.hills[0])
    ripples = apart(rng)
    for k in range(16):
        x, y = ripples.uniform(0, 560), level_l + 8 + 5.2 * k
        if y < HORIZON - 4:
            sheet.line([(x, y), (x + ripples.uniform(20, 80), y)], width=1.2, opacity=0.4)
    sheet.line([(0, level_l), (600 + 0.6 * (HORIZON - level_l), level_l)], width=2.2)
    barge = turned([(150, level_l - 26), (470, level_l - 26), (440, level_l + 20),
                    (180, level_l + 20)], (300.0, level_l), -0.02 - 0.07 * d)  # fmt: skip
    sheet.polygon(barge, look.shade)
    sheet.line([*barge, barge[0]], width=2.4)
    cabin = turned([(180, level_l - 26), (180, level_l - 74), (260, level_l - 74),
                    (260, level_l - 26)], (300.0, level_l), -0.02 - 0.07 * d)  # fmt: skip
    sheet.polygon(cabin, look.body)
    sheet.line([*cabin, cabin[0]], width=2.0)
    sheet.polygon(bank, look.body)
    sheet.line(bank, width=2.6)
    grass = apart(rng)
    for _ in range(60):
        x, tall = grass.uniform(580, 1020), grass.uniform(5, 13)
        y = float(np.interp(x, [p[0] for p in bank], [p[1] for p in bank]))
        sheet.line([(x, y), (x + 0.3 * tall, y - tall)], width=1.2, opacity=0.6)
    if d > 0.3:  # over the notch and down the other side
        spill = HORIZON - 128 + crest - 12
        stream = [(620, level_l), (FAULT_X, max(spill, level_l + 2)), (880, spill + 34),
                  (960, level_r), (1080, level_r)]  # fmt: skip
        for k in range(6):
            sheet.line([(x, y + 5.0 * k) for x, y in stream], width=2.2, opacity=0.7 - 0.09 * k)
    flooded = level_r < HORIZON + sheet.throw
    crown = np.array(bank)

    def stands(x: float) -> float:
        if 580 < x < FAULT_X - 60 or FAULT_X + 80 < x < 940:
            return float(np.interp(x, crown[:, 0], crown[:, 1]))
        return np.nan if flooded or x < 1040 else HORIZON + sheet.throw

    sheet.stands = stands
    if flooded:
        flood = [(955, level_r), (WIDTH, level_r), (WIDTH, HORIZON + sheet.throw),
                 (1040, HORIZON + sheet.throw)]  # fmt: skip
        sheet.polygon(flood, look.hills[0], 0.86)
        sheet.line([(955, level_r), (WIDTH, level_r)], width=2.2)
        afloat = apart(rng)
        for _ in range(some(sheet, 14)):
            x, long = afloat.uniform(990, 1560), afloat.uniform(16, 44)
            plank = turned([(x, level_r), (x + long, level_r)], (x, level_r),
                           afloat.uniform(-0.14, 0.14))  # fmt: skip
            sheet.line(plank, width=4.4)
    fault(sheet, apart(rng), HORIZON - 40 * d)


def landslide(sheet: Sheet, rng: np.random.Generator) -> None:
    """A slope over a valley: a piece of it slides down, with the houses and trees on it."""
    look, d = sheet.palette, sheet.damage
    x = np.linspace(0, WIDTH, 161)
    bumps = apart(rng)
    y = 170 + 0.31 * x + 30 * np.sin(x / 170 + bumps.uniform(0, 6)) * (x / WIDTH)
    y = np.where(x > 1180, np.interp(1180, x, y) + 0.10 * (x - 1180), y)

    def slope(at: float) -> float:
        return float(np.interp(at, x, y))

    sheet.stands = lambda at: np.nan if sheet.broken and 430 < at < 1300 else slope(at)
    sheet.polygon([*zip(x, y, strict=True), (WIDTH, HEIGHT), (0, HEIGHT)], look.layers[3])
    for k in range(1, 7):
        seam = np.minimum(y + 62 * k + 10 * np.sin(x / 120 + k), HEIGHT)
        sheet.line(zip(x, seam, strict=True), width=1.2, opacity=0.24)
        sheet.polygon(
            [*zip(x, seam, strict=True), (WIDTH, HEIGHT), (0, HEIGHT)],
            look.layers[(3 + k) % len(look.layers)], 0.55,
        )  # fmt: skip
    sheet.line(zip(x, y, strict=True), width=2.5, opacity=0.9)
    # the piece that moves, between head and toe, down to a bowl
    head, toe, deep = 470.0, 1010.0, 118.0
    inner = x[(x >= head) & (x <= toe)]
    bowl = np.interp(inner, x, y) + deep * np.sin(np.pi * (inner - head) / (toe - head)) ** 0.7
    scar = [*zip(inner, np.interp(inner, x, y), strict=True),
            *zip(inner[::-1], bowl[::-1], strict=True)]  # fmt: skip
    moved = 300 * d**1.6
    if sheet.broken:
        sheet.polygon(scar, look.shade)
        sheet.line(zip(inner, bowl, strict=True), width=2.2)
    scratches = apart(rng)
    for _ in range(some(sheet, 26)):
        at = scratches.uniform(head + 20, toe - 120)
        from_y = slope(at) + scratches.uniform(0.2, 0.8) * deep * 0.8
        sheet.line([(at, from_y), (at + 46, from_y + 17)], width=1.2, opacity=0.5)

    def slid(at: float) -> tuple[Point, float]:
        """Return where a point of the moving surface is now, and by what angle it has turned."""
        now = at + moved
        swell = 70 * d * np.sin(np.pi * (at - head) / (toe - head))
        return (now, slope(now) - swell), 0.16 * d * np.cos(7 * at)

    lumps = apart(rng)
    top = [slid(at)[0] for at in inner]
    top = [(px, py + d * lumps.normal(0, 7)) for px, py in top]
    foot = [(px, max(slope(px) + 2 + 0.55 * (by - slope(at)) * (1 - d), slope(px) + 3))
            for (px, _), at, by in zip(top, inner, bowl, strict=True)]  # fmt: skip
    mass = [*top, *foot[::-1]]
    if sheet.broken:
        sheet.polygon(mass, look.body)
        sheet.line([*mass, mass[0]], width=2.2)
    for at, wide, floors in ((560.0, 92, 1), (700.0, 110, 2), (850.0, 96, 1)):
        (px, py), angle = slid(at)
        house(sheet, px, py + 16, wide, floors, angle + 0.2 * d, rng, True)
    for at, wide, floors in ((150.0, 110, 2), (300.0, 90, 1)):
        house(sheet, at, slope(at + 60) + 4, wide, floors, 0.0, rng, True)
    buried = 0.5 * _part(d, 0.6, 1.0)
    house(sheet, 1350.0, slope(1400) + 6, 130, 3, buried * 0.5, rng, False)
    trees = apart(rng)
    for _ in range(46):
        at, tall, lean = trees.uniform(20, 1580), trees.uniform(34, 62), trees.normal(0, 0.3)
        (px, py), angle = slid(at) if head < at < toe else ((at, slope(at)), 0.0)
        if not -30 < px < WIDTH + 30 or (toe < at < toe + moved):
            continue
        angle += lean * d * (head < at < toe) * 2.4
        shape = turned([(px, py + 4), (px, py - 0.3 * tall), (px - 0.22 * tall, py - 0.3 * tall),
                        (px, py - tall), (px + 0.22 * tall, py - 0.3 * tall),
                        (px, py - 0.3 * tall)], (px, py), angle)  # fmt: skip
        sheet.polygon(shape[2:5], look.shade)
        sheet.line(shape, width=1.5, opacity=0.9)
    rocks = apart(rng)
    for _ in range(some(sheet, 30)):
        at = rocks.uniform(toe, toe + moved + 90)
        stone(sheet, rocks, min(at, WIDTH - 30.0), slope(min(at, 1570)) - 6, rocks.uniform(7, 26))
    share = min(0.35 + 0.9 * d, 1.0)
    start = (780.0, 896.0)
    if sheet.broken:
        end = (head + 6, slope(head) + 10)
        sheet.crack(apart(rng), start, end, 15, 1.8 + 2.6 * d, share)


def stranded_ship(sheet: Sheet, rng: np.random.Generator) -> None:
    """A harbour: the sea has gone, come back, and left a ship among the houses."""
    look, d = sheet.palette, sheet.damage
    quay = FAULT_X + 60
    sheet.stands = lambda x: HORIZON if x < quay - 20 else np.nan
    # the sea of each degree: it draws back, comes over the quay, and goes
    level = (
        float(np.interp(d, [0, 0.25, 0.5, 0.75, 1.0], [20.0, 66.0, -58.0, -20.0, 40.0])) + HORIZON
    )
    far = level < HORIZON
    shore = 180.0 if far else quay
    bed = [
        (quay, HORIZON),
        (quay + 8, HORIZON + 128),
        (1250, HORIZON + 170),
        (WIDTH, HORIZON + 210),
    ]
    sheet.polygon([*bed, (WIDTH, HORIZON - 2), (quay, HORIZON - 2)], look.sky[1])
    for k in range(9):
        x = 70.0 + 88 * k
        sheet.line([(x, HORIZON), (x, HORIZON + 4)], width=3, opacity=0.5)
    crushed = d >= 0.75
    for k, (x, wide, floors) in enumerate(((40, 120, 2), (185, 150, 3), (360, 110, 2),
                                           (495, 130, 2), (650, 110, 1))):  # fmt: skip
        flat = crushed and 340 < x < 640
        house(sheet, x, HORIZON, wide, 1 if flat else floors, 0.22 * d * flat, rng, k % 2 == 0)
    water = [(shore, level), (WIDTH, level), (WIDTH, HORIZON + 210), (1250, HORIZON + 170),
             (quay + 8, HORIZON + 128), (quay, HORIZON)]  # fmt: skip
    if far:
        water = [*water, (shore - 60, HORIZON)]
    sheet.polygon(water, look.hills[0], 0.88)
    sea = apart(rng)
    for k in range(34):
        x, y = sea.uniform(shore + 20, WIDTH - 90), level + 7 + 4.6 * k
        if y < HORIZON + 120 and (x > quay + 16 or y < HORIZON - 4):
            sheet.line([(x, y), (x + sea.uniform(18, 76), y)], width=1.2, opacity=0.42)
    swell = np.linspace(shore, WIDTH, 60)
    crest = level + 7 * np.sin(swell / 46 + 3 * d)
    sheet.line(zip(swell, crest, strict=True), width=2.4)
    sheet.line(bed, width=2.4)
    sheet.line([(quay, HORIZON), (0, HORIZON)], width=3)
    cranes = apart(rng)
    for x in (745.0, 1500.0):
        tall, lean = cranes.uniform(190, 240), 0.5 * d**2 * (1 if x < 800 else 0.2)
        y = HORIZON if x < 800 else HORIZON + 196.0
        pylon(sheet, x, y, tall + (196.0 if x > 800 else 0), lean)
    place = np.interp(d, [0, 0.25, 0.5, 0.75, 1.0], [930.0, 1000.0, 730.0, 470.0, 430.0])
    lies = np.interp(d, [0, 0.25, 0.5, 0.75, 1.0],
                     [level + 34, level + 34, level + 30, HORIZON - 16, HORIZON - 40])  # fmt: skip
    lean = np.interp(d, [0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.03, -0.07, -0.12, -0.2])
    _ship(sheet, float(place), float(lies), float(lean))
    wreck = apart(rng)
    for _ in range(some(sheet, 34)):
        x, long = wreck.uniform(120, 840), wreck.uniform(18, 60)
        at = (x, HORIZON - wreck.uniform(0, 22))
        sheet.line(turned([at, (x + long, at[1])], at, wreck.uniform(-0.6, 0.4)), width=3.6)
    fault(sheet, apart(rng), HORIZON + 150)


def _ship(sheet: Sheet, x: float, y: float, lean: float) -> None:
    """A freighter with its keel at (x, y) under the stern, bow to the right."""
    look, keel = sheet.palette, (x + 200, y)

    def t(points: list[Point]) -> list[Point]:
        return turned([(x + px, y + py) for px, py in points], keel, lean)

    def shape(points: list[Point], fill: str, width: float = 2.4) -> None:
        found = t(points)
        sheet.polygon(found, fill)
        sheet.line([*found, found[0]], width=width)

    shape([(14, 0), (404, 0), (470, -92), (340, -74), (0, -74)], look.shade, 3.0)
    shape([(20, -74), (20, -168), (128, -168), (128, -74)], look.body)
    shape([(30, -168), (30, -196), (112, -196), (112, -168)], look.body)
    shape([(52, -196), (56, -238), (84, -238), (88, -196)], look.shade)
    for k in range(6):
        shape([(142 + 33 * k, -74), (142 + 33 * k, -106), (171 + 33 * k, -106),
               (171 + 33 * k, -74)], look.hills[1], 1.6)  # fmt: skip
    for row in (-150, -118):
        for k in range(5):
            px, py = t([(34 + 21 * k, row)])[0]
            sheet.disc(px, py, 4.6, look.thread, 0.6 if k == 2 else 0.15)
    sheet.line(t([(352, -76), (352, -214)]), width=3)
    sheet.line(t([(352, -206), (250, -120)]), width=1.4, opacity=0.8)
    sheet.line(t([(352, -206), (462, -92)]), width=1.4, opacity=0.8)
    sheet.line(t([(6, -30), (428, -30)]), width=1.6, opacity=0.7)


def split_tower(sheet: Sheet, rng: np.random.Generator) -> None:
    """A tower that fills the sheet: its halves lean apart over the fault, floors hang between."""
    look, d = sheet.palette, sheet.damage
    floors, tall, wide = 13, 36.0, 232.0
    top = HORIZON - floors * tall
    for k in range(7):  # its piles
        x = FAULT_X - 200 + 66.0 * k
        drop = sheet.throw if x > FAULT_X else 0.0
        sheet.line([(x, HORIZON + drop), (x, HORIZON + 210 + drop)], width=7, opacity=0.5)
    way = jagged(apart(rng), (FAULT_X, HORIZON), (FAULT_X + rng.uniform(-40, 40), top), 40)
    if not sheet.broken:
        way = [(FAULT_X, HORIZON), (FAULT_X, top)]
    ys, xs = np.array([p[1] for p in way])[::-1], np.array([p[0] for p in way])[::-1]
    lit, hanging = apart(rng), apart(rng)
    open_up = 0.5 + 0.5 * d

    def cut(y: float) -> float:
        return float(np.interp(y, ys, xs))

    for level in range(1, floors):  # floors and rods that still hang across
        y = HORIZON - level * tall
        sag = hanging.uniform(10, 40) * d
        if hanging.random() < 1.15 - 0.6 * d and sheet.broken:
            middle = (cut(y) + 34 * d * level / floors, y + sag)
            ends = (cut(y) - 24 - 20 * d, y), (cut(y) + 40 + 90 * d * level / floors, y + 12 * d)
            sheet.line([ends[0], middle, ends[1]], width=3, opacity=0.7)
    for side, most in ((-1, -0.035), (1, 0.15)):
        drop = sheet.throw if side > 0 else 0.0
        pivot = (FAULT_X + side * (wide if side > 0 else 0.4 * wide), HORIZON + drop)
        angle = most * d**1.3
        far = FAULT_X + side * wide
        inner = [(px, py + drop) for px, py in way]
        wall = [(far, HORIZON + drop), *inner, (far, top + drop)]
        wall = turned(wall, pivot, angle)
        sheet.polygon(wall, look.body if side < 0 or not sheet.broken else look.shade)
        sheet.line([*wall, wall[0]] if sheet.broken else [wall[0], wall[-1], wall[-2]], width=3)
        for level in range(floors):
            y = HORIZON + drop - level * tall
            near = cut(y - drop)
            sheet.line(turned([(far, y), (near, y)], pivot, angle), width=1.4, opacity=0.55)
            for k in range(6):
                x = far - side * (14.0 + 37 * k)
                bright = lit.random() < 0.14 * (1.3 - d)
                if (x - side * 26 - cut(y - drop - tall / 2)) * side < 6:
                    continue
                pane = turned([(x, y - 8), (x - side * 24, y - 8), (x - side * 24, y - 28),
                               (x, y - 28)], pivot, angle)  # fmt: skip
                sheet.polygon(pane, look.thread if bright else look.line, 0.75 if bright else 0.13)
                sheet.line([*pane, pane[0]], width=1.2, opacity=0.7)
    light = [(cut(y) + 0.075 * d**1.3 * (HORIZON - y), y + 0.5 * sheet.throw)
             for y in np.linspace(HORIZON, HORIZON - open_up * floors * tall, 24)]  # fmt: skip
    if sheet.broken:
        sheet.thread(light, 2.0 + 2 * d)
    for x, wide_h, rows, gable in ((60, 120, 1, True), (230, 150, 2, True), (430, 96, 1, False),
                                   (1130, 120, 1, True), (1310, 170, 2, False)):  # fmt: skip
        y = HORIZON + (sheet.throw if x > FAULT_X else 0.0)
        house(sheet, x, y, wide_h, rows, 0.0, rng, gable)
    rubble = apart(rng)
    for _ in range(some(sheet, 30)):
        x = rubble.normal(FAULT_X + 30, 110)
        stone(sheet, rubble, x, sheet.ground(x) - 5, rubble.uniform(7, 24))
    fault(sheet, apart(rng), HORIZON + 2)


MOTIFS: dict[str, Motif] = {
    'offset streets': offset_streets,
    'cracked room': cracked_room,
    'breached dyke': breached_dyke,
    'landslide': landslide,
    'stranded ship': stranded_ship,
    'split tower': split_tower,
}
WITHOUT_SKY = ('offset streets', 'cracked room')  # the moon hangs in the other half
