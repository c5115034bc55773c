# SPDX-License-Identifier: Apache-2.0
"""Draws the default pairs of the walls: what industry puts into the ground, and what it gives back.

    python tools/draw_walls.py            write them to eol_ros/devices/files/walls
    python tools/draw_walls.py --check    exit 1 where those differ

Most are sections of the same earth: sky, horizon, layers; others are seen from above or from
within. On the left a thread of light goes from what people do into the ground; on the right the
same colour comes up through a fault and breaks what people built. Both halves of a pair share
palette and earth, so they read as one; six pairs are one place before and after. All is vector
geometry from a seed, written as SVG text; the files ship as they are drawn here.
"""

import csv
import io
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from drawings import aftermath, before, damage, industry, works
from drawings.damage import Motif
from drawings.sheet import PALETTES, WEATHERS, Palette, Sheet, View

WALLS = Path(__file__).parents[1] / 'eol_ros' / 'devices' / 'files' / 'walls'
SEED = 1
DEGREES = 4  # of damage, in which each right half comes
CHINESE = {
    'dam': '水壩',
    'deep wells': '深井',
    'fracking rig': '水力壓裂',
    'oil pumps': '油泵',
    'open pit': '露天礦場',
    'mine': '礦井',
    'open-cast mine': '露天煤礦',
    'turbine hall': '渦輪機房',
    'oil platform': '鑽油平台',
    'interchange': '交流道',
    'tunnel': '隧道',
    'cooling towers': '冷卻塔',
    'town on its gas field': '氣田上的小鎮',
    'warm room': '溫暖的房間',
    'drained land': '抽乾的低地',
    'undermined slope': '挖空的山坡',
    'oil harbour': '油港',
    'heated tower': '地熱高樓',
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


def by_turns(sections: dict[str, Motif], others: dict[str, Motif]) -> dict[str, Motif]:
    """Return what is seen as a section and what is seen otherwise, one after the other."""
    rows = zip(sections.items(), others.items(), strict=True)
    return dict(motif for row in rows for motif in row)


CAUSES = by_turns(industry.MOTIFS, works.MOTIFS)
EFFECTS = by_turns(damage.MOTIFS, aftermath.MOTIFS)
DRAWN = CAUSES | before.MOTIFS | EFFECTS
SKYLESS = {*works.WITHOUT_SKY, *before.WITHOUT_SKY, *aftermath.WITHOUT_SKY}
# How near a half is seen at most: what is tall, or fills its sheet, and some of it to the edge.
NEAREST = dict.fromkeys(('fracking rig', 'mine', *works.MOTIFS, *aftermath.MOTIFS), 1.22)
NEAREST |= dict.fromkeys(('open-cast mine', 'tunnel', 'oil platform', 'cooling towers'), 1.0)
NEAREST |= dict.fromkeys(('cracked room', 'split tower'), 1.0)


@dataclass(frozen=True)
class DrawnPair:
    """One pair: its name, its halves as SVG text, a caption."""

    name: str
    left_svg: str
    right_svgs: tuple[str, ...]  # of ever greater damage
    caption: str


def combinations() -> list[tuple[str, str]]:
    """Return the (left, right) names of all pairs, each combination once.

    Each cause comes twice, each effect too, never both without a sky; and after every fourth pair
    comes one place before and after.
    """
    causes, effects, places = list(CAUSES), list(EFFECTS), list(before.BEFORE)
    found = []
    for n in range(2 * len(causes)):
        once = n // len(causes)
        found.append((causes[n % len(causes)], effects[(n + (1, 4)[once]) % len(effects)]))
        if n % 4 == 3:
            place = places[(n // 4 + 4) % len(places)]  # which none of its neighbours shows
            found.append((before.BEFORE[place][0], place))
    return found


def palette_of(number: int) -> Palette:
    """Return the colours of pair `number`, which are not those of its neighbours."""
    return PALETTES[(number * 5 + 2 * (number // len(PALETTES))) % len(PALETTES)]


def draw_pair(number: int, names: tuple[str, str], seed: int) -> DrawnPair:
    """Draw pair `number` of `names`; equal arguments give equal text."""
    left_name, right_name = names
    ground_seed, left_seed, right_seed, air_seed = np.random.SeedSequence([seed, number]).spawn(4)
    if left_name in before.MOTIFS:
        left_seed = right_seed  # the same place

    def drawn(name: str, motif_seed: np.random.SeedSequence, damage: float) -> str:
        view = view_of(number, names, left=damage == 0)
        sheet = Sheet(palette_of(number), np.random.default_rng(ground_seed), damage, view)
        DRAWN[name](sheet, np.random.default_rng(motif_seed))
        sheet.draw_weather(np.random.default_rng(air_seed))
        return sheet.svg()

    left = drawn(left_name, left_seed, 0.0)
    rights = [drawn(right_name, right_seed, (k + 1) / DEGREES) for k in range(DEGREES)]
    caption = f'{left_name.capitalize()} | {right_name}'
    return DrawnPair(f'{number:02d}', left, tuple(rights), caption)


def view_of(number: int, names: tuple[str, str], left: bool) -> View:
    """Return how a half of pair `number` is seen."""
    skies = [name not in SKYLESS for name in names]
    moon_is_left = skies[0] and (bool((number + number // 6) % 2) or not skies[1])
    near = (1.0, 1.22, 1.0, 1.5)[(number + number // 6) % 4]
    return View(
        mirrored=bool(number // 15 % 2),
        near=min(near, *(NEAREST.get(name, near) for name in names)),
        middle=(800.0, 700.0, 900.0)[number % 3],
        weather=WEATHERS[(number + 2 * (number // 6)) % len(WEATHERS)],
        moon=skies[not left] and left == moon_is_left,
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
