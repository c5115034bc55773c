# SPDX-License-Identifier: Apache-2.0
"""The drawn pairs: well-formed, seeded, within the sheet, two halves of one land; as they ship."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

TOOLS = Path(__file__).parents[1] / 'tools'
sys.path.insert(0, str(TOOLS))

from draw_walls import DEGREES, combinations, draw_pair, view_of  # noqa: E402
from drawings.damage import sinkhole  # noqa: E402
from drawings.sheet import FAULT_X, HEIGHT, PALETTES, WIDTH, Sheet, jagged  # noqa: E402

SVG = '{http://www.w3.org/2000/svg}'


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb, WCAG 2.1."""
    c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    c = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(c @ [0.2126, 0.7152, 0.0722])


def test_combinations_are_distinct_and_even():
    walk = combinations(24)
    assert len(set(walk)) == 24
    assert all(a[0] != b[0] and a[1] != b[1] for a, b in pairwise(walk))
    for side, times in ((0, 4), (1, 2)):
        names = [w[side] for w in walk]
        assert {names.count(n) for n in names} == {times}
    assert len(set(combinations(72))) == 72
    with pytest.raises(ValueError, match='1 to 72'):
        combinations(73)


@pytest.mark.parametrize(('number', 'names'), list(enumerate(combinations()))[::2])
def test_a_pair_is_wellformed_seeded_and_inside(number, names):
    pair = draw_pair(number, names, seed=1)
    assert pair == draw_pair(number, names, seed=1)
    assert pair.left_svg != draw_pair(number, names, seed=2).left_svg
    assert len(set(pair.right_svgs)) == DEGREES
    for text in (pair.left_svg, *pair.right_svgs):
        root = ElementTree.fromstring(text)
        assert root.get('viewBox') == f'0 0 {WIDTH} {HEIGHT}'
        shapes = list(root.iter(f'{SVG}polygon')) + list(root.iter(f'{SVG}polyline'))
        assert len(shapes) > 60
        points = np.array(
            [p.split(',') for s in shapes for p in s.get('points').split()], dtype=float
        )
        assert np.all(np.isfinite(points))
        inside = (points > [-60, -60]) & (points < [WIDTH + 60, HEIGHT + 60])
        assert np.mean(inside.all(axis=1)) > 0.97
        assert 'script' not in text and 'href' not in text  # an image, nothing that acts or loads


def test_one_moon_hangs_in_the_room():
    for number in range(24):
        pair = draw_pair(number, combinations()[number], seed=1)
        moon = PALETTES[(number * 5 + number // len(PALETTES)) % len(PALETTES)].disc
        shown = [
            any(
                s.get('fill') == moon and float(s.get('opacity', 1)) >= 0.3
                for s in ElementTree.fromstring(text).iter()
                if s.tag == f'{SVG}polygon' or float(s.get('r', 0)) > 50
            )
            for text in (pair.left_svg, *pair.right_svgs)
        ]
        assert len(set(shown[1:])) == 1 and shown[0] != shown[1], number


def test_no_two_pairs_are_composed_alike():
    walk = combinations()
    seen = {(*walk[n], view_of(n, left=True)) for n in range(24)}
    assert len(seen) == 24
    for side in (0, 1):  # nor is a motif ever seen twice in the same way
        for name in {w[side] for w in walk}:
            views = [view_of(n, left=True) for n in range(24) if walk[n][side] == name]
            assert len(set(views)) == len(views) == (2 if side else 4), name


@pytest.mark.parametrize('number', range(12))
def test_the_degrees_are_one_place_ever_more_broken(number):
    """The ground steps further and the fault comes higher; what stood there before stands there."""
    pair = draw_pair(number, combinations()[number], seed=1)
    threads, points = [], []
    for text in pair.right_svgs:
        lines = list(ElementTree.fromstring(text).iter(f'{SVG}polyline'))
        thread = PALETTES[(number * 5 + number // len(PALETTES)) % len(PALETTES)].thread
        glowing = [p for p in lines if p.get('stroke') == thread and not p.get('opacity')]
        threads.append(sum(len(p.get('points').split()) for p in glowing))
        points.append({p.get('points') for p in lines})
    if combinations()[number][1] != 'sinkhole':  # which comes down to meet its fault
        assert threads == sorted(threads) and threads[-1] > threads[0]
    assert all(len(a & b) > 0.25 * len(a) for a, b in pairwise(points))  # hills, layers, houses


def test_no_wire_hangs_without_a_post():
    """Of the fence at the sinkhole nothing stands over the hole."""
    for damage in (0.25, 0.5, 0.75, 1.0):
        sheet = Sheet(PALETTES[0], np.random.default_rng(1), damage)
        before = len(sheet._parts)
        sinkhole(sheet, np.random.default_rng(2))
        right = FAULT_X + 40 + 280 * (0.3 + 0.7 * damage)
        for part in sheet._parts[before:]:
            if 'polyline' in part and 'width="1.3"' in part and 'opacity="0.7"' in part:
                xs = [float(p.split(',')[0]) for p in part.split('"')[1].split()]
                assert min(xs) >= right - 14.1


def test_a_change_of_pair_is_no_flash():
    """WCAG counts a change of 10 % of relative luminance; sky and earth stay far below it."""
    skies = [luminance(c) for p in PALETTES for c in (*p.sky, *p.hills, *p.layers)]
    assert max(skies) - min(skies) < 0.12
    for palette in PALETTES:
        light, dark = luminance(palette.line), luminance(palette.sky[1])
        assert (light + 0.05) / (dark + 0.05) > 4.5


def test_a_broken_sheet_steps_at_the_fault_only():
    whole = Sheet(PALETTES[0], np.random.default_rng(1))
    broken = Sheet(PALETTES[0], np.random.default_rng(1), damage=1.0)
    assert whole.ground(1500) == whole.ground(100) == broken.ground(100) < broken.ground(1500)


def test_jagged_keeps_its_ends():
    points = jagged(np.random.default_rng(0), (3.0, 4.0), (400.0, 90.0), 20)
    assert points[0] == (3.0, 4.0) and points[-1] == pytest.approx((400.0, 90.0))


@pytest.mark.slow
def test_what_ships_is_what_is_drawn():
    words = [sys.executable, TOOLS / 'draw_walls.py', '--check']
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
