# SPDX-License-Identifier: Apache-2.0
"""Left halves that show the place of a right half before it broke, and what was done there.

Each draws the place by the same function and from the same numbers, whole, and adds the thread.
"""

import numpy as np
from drawings import aftermath
from drawings.damage import Motif, turned
from drawings.sheet import FAULT_X, HEIGHT, HORIZON, WIDTH, Point, Sheet, apart, jagged


def gas_town(sheet: Sheet, rng: np.random.Generator) -> None:
    """The town from above, and the wells that spread beneath it from one pad."""
    look = sheet.palette
    aftermath.offset_streets(sheet, rng)
    wells = apart(rng)
    pad = np.array([905.0, 505.0])
    corners = turned([(830, 442), (980, 442), (980, 568), (830, 568)], tuple(pad), -0.14)
    sheet.polygon(corners, look.shade)
    sheet.line([*corners, corners[0]], width=2.6)
    for k, angle in enumerate(np.linspace(0, 2 * np.pi, 11)[:-1] + wells.uniform(0, 0.5)):
        reach = wells.uniform(0.72, 1.1) * (430 if abs(np.cos(angle)) > 0.6 else 330)
        bend = wells.uniform(-0.3, 0.3)
        head = pad + (-40 + 20.0 * (k % 5), -16 + 32.0 * (k // 5))
        t = np.linspace(0, 1, 14)[:, None]
        way = head + t * reach * np.array([np.cos(angle), np.sin(angle)])
        way = way + t**2 * reach * bend * np.array([-np.sin(angle), np.cos(angle)])
        sheet.thread([tuple(p) for p in way], 2.6)
        for r in (9.0, 17.0):
            sheet.ring(*way[-1], r, 1.6, 0.9 if r < 10 else 0.45)
        sheet.disc(*head, 5.5, look.line)
    for x, y in ((62.0, -44.0), (62.0, -14.0), (62.0, 16.0)):
        tank = turned([tuple(pad + (x - 10, y))], tuple(pad), -0.14)[0]
        sheet.disc(*tank, 12, look.body)
        sheet.ring(*tank, 12, 1.8)


def warm_room(sheet: Sheet, rng: np.random.Generator) -> None:
    """The room when it was warm: a stove whose gas comes up from below, a well at the window."""
    look = sheet.palette
    aftermath.cracked_room(sheet, rng)
    left, top, wide, tall = 235.0, 520.0, 150.0, 205.0
    pipe = left + 75
    sheet.line([(pipe, top), (pipe, 74)], width=13)
    sheet.line([(pipe, top), (pipe, 74)], look.shade, 8)
    sheet.line([(pipe - 16, 74), (pipe + 16, 74)], width=4)
    feet: list[Point] = [(left + 14, top + tall), (left + wide - 14, top + tall)]
    for x, y in feet:
        sheet.line([(x, y - 4), (x, y + 22)], width=6)
    sheet.rect(left, top, wide, tall, look.shade)
    box = [(left, top), (left + wide, top), (left + wide, top + tall), (left, top + tall)]
    sheet.line([*box, box[0]], width=3)
    sheet.line([(left - 10, top), (left + wide + 10, top)], width=7)
    door = [(left + 24, top + 46), (left + wide - 24, top + 46), (left + wide - 24, top + 150),
            (left + 24, top + 150)]  # fmt: skip
    sheet.polygon(door, look.layers[1])
    for k in range(5):
        x = left + 42 + 16.5 * k
        high = 40 + 20 * (k % 2) - 6 * abs(k - 2)
        flame = [(x - 8, top + 146), (x - 5, top + 128), (x, top + 146 - high), (x + 5, top + 128),
                 (x + 8, top + 146)]  # fmt: skip
        sheet.polygon(flame, look.thread, 0.9)
    for r, opacity in ((130, 0.05), (80, 0.08)):
        sheet.disc(left + 75, top + 112, r, look.thread, opacity)
    sheet.line([*door, door[0]], width=2.2)
    for x in np.linspace(left + 40, left + wide - 40, 4):
        sheet.line([(x, top + 46), (x, top + 150)], width=1.6, opacity=0.8)
    low = top + tall - 18  # out of it, along the boards, and down
    sheet.thread([(left + wide, low), (432, low + 44), (432, HEIGHT)], 3.6)


def drained_land(sheet: Sheet, rng: np.random.Generator) -> None:
    """The low land behind its dyke: pumps lift the water from below it, and it sinks."""
    look = sheet.palette
    aftermath.breached_dyke(sheet, rng)
    depths = apart(rng)
    for k, x in enumerate((925.0, 1095.0, 1162.0, 1325.0, 1540.0)):
        deep = HORIZON + 150 + depths.uniform(0, 130)
        sheet.rect(x - 15, HORIZON - 30, 30, 30, look.shade)
        hut = [(x - 15, HORIZON), (x - 15, HORIZON - 30), (x + 15, HORIZON - 30), (x + 15, HORIZON)]
        sheet.line(hut, width=2.2)
        sheet.thread([(x, HORIZON - 8), (x, deep)], 2.6)
        for r in (16.0, 30.0):
            arc = np.linspace(0.15 * np.pi, 0.85 * np.pi, 11)
            sheet.line(zip(x + r * np.cos(arc), deep + 0.6 * r * np.sin(arc), strict=True),
                       look.thread, 1.8, 0.8 if r < 20 else 0.4)  # fmt: skip
        if k == 0:  # over the dyke, into the river
            sheet.line([(x - 15, HORIZON - 20), (x - 52, HORIZON - 96), (808, HORIZON - 140),
                        (712, HORIZON - 140), (648, HORIZON - 92)], width=4)  # fmt: skip
    table = np.linspace(0, WIDTH, 81)
    y = HORIZON + 20 + 96 / (1 + np.exp(-(table - 860) / 60))  # of the ground water
    sheet.line(zip(table, y, strict=True), width=1.8, opacity=0.6, dash='14 12')


def undermined_slope(sheet: Sheet, rng: np.random.Generator) -> None:
    """The slope with its houses, and the galleries that hollow it out."""
    look = sheet.palette
    aftermath.landslide(sheet, rng)
    ends = apart(rng)
    slope = sheet.stands
    assert slope is not None
    xs = np.linspace(0, WIDTH, 321)
    surface = np.array([slope(x) for x in xs])
    tops = []
    for y, left, out in ((452.0, 560.0, True), (540.0, 640.0, True), (640.0, 700.0, False)):
        left += ends.uniform(-30, 30)
        right = float(xs[surface > y][0]) + 16 if out else 1290.0
        tops.append((left + 14, y + 14))
        sheet.rect(left, y, right - left, 28, look.shade)
        sheet.line([(right, y), (left, y), (left, y + 28), (right, y + 28)], width=1.8, opacity=0.8)
        for x in np.arange(left + 30, right - 8, 44):
            sheet.line([(x, y), (x, y + 28)], width=1.8, opacity=0.55)
        sheet.thread([(left + 14, y + 14), (right - 8, y + 14)], 2.6)
        if out:  # its mouth, and what comes out of it
            cart = [
                (right + 4, y + 8),
                (right + 40, y + 8),
                (right + 34, y + 24),
                (right + 10, y + 24),
            ]
            sheet.line([(right - 6, y + 30), (right + 60, y + 30)], width=3)
            sheet.polygon(cart, look.body)
            sheet.line([*cart, cart[0]], width=1.8)
            for x in (right + 15, right + 29):
                sheet.disc(x, y + 27, 3.5, look.line)
    sheet.thread(tops, 2.6)


def oil_harbour(sheet: Sheet, rng: np.random.Generator) -> None:
    """The harbour at work: a cavern of oil under the houses, a ship that is filled."""
    look = sheet.palette
    aftermath.stranded_ship(sheet, rng)
    arm = FAULT_X + 30.0
    sheet.line([(arm, HORIZON), (arm, HORIZON - 124)], width=5)
    elbow, end = (1000.0, HORIZON - 250), (1104.0, HORIZON - 58)
    sheet.line([(arm, HORIZON - 124), elbow, end], width=3.2)
    sheet.disc(arm, HORIZON - 124, 8, look.line)
    sheet.disc(*elbow, 6, look.line)
    deep = HORIZON + 250
    for k, x in enumerate((300.0, 470.0, 620.0)):
        sheet.thread([(x, HORIZON), (x, deep + 24 * (k - 1))], 2.6)
    cavern = np.linspace(0, 2 * np.pi, 50)
    sheet.polygon(
        zip(440 + 330 * np.cos(cavern), deep + 6 + 54 * np.sin(cavern), strict=True),
        look.thread,
        0.2,
    )
    under = HORIZON + 34
    sheet.thread([(620, under), (arm, under), (arm, HORIZON - 124), elbow, end], 2.6)


def deep_tower(sheet: Sheet, rng: np.random.Generator) -> None:
    """The tower, whole, and the wells beside its piles that heat it from far below."""
    look = sheet.palette
    aftermath.split_tower(sheet, rng)
    for x, deep in ((FAULT_X - 100, 330.0), (FAULT_X + 100, 350.0)):
        sheet.thread([(x, HORIZON - 20), (x, HORIZON + deep)], 3.4)
    fans = apart(rng)
    for x, way in ((FAULT_X - 100, -1), (FAULT_X + 100, 1)):
        for k in range(4):
            y = HORIZON + 240 + 28 * k
            end = (x + way * fans.uniform(90, 210), y + fans.uniform(-20, 30))
            sheet.line(jagged(fans, (x, y), end, 9), look.thread, 1.8, 0.85)


BEFORE: dict[str, tuple[str, Motif]] = {
    'offset streets': ('town on its gas field', gas_town),
    'cracked room': ('warm room', warm_room),
    'breached dyke': ('drained land', drained_land),
    'landslide': ('undermined slope', undermined_slope),
    'stranded ship': ('oil harbour', oil_harbour),
    'split tower': ('heated tower', deep_tower),
}
MOTIFS: dict[str, Motif] = dict(BEFORE.values())
WITHOUT_SKY = tuple(BEFORE[name][0] for name in aftermath.WITHOUT_SKY)
