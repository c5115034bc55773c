# SPDX-License-Identifier: Apache-2.0
"""Draws the default pairs of the walls: what industry puts into the ground, and what it gives back.

    python tools/draw_walls.py            write them to eol_ros/devices/files/walls
    python tools/draw_walls.py --check    exit 1 where those differ

Each image is a section of the same earth: sky, horizon, layers. On the left a thread of light
goes down from a machine into the layers; on the right the same colour comes up through a fault and
breaks what people built. Both halves of a pair share palette, horizon and layers, so they read as
one. All is vector geometry from a seed, written as SVG text; the files ship as they are drawn here.
"""

import csv
import io
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from drawings import aftermath, damage, industry
from drawings.damage import Motif
from drawings.sheet import PALETTES, WEATHERS, Sheet, View

WALLS = Path(__file__).parents[1] / 'eol_ros' / 'devices' / 'files' / 'walls'
MIN_PAIRS = 24
SEED = 1
DEGREES = 4  # of damage, in which each right half comes
CHINESE = {
    'dam': '水壩',
    'deep wells': '深井',
    'fracking rig': '水力壓裂',
    'oil pumps': '油泵',
    'open pit': '露天礦場',
    'mine': '礦井',
    'cracked wall': '裂牆',
    'tilted house': '傾斜的房屋',
    'broken road': '斷裂的道路',
    'collapsed bridge': '崩塌的橋',
    'sinkhole': '天坑',
    'fallen pylons': '倒下的電塔',
    'offset streets': '錯開的街道',
    'cracked room': '開裂的房間',
    'breached dyke': '決口的堤防',
    'landslide': '山崩',
    'stranded ship': '擱淺的船',
    'split tower': '裂開的高樓',
}
# A section and what is seen otherwise, by turns
EFFECTS = dict(pair for both in zip(damage.MOTIFS.items(), aftermath.MOTIFS.items(), strict=True)
               for pair in both)  # fmt: skip


@dataclass(frozen=True)
class DrawnPair:
    """One pair: its name, its halves as SVG text, a caption."""

    name: str
    left_svg: str
    right_svgs: tuple[str, ...]  # of ever greater damage
    caption: str


def combinations(count: int = MIN_PAIRS) -> list[tuple[str, str]]:
    """Return `count` (industry, damage) names, each combination once, every motif evenly used."""
    causes, effects = list(industry.MOTIFS), list(EFFECTS)
    most = len(causes) * len(effects)
    if not 0 < count <= most:
        raise ValueError(f'{count} pairs asked for; there are 1 to {most}')
    return [
        (causes[n % len(causes)], effects[(n + n // len(effects)) % len(effects)])
        for n in range(count)
    ]


def draw_pair(number: int, names: tuple[str, str], seed: int) -> DrawnPair:
    """Draw pair `number` of `names`; equal arguments give equal text."""
    left_name, right_name = names
    # Neighbours in the walk share neither palette nor motif; a prime step spreads the palettes.
    palette = PALETTES[(number * 5 + number // len(PALETTES)) % len(PALETTES)]
    ground_seed, left_seed, right_seed, air_seed = np.random.SeedSequence([seed, number]).spawn(4)

    def drawn(motif: Motif, motif_seed: np.random.SeedSequence, damage: float) -> str:
        view = view_of(number, damage == 0, right_name not in aftermath.WITHOUT_SKY)
        sheet = Sheet(palette, np.random.default_rng(ground_seed), damage, view)
        motif(sheet, np.random.default_rng(motif_seed))
        sheet.draw_weather(np.random.default_rng(air_seed))
        return sheet.svg()

    left = drawn(industry.MOTIFS[left_name], left_seed, 0.0)
    broken = EFFECTS[right_name]
    rights = [drawn(broken, right_seed, (k + 1) / DEGREES) for k in range(DEGREES)]
    caption = f'{left_name.capitalize()} | {right_name}'
    return DrawnPair(f'{number:02d}', left, tuple(rights), caption)


def view_of(number: int, left: bool, right_has_sky: bool = True) -> View:
    """Return how a half of pair `number` is seen."""
    moon_is_left = bool((number + number // 6) % 2) or not right_has_sky
    return View(
        mirrored=bool(number // 12 % 2),
        near=(1.0, 1.22, 1.0, 1.5)[(number + number // 6) % 4],
        middle=(800.0, 700.0, 900.0)[number % 3],
        weather=WEATHERS[(number + 2 * (number // 6)) % len(WEATHERS)],
        moon=left == moon_is_left,
        people=(0, 3, 0, 7, 1)[number % 5],
    )


def files() -> dict[str, str]:
    """Return the whole default set: names and texts of the images, and of their list."""
    found, list_ = {}, io.StringIO()
    table = csv.writer(list_, lineterminator='\n')
    table.writerow(('left', 'right', 'caption', 'credit', 'caption_zh'))
    for number, names in enumerate(combinations()):
        pair = draw_pair(number, names, SEED)
        left, right = f'{pair.name}-left.svg', f'{pair.name}-right.svg'
        found[left] = pair.left_svg
        for degree, text in enumerate(pair.right_svgs, 1):
            found[f'{pair.name}-right.{degree}.svg'] = text
        chinese = '｜'.join(CHINESE[word] for word in names)
        table.writerow((left, right, pair.caption, 'Echoes of the Land', chinese))
    return found | {'pairs.csv': list_.getvalue()}


def main() -> int:
    drawn = files()
    if '--check' in sys.argv[1:]:
        stale = [
            name
            for name in sorted(drawn.keys() | {path.name for path in WALLS.iterdir()})
            if name not in drawn
            or not (WALLS / name).exists()
            or (WALLS / name).read_text(encoding='utf-8') != drawn[name]
        ]
        if stale:
            print(f'not as they are drawn: {", ".join(stale)}', file=sys.stderr)
        return bool(stale)
    WALLS.mkdir(exist_ok=True)
    for path in WALLS.iterdir():
        path.unlink()
    for name, text in drawn.items():
        (WALLS / name).write_text(text, encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
