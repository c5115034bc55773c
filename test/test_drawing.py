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

import draw_walls  # noqa: E402
from draw_walls import DEGREES, DRAWN, combinations, draw_pair, palette_of, view_of  # noqa: E402
from drawings import aftermath, before, damage, industry, works  # noqa: E402
from drawings.sheet import FAULT_X, HEIGHT, PALETTES, WIDTH, Sheet, jagged  # noqa: E402

SVG = '{http://www.w3.org/2000/svg}'


def lines_of(text):
    """Return all lines of an image: polylines, and the strokes of its paths."""
    root = ElementTree.fromstring(text)
    strokes = [s for p in root.iter(f'{SVG}path') for s in p.get('d').split('M')[1:]]
    return {*strokes, *(p.get('points') for p in root.iter(f'{SVG}polyline'))}


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb, WCAG 2.1."""
    c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    c = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(c @ [0.2126, 0.7152, 0.0722])


def test_combinations_are_distinct_and_even():
    walk = combinations()
    assert len(set(walk)) == len(walk) == 30
    both = [*walk, walk[0]]
    assert all(a[0] != b[0] and a[1] != b[1] for a, b in pairwise(both))
    times = {name: sum(name in pair for pair in walk) for name in DRAWN}
    for motifs, count in ((industry, 2), (works, 2), (before, 1), (damage, 2), (aftermath, 3)):
        assert {times[name] for name in motifs.MOTIFS} == {count}
    assert len(DRAWN) == 30 and set(draw_walls.CHINESE) == set(DRAWN)
    assert len(set(draw_walls.CHINESE.values())) == 30


def test_a_place_before_is_the_place_after():
    """What the right half draws from its numbers where all is whole, the left half has."""
    places = [(n, names) for n, names in enumerate(combinations()) if names[0] in before.MOTIFS]
    assert len(places) == 6
    for number, (left, right) in places:
        assert before.BEFORE[right][0] == left
        text = draw_pair(number, (left, right), seed=1).left_svg
        ground, _, seed, _ = np.random.SeedSequence([1, number]).spawn(4)
        view = view_of(number, (left, right), left=True)
        whole = Sheet(palette_of(number), np.random.default_rng(ground), 0.0, view)
        DRAWN[right](whole, np.random.default_rng(seed))
        added = set(text.splitlines()) - set(whole._parts)
        assert set(whole._parts) <= set(text.splitlines()), left
        assert any(palette_of(number).thread in part for part in added), left


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
        assert len(shapes) + text.count('M') > 60
        points = np.array(
            [p.split(',') for s in shapes for p in s.get('points').split()], dtype=float
        )
        assert np.all(np.isfinite(points))
        inside = (points > [-60, -60]) & (points < [WIDTH + 60, HEIGHT + 60])
        assert np.mean(inside.all(axis=1)) > 0.97
        assert 'script' not in text and 'href' not in text  # an image, nothing that acts or loads


def test_one_moon_hangs_in_the_room():
    for number, names in enumerate(combinations()):
        pair = draw_pair(number, names, seed=1)
        moon = palette_of(number).disc
        shown = [
            any(
                s.get('fill') == moon and float(s.get('opacity', 1)) >= 0.3
                for s in ElementTree.fromstring(text).iter()
                if s.tag == f'{SVG}polygon' or float(s.get('r', 0)) > 50
            )
            for text in (pair.left_svg, *pair.right_svgs)
        ]
        skies = sum(name not in draw_walls.SKYLESS for name in names)
        assert len(set(shown[1:])) == 1 and shown[0] + shown[1] == (skies > 0), number
        assert not any(
            on and name in draw_walls.SKYLESS for on, name in zip(shown, names, strict=False)
        )


def test_no_two_pairs_are_composed_alike():
    walk = combinations()
    views = [view_of(n, names, left=True) for n, names in enumerate(walk)]
    assert len({*zip(walk, views, strict=True)}) == len(walk)
    for name in DRAWN:  # nor is a motif ever seen twice in the same way
        seen = [(views[n], palette_of(n)) for n, names in enumerate(walk) if name in names]
        assert len(set(seen)) == len(seen)
        if name not in before.MOTIFS:
            assert {view.mirrored for view, _ in seen} == {False, True}, name


@pytest.mark.parametrize('shown', [*DRAWN])
def test_nobody_stands_where_nothing_carries_them(shown):
    """Not in water, not over a pit or a hole, not in the air."""
    for share in (0.0,) if shown not in draw_walls.EFFECTS else (0.25, 0.5, 0.75, 1.0):
        sheet = Sheet(PALETTES[0], np.random.default_rng(1), share)
        DRAWN[shown](sheet, np.random.default_rng(2))
        if sheet.stands is None:
            continue
        places = {x: sheet.stands(x) for x in np.linspace(120, 1480, 400)}
        feet = [(x, y) for x, y in places.items() if np.isfinite(y)]
        assert feet, 'say None'
        for x, y in feet:
            carried = any(carries(part, x, y) for part in sheet._parts)
            assert carried, (shown, share, x, y)


def carries(part, x, y):
    """Whether an edge of a drawn shape passes within a few pixels of (x, y) from below."""
    if 'points="' not in part:
        return False
    points = np.array(
        [p.split(',') for p in part.split('points="')[1].split('"')[0].split()], dtype=float
    )
    if part.startswith('<polygon'):
        points = np.vstack([points, points[:1]])
    for (x0, y0), (x1, y1) in pairwise(points):
        if min(x0, x1) - 1 <= x <= max(x0, x1) + 1 and abs(x1 - x0) > 1e-9:
            at = y0 + (y1 - y0) * (x - x0) / (x1 - x0)
            if abs(at - y) < 9 and abs(y1 - y0) < 2 * abs(x1 - x0):
                return True
    return False


@pytest.mark.parametrize('number', range(15))
def test_the_degrees_are_one_place_ever_more_broken(number):
    """The ground steps further and the fault comes higher; what stood there before stands there."""
    pair = draw_pair(number, combinations()[number], seed=1)
    threads, points = [], []
    for text in pair.right_svgs:
        lines = list(ElementTree.fromstring(text).iter(f'{SVG}polyline'))
        thread = palette_of(number).thread
        glowing = [p for p in lines if p.get('stroke') == thread and not p.get('opacity')]
        threads.append(sum(len(p.get('points').split()) for p in glowing))
        points.append(lines_of(text))
    if combinations()[number][1] != 'sinkhole':  # which comes down to meet its fault
        assert threads == sorted(threads) and threads[-1] > threads[0]
    assert all(len(a & b) > 0.25 * len(a) for a, b in pairwise(points))  # hills, layers, houses


def test_no_wire_hangs_without_a_post():
    """Of the fence at the sinkhole nothing stands over the hole."""
    for share in (0.25, 0.5, 0.75, 1.0):
        sheet = Sheet(PALETTES[0], np.random.default_rng(1), share)
        first = len(sheet._parts)
        damage.sinkhole(sheet, np.random.default_rng(2))
        right = FAULT_X + 40 + 280 * (0.3 + 0.7 * share)
        for part in sheet._parts[first:]:
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
