# SPDX-License-Identifier: Apache-2.0
"""Left halves: the machines, and the thread that each lets down into the ground."""

from collections.abc import Callable

import numpy as np
from drawings.sheet import HEIGHT, HORIZON, WIDTH, Sheet, jagged


def dam(sheet: Sheet, rng: np.random.Generator) -> None:
    """A gravity dam in section, its lake to the left, the weight of the water pressing down."""
    look = sheet.palette
    x = rng.uniform(830, 960)
    crest = HORIZON - rng.uniform(235, 275)
    bed = HORIZON + 60
    level = crest + 34
    sheet.rect(0, level, x + 40, bed - level, look.hills[0], 0.96)
    for i in range(11):
        y = level + (bed - level) * (i / 11) ** 1.25
        sheet.line([(0, y), (x, y)], width=2.6 if i == 0 else 1.2, opacity=0.9 if i == 0 else 0.28)
    foot = x + 210
    sheet.stands = lambda at: (
        HORIZON - 6 if at > foot + 20 else crest if x < at < x + 46 else np.nan
    )
    sheet.polygon(
        [(x, crest), (x + 46, crest), (x + 58, crest + 46), (foot, bed), (x - 14, bed)], look.shade
    )
    sheet.line(
        [(x - 14, bed), (x, crest), (x + 46, crest), (x + 58, crest + 46), (foot, bed)], width=3
    )
    for i in range(1, 9):
        y = crest + (bed - crest) * i / 9
        right = x + 58 + max(y - crest - 46, 0) / (bed - crest - 46) * (foot - x - 58)
        sheet.line([(x, y), (right, y)], width=1.2, opacity=0.4)
    sheet.rect(foot - 4, HORIZON - 6, WIDTH - foot + 4, 14, look.hills[0])
    for i, px in enumerate(np.linspace(foot + 130, WIDTH - 90, 3)):
        top = HORIZON - 150 + 8 * i
        sheet.truss((px - 20, HORIZON), (px + 20, HORIZON), (px - 4, top), (px + 4, top), 5, 1.6)
        for arm in (14, 38):
            sheet.line([(px - 34, top + arm), (px + 34, top + arm)], width=2)
    sheet.line(
        [(x + 46, crest), (foot + 130, HORIZON - 136), (WIDTH, HORIZON - 118)],
        width=1.2,
        opacity=0.7,
    )
    for px in np.linspace(140, x - 90, 5):
        depth = bed + 70 + 150 * (px / x) ** 2 + rng.uniform(0, 40)
        sheet.thread([(px, level + 40), (px, depth)], 3.0)
        sheet.line([(px - 12, depth - 20), (px, depth), (px + 12, depth - 20)], look.thread, 3.0)


def well(sheet: Sheet, rng: np.random.Generator) -> None:
    """A row of deep wells, cased in steps, each to its own depth."""
    look = sheet.palette
    for px, height, depth in zip(
        np.array([420, 800, 1180]) + rng.uniform(-40, 40, 3),
        rng.permutation([330, 270, 210]),
        rng.permutation([330, 250, 190]),
        strict=True,
    ):
        wide = height * 0.16
        top = HORIZON - height
        sheet.polygon(
            [(px - wide, HORIZON), (px + wide, HORIZON), (px + 10, top), (px - 10, top)],
            look.shade,
            0.55,
        )
        sheet.truss(
            (px - wide, HORIZON), (px + wide, HORIZON), (px - 10, top), (px + 10, top), 8, 2.2
        )
        sheet.rect(px - 16, top - 16, 32, 16, look.line)
        sheet.rect(px - wide - 26, HORIZON - 18, 2 * wide + 52, 18, look.shade)
        sheet.line([(px - wide - 26, HORIZON - 18), (px + wide + 26, HORIZON - 18)], width=2)
        for step, share in ((15, 0.3), (10, 0.62)):
            for side in (-1, 1):
                sheet.line(
                    [(px + side * step, HORIZON), (px + side * step, HORIZON + depth * share)],
                    width=2.2,
                    opacity=0.75,
                )
        sheet.thread([(px, HORIZON), (px, HORIZON + depth)], 3.6)
        for spread in range(1, 4):
            r = 17.0 * spread
            angle = np.linspace(0.15 * np.pi, 0.85 * np.pi, 13)
            arc = zip(
                px + r * np.cos(angle), HORIZON + depth + r * np.sin(angle) * 0.7, strict=True
            )
            sheet.line(arc, look.thread, 2.4, 0.85 / spread)


def fracking_rig(sheet: Sheet, rng: np.random.Generator) -> None:
    """A drilling rig whose bore turns along a layer and splits it with fans of cracks."""
    look = sheet.palette
    px = rng.uniform(380, 560)
    top = HORIZON - 340
    sheet.polygon(
        [(px - 56, HORIZON), (px + 56, HORIZON), (px + 14, top), (px - 14, top)], look.shade, 0.55
    )
    sheet.truss((px - 56, HORIZON), (px + 56, HORIZON), (px - 14, top), (px + 14, top), 9, 2.4)
    sheet.rect(px - 20, top - 18, 40, 18, look.line)
    sheet.rect(px - 96, HORIZON - 40, 192, 40, look.shade)
    sheet.line(
        [(px - 96, HORIZON), (px - 96, HORIZON - 40), (px + 96, HORIZON - 40), (px + 96, HORIZON)],
        width=2,
    )
    for i in range(7):
        x = px + 190 + i * 108
        tall = 84 if i % 3 else 112
        sheet.rect(x, HORIZON - tall, 66, tall, look.shade)
        sheet.line(
            [(x, HORIZON), (x, HORIZON - tall), (x + 66, HORIZON - tall), (x + 66, HORIZON)],
            width=2,
        )
        sheet.line(
            [(x + 10, HORIZON - tall + 18), (x + 56, HORIZON - tall + 18)], width=1.4, opacity=0.6
        )
        sheet.line([(x + 66, HORIZON - 18), (x + 108, HORIZON - 18)], width=3, opacity=0.8)
    turn, deep = 90.0, HORIZON + 232
    angle = np.linspace(0, np.pi / 2, 14)
    bend = zip(px + turn * (1 - np.cos(angle)), deep - turn + turn * np.sin(angle), strict=True)
    end = WIDTH - rng.uniform(120, 220)
    sheet.thread([(px, HORIZON), (px, deep - turn), *bend, (end, deep)], 4.2)
    for x in np.arange(px + turn + 90, end, 92):
        for side in (-1, 1):
            for lean in (-0.5, 0.0, 0.5):
                reach = rng.uniform(46, 92)
                fan = jagged(rng, (x, deep), (x + lean * reach, deep + side * reach), 9)
                sheet.line(fan, look.thread, 1.7, 0.85)


def oil_pump(sheet: Sheet, rng: np.random.Generator) -> None:
    """Nodding pumps in a row to the horizon, the nearest with its rod down to the pool."""
    look = sheet.palette
    pool_y, pool_x = HORIZON + 285, 800.0
    wave = np.linspace(0, 2 * np.pi, 60)
    outline = zip(
        pool_x + 520 * np.cos(wave), pool_y + 42 * np.sin(wave) + 9 * np.cos(3 * wave), strict=True
    )
    sheet.polygon(outline, look.thread, 0.2)
    for x, size in ((1330, 0.34), (1160, 0.46), (940, 0.66), (560, 1.18)):
        nod = rng.uniform(-0.2, 0.16)
        _pump(sheet, x, size, nod)
        rod = x - 150 * size
        sheet.thread([(rod, HORIZON), (rod, pool_y - 14 + 22 * (1 - size))], 1.2 + 2.6 * size)


def _pump(sheet: Sheet, x: float, size: float, nod: float) -> None:
    look = sheet.palette

    def at(dx: float, dy: float) -> tuple[float, float]:
        return x + dx * size, HORIZON - dy * size

    pivot = np.array([0.0, 196.0])
    along = np.array([np.cos(nod), np.sin(nod)])
    up = np.array([-along[1], along[0]])

    def beam(a: float, b: float) -> tuple[float, float]:
        return at(*(pivot + a * along + b * up))

    width = 1.2 + 2.4 * size
    sheet.polygon([at(-200, 0), at(210, 0), at(210, 20), at(-200, 20)], look.shade)
    sheet.line([at(-200, 0), at(-200, 20), at(210, 20), at(210, 0)], width=width * 0.8)
    sheet.polygon([at(-62, 20), at(0, 192), at(70, 20)], look.shade)
    sheet.line([at(-62, 20), at(0, 192), at(70, 20)], width=width)
    sheet.line([at(-32, 104), at(36, 104)], width=width * 0.8)
    sheet.polygon([beam(-128, -11), beam(150, -9), beam(150, 9), beam(-128, 11)], look.line)
    arc = np.linspace(-0.62, 0.5, 9)
    head = [beam(-172 + 46 * (1 - np.cos(a)), 92 * np.sin(a)) for a in arc]
    sheet.polygon([*head, beam(-122, 30), beam(-122, -34)], look.line)
    crank = at(128, 62)
    sheet.line([beam(140, 0), crank], width=width)
    sheet.disc(*crank, 33 * size, look.shade)
    sheet.ring(*crank, 33 * size, width)
    sheet.polygon([at(112, 40), at(150, 30), at(168, 74), at(128, 86)], look.line, 0.9)
    sheet.line([head[0], at(-150, 0)], width=width * 0.7)


def open_pit(sheet: Sheet, rng: np.random.Generator) -> None:
    """An open pit cut in benches through the layers, a shovel on its rim, blast holes below."""
    look = sheet.palette
    middle, benches = rng.uniform(760, 860), 6
    wide, tall, floor = 620.0, 44.0, 170.0
    shape: list[tuple[float, float]] = []
    run = (wide - floor) / benches
    for i in range(benches):
        shape += [
            (middle - wide + i * run, HORIZON + i * tall),
            (middle - wide + i * run, HORIZON + (i + 1) * tall),
        ]
    shape += [(2 * middle - x, y) for x, y in reversed(shape)]
    shape = [p for i, p in enumerate(shape) if i == 0 or p != shape[i - 1]]
    sheet.polygon(shape, look.sky[1])
    sheet.polygon(shape, look.shade, 0.45)
    sheet.line(shape, width=2.6)
    for i in range(1, benches):
        y = HORIZON + i * tall
        a, b = middle - wide + i * run, middle + wide - i * run
        sheet.line([(a, y), (b, y)], width=1.1, opacity=0.3)
    bottom = HORIZON + benches * tall

    def stands(x: float) -> float:
        bench = min(int((wide - abs(x - middle)) // run) + 1, benches)
        return HORIZON + tall * max(bench, 0)

    sheet.stands = stands
    for x in np.linspace(middle - floor + 30, middle + floor - 30, 7):
        sheet.thread([(x, bottom), (x, bottom + rng.uniform(48, 92))], 3.0)
    shovel(sheet, middle - wide - 60, HORIZON, 1.25)
    shovel(sheet, middle + 12, bottom, 0.55)
    heap = [
        (middle + wide + 20, HORIZON),
        (middle + wide + 130, HORIZON - 84),
        (middle + wide + 250, HORIZON),
    ]
    sheet.polygon(heap, look.shade)
    sheet.line(heap, width=2.2)


def shovel(sheet: Sheet, x: float, y: float, size: float) -> None:
    look = sheet.palette

    def at(dx: float, dy: float) -> tuple[float, float]:
        return x + dx * size, y - dy * size

    sheet.polygon(
        [at(-66, 0), at(40, 0), at(48, 12), at(40, 24), at(-66, 24), at(-74, 12)], look.line, 0.95
    )
    sheet.polygon(
        [at(-70, 28), at(30, 28), at(30, 92), at(-6, 92), at(-16, 76), at(-70, 72)], look.shade
    )
    sheet.line(
        [at(-70, 28), at(30, 28), at(30, 92), at(-6, 92), at(-16, 76), at(-70, 72), at(-70, 28)],
        width=2.4,
    )
    sheet.line([at(26, 50), at(112, 158), at(176, 96)], width=6 * size)
    sheet.line([at(0, 92), at(112, 158)], width=1.6)
    sheet.polygon([at(160, 104), at(198, 92), at(190, 58), at(156, 66)], look.line)


def mine(sheet: Sheet, rng: np.random.Generator) -> None:
    """A pit head with its wheel, a shaft, and galleries that hollow out the layers."""
    look = sheet.palette
    px = rng.uniform(560, 700)
    top = HORIZON - 300
    sheet.truss((px - 46, HORIZON), (px + 46, HORIZON), (px - 34, top), (px + 34, top), 6, 2.6)
    sheet.line([(px + 40, top + 20), (px + 230, HORIZON)], width=5)
    sheet.line([(px + 40, top + 120), (px + 160, HORIZON)], width=2.4, opacity=0.8)
    wheel = (px, top - 18)
    sheet.disc(*wheel, 58, look.sky[0], 0.85)
    sheet.ring(*wheel, 58, 4)
    sheet.ring(*wheel, 10, 3)
    for a in np.arange(0, 2 * np.pi, np.pi / 4) + rng.uniform(0, np.pi / 4):
        sheet.line([wheel, (wheel[0] + 58 * np.cos(a), wheel[1] + 58 * np.sin(a))], width=1.6)
    hall = px + 300
    roof = [
        (hall + i * 90 + d, HORIZON - h)
        for i in range(5)
        for d, h in ((0, 130), (62, 178), (62, 130))
    ]
    sheet.polygon(
        [
            (hall, HORIZON),
            (hall, HORIZON - 130),
            *roof,
            (hall + 450, HORIZON - 130),
            (hall + 450, HORIZON),
        ],
        look.shade,
    )
    sheet.line(
        [(hall, HORIZON), *roof, (hall + 450, HORIZON - 130), (hall + 450, HORIZON)], width=2.4
    )
    for i in range(9):
        sheet.rect(
            hall + 24 + i * 47,
            HORIZON - 84,
            22,
            34,
            look.thread,
            0.8 if rng.random() < 0.4 else 0.16,
        )
    for dx in (-60, 40):
        stack = px - 290 + dx
        sheet.polygon(
            [
                (stack, HORIZON),
                (stack + 34, HORIZON),
                (stack + 27, HORIZON - 250),
                (stack + 7, HORIZON - 250),
            ],
            look.shade,
        )
        sheet.line(
            [
                (stack, HORIZON),
                (stack + 7, HORIZON - 250),
                (stack + 27, HORIZON - 250),
                (stack + 34, HORIZON),
            ],
            width=2.2,
        )
    depth = HEIGHT - 56
    sheet.rect(px - 20, HORIZON, 40, depth - HORIZON, look.shade)
    for k, y in enumerate((HORIZON + 110, HORIZON + 205, HORIZON + 300)):
        left, right = (
            200 + 60 * k + rng.uniform(-40, 40),
            WIDTH - 240 - 80 * k + rng.uniform(-40, 40),
        )
        sheet.rect(left, y, right - left, 30, look.shade)
        sheet.line([(left, y), (right, y)], width=1.6, opacity=0.7)
        for x in np.arange(left + 20, right, 62):
            sheet.line([(x, y), (x, y + 30)], width=1.6, opacity=0.5)
        sheet.thread([(left + 12, y + 22), (right - 12, y + 22)], 2.4)
    sheet.thread([(px, top - 18), (px, depth)], 3.4)


MOTIFS: dict[str, Callable[[Sheet, np.random.Generator], None]] = {
    'dam': dam,
    'deep wells': well,
    'fracking rig': fracking_rig,
    'oil pumps': oil_pump,
    'open pit': open_pit,
    'mine': mine,
}
