# SPDX-License-Identifier: Apache-2.0
"""The drawn default pairs: what industry puts into the ground, and what the ground gives back.

Each picture is a section of the same earth: sky, horizon, layers. On the left a thread of light
goes down from a machine into the layers; on the right the same colour comes up through a fault and
breaks what people built. Both halves of a pair share palette, horizon and layers, so they read as
one. All is vector geometry from a seed, written as SVG text.
"""

from dataclasses import dataclass

import numpy as np

from eol_ros.core.montage import drawing_damage, drawing_industry
from eol_ros.core.montage.drawing_sheet import PALETTES, Sheet

MIN_PAIRS = 24


@dataclass(frozen=True)
class DrawnPair:
    """One pair: its name, both halves as SVG text, a caption."""

    name: str
    left_svg: str
    right_svg: str
    caption: str


def combinations(count: int = MIN_PAIRS) -> list[tuple[str, str]]:
    """Return `count` (industry, damage) names, each combination once, every motif evenly used."""
    industry = list(drawing_industry.MOTIFS)
    damage = list(drawing_damage.MOTIFS)
    most = len(industry) * len(damage)
    if not 0 < count <= most:
        raise ValueError(f'{count} pairs asked for; there are 1 to {most}')
    walk = [
        (industry[i], damage[(i + shift) % len(damage)])
        for shift in range(len(damage))
        for i in range(len(industry))
    ]
    return walk[:count]


def draw_pair(number: int, names: tuple[str, str], seed: int) -> DrawnPair:
    """Draw pair `number` of `names`; equal arguments give equal text."""
    left_name, right_name = names
    # Neighbours in the walk share neither palette nor motif; a prime step spreads the palettes.
    palette = PALETTES[(number * 5 + number // len(PALETTES)) % len(PALETTES)]
    ground_seed, left_seed, right_seed = np.random.SeedSequence([seed, number]).spawn(3)
    halves = []
    for motif, motif_seed, broken in (
        (drawing_industry.MOTIFS[left_name], left_seed, False),
        (drawing_damage.MOTIFS[right_name], right_seed, True),
    ):
        sheet = Sheet(palette, np.random.default_rng(ground_seed), broken=broken)
        motif(sheet, np.random.default_rng(motif_seed))
        halves.append(sheet.svg())
    caption = f'{left_name.capitalize()} | {right_name}'
    return DrawnPair(f'{number:02d}', halves[0], halves[1], caption)


def draw_all(seed: int = 1, count: int = MIN_PAIRS) -> list[DrawnPair]:
    """Draw the whole default set."""
    return [draw_pair(n, names, seed) for n, names in enumerate(combinations(count))]
