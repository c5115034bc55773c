# SPDX-License-Identifier: Apache-2.0
"""Cascades on the table page: where they began and which way they went, from a still picture.

A server without a graph gets the packets of a cascade whose way is known.
"""

import itertools
import math

import numpy as np
import pytest
from support import needs
from support.chromium import complaints, picture, press, run, until_page, visit
from support.paper import PLATFORM_SIDE_M, rest_lattice
from support.waiting import wait_until

from eol_ros.core import terrain
from eol_ros.core.physics.twin.hands import Frame, reach_m
from eol_ros.core.table import Table
from eol_ros.web import wire

pytestmark = [pytest.mark.slow, needs.marker('chromium', 'chromium-driver')]
# Block and onset in s, two cascades at once.
FIRST = ((6, 0.0), (7, 0.2), (12, 0.6), (13, 0.9), (17, 1.0), (18, 1.4), (23, 1.7), (24, 2.1))
SECOND = ((10, 0.4), (15, 0.8), (21, 1.3))

HUES = {1: (0xF0, 0xC6, 0x4A), 2: (0x7F, 0xD1, 0xC7)}
WAYS = {(6, 7), (7, 12), (12, 13), (12, 17), (17, 18), (18, 23), (23, 24), (10, 15), (16, 21)}
CENTRES = rest_lattice()
SPRINGS = [(a, b) for a, b in itertools.permutations(range(25), 2)
           if np.hypot(*(CENTRES[a] - CENTRES[b])) < 0.18]  # fmt: skip


@pytest.fixture
def table(serve, browser):
    """Open the table page of a table at rest."""
    server = serve()
    server.routes.documents['terrain'] = (terrain.landscape(1) * 65535).astype('<u2').tobytes()
    visit(browser, f'http://127.0.0.1:{server.port}', '/table')
    wait_until(lambda: 'truth' in server.hub.demand)
    pose = np.concatenate([CENTRES.T, np.zeros((1, 25))])
    server.hub.put('truth', wire.truth(1.0, (0.0, 0.0, 0.0), pose, np.zeros(25, bool)))
    until_page(browser, 'eol.state() && eol.drawing.land')
    yield
    assert complaints(browser) == []


AT = """
// Draw what a still shows at `now`, ms, of slips [s, block, cascade]; the page draws nothing after.
const [slips, now, shown] = arguments, {drawing} = eol, {paths} = drawing;
const light = new Uint8Array(25);
paths.cascades = [];
for (const [s, block, cascade] of slips) {
  if (1000 * s > now) break;
  if (shown) paths.slip(block, cascade, s, 1000 * s);
  light[block] = 255 * Math.exp(-(now - 1000 * s) / 500);
}
eol.hands.heldAt = performance.now();
drawing.hint = false;
drawing.draw(now, eol.state(), light);
paths.cascades = [];
const {side} = drawing, box = drawing.canvas.getBoundingClientRect();
return [box.left, box.top, side, drawing.perM / drawing.ratio];
"""


def part(shot, box, centre, half):
    """Return the square of a picture about `centre` (m), of half side `half`."""
    left, top, side, per_m = box
    u, v = left + side / 2 + centre[0] * per_m, top + side / 2 - centre[1] * per_m
    rows, columns = (slice(int(w - half * per_m), int(w + half * per_m)) for w in (v, u))
    return shot[rows, columns, ::-1].astype(float)


def hued(shot, box, cascade, centre):
    """Return the share of a block's place that has the hue of a cascade."""
    pixels = part(shot, box, centre, 0.03)
    pixels /= np.maximum(pixels.max(axis=2, keepdims=True), 1)
    hue = np.array(HUES[cascade]) / max(HUES[cascade])
    return float((np.abs(pixels - hue).max(axis=2) < 0.12).mean())


def test_a_still_shows_where_cascades_began_and_which_way_they_went(table, browser):
    slips = sorted((s, b, c) for c, rows in ((1, FIRST), (2, SECOND)) for b, s in rows)
    for k in range(6):
        box = run(browser, AT, slips, 500 * k + 50, True)
        shot = picture(browser)
    for cascade, rows in ((1, FIRST), (2, SECOND)):
        marks = [hued(shot, box, cascade, centre) for centre in CENTRES]
        assert np.argmax(marks) == rows[0][0] and max(marks) > 2 * sorted(marks)[-2]
    run(browser, AT, slips, 2550, False)
    drawn = np.abs(shot.astype(float) - picture(browser)).max(axis=2, keepdims=True) > 10
    wide = {}  # of what is drawn over each spring: in its middle, and near its end
    for a, b in SPRINGS:
        along = CENTRES[b] - CENTRES[a]
        places = (CENTRES[a] + f * along for f in (0.48, 0.68))
        wide[a, b] = [float(part(drawn, box, place, 0.015).mean()) for place in places]
    for a, b in WAYS:
        middle, head = wide[a, b]
        assert head > 1.3 * middle > 0, (a, b)
    assert min(wide[15, 16]) > 0  # around a corner: its head is at 21
    carried = {*WAYS, (15, 16)}
    for (a, b), found in wide.items():
        if not {(a, b), (b, a)} & carried and not {6, 10} & {a, b}:
            assert found == [0, 0], (a, b)


def test_ways_of_cascades(table, browser):
    ways = """
    return import('/static/paths.js').then(({Paths}) => {
      const paths = new Paths();
      return arguments[0].map(([block, cascade, onset, now]) => {
        paths.slip(block, cascade, onset, now);
        return paths.cascades.map(
          ({slips, joins, hue}) => [slips[0].block, joins.map((join) => join.path), hue]);
      });
    });
    """
    found = run(browser, ways, [
        (12, 1, 1.0, 0), (11, 1, 1.2, 200), (12, 1, 1.3, 250), (7, 2, 0.9, 300), (18, 1, 1.4, 400),
        (13, 1, 0.8, 450), (0, 2, 1.5, 500), (16, 1, 1.1, 550), (24, 3, 9.0, 8000),
    ])  # fmt: skip
    assert found == [
        [[12, [], 0]],
        [[12, [[12, 11]], 0]],
        [[12, [[12, 11]], 0]],  # once a block
        [[12, [[12, 11]], 0], [7, [], 1]],
        [[12, [[12, 11], [12, 13, 18]], 0], [7, [], 1]],  # by springs, around a corner
        [[13, [[13, 12], [12, 11], [13, 18]], 0], [7, [], 1]],  # told late, began before
        [[13, [[13, 12], [12, 11], [13, 18]], 0], [7, [[0]], 1]],  # 0 has no neighbour in it
        [[13, [[13, 12], [12, 17, 16], [16, 11], [13, 18]], 0], [7, [[0]], 1]],  # 11 slips later
        [[24, [], 0]],
    ]


def test_joins_fade_and_nothing_takes_their_place(table, browser):
    left = """
    return import('/static/paths.js').then(({Paths}) => {
      const paths = new Paths();
      for (const [block, s] of [[6, 0], [7, 0.2], [12, 0.4]]) paths.slip(block, 1, s, 1000 * s);
      return arguments[0].map((now) => {
        paths.pass(now);
        return paths.cascades.map(({joins}) => joins.map((join) => join.path));
      });
    });
    """
    found = run(browser, left, [400, 3300, 3500])
    assert found == [[[[6, 7], [7, 12]]], [[[7, 12]]], []]


def test_a_slip_far_from_all_others_has_a_small_mark(table, browser):
    def marks():
        box = run(browser, AT, [(0.0, 6, 1), (0.3, 7, 1), (0.6, 23, 1)], 1000, True)
        shot = picture(browser)
        return [hued(shot, box, 1, centre) for centre in CENTRES]

    wait_until(lambda: marks()[6] > 0)
    found = marks()
    assert found[6] > 1.5 * found[23] > 0 and found[0] == 0


def test_nothing_leaves_the_picture(table, browser):
    reached = """
    const {drawing} = eol, {brush} = drawing, {arc} = brush, [pull] = arguments, found = [];
    brush.arc = (x, y, r) => found.push(Math.abs(x) + r, Math.abs(y) + r);
    drawing.drawPull(pull);
    brush.arc = arc;
    return [Math.max(...found), drawing.w / drawing.perM / 2];
    """
    for to in ([3, 0.2], [-0.9, -2.5], [0, 0.1]):
        far, edge = run(browser, reached, {'from': [0.4, -0.4], 'to': to})
        assert far < edge


@pytest.mark.parametrize('yaw', [0.0, 0.25, math.pi / 4])
def test_the_rim_is_drawn_on_the_platform_as_far_as_the_twin_lets_it(table, browser, yaw):
    drawn = """
    const {drawing} = eol, {brush} = drawing, {rect} = brush, found = [];
    brush.rect = function(x, y, w, h) {
      for (const corner of [[x, y], [x + w, y], [x, y + h], [x + w, y + h]]) {
        const at = brush.getTransform().transformPoint({x: corner[0], y: corner[1]});
        found.push([(at.x - drawing.w / 2) / drawing.perM, (at.y - drawing.h / 2) / drawing.perM]);
      }
    };
    const {perM, w, h} = drawing;
    brush.setTransform(perM, 0, 0, -perM, w / 2, h / 2);
    drawing.drawRim(arguments[0]);
    brush.rect = rect;
    return found.slice(-8); // the first ones are those of its shadow
    """
    corners = np.array(run(browser, drawn, [reach_m(yaw, Frame.of(Table()))[0], 0.0, yaw]))
    assert np.abs(corners).max() == pytest.approx(PLATFORM_SIDE_M / 2, abs=1e-6)


def test_the_greatest_cascade_of_today_is_replayed_slowly(table, browser, serve):
    day = {'recent': [], 'greatest': [1e9, 6, 8, 9, 2.1, [block for block, _ in FIRST]]}
    run(browser, 'eol.link.emit("cascades", arguments[0])', day)
    browser.find_element('id', 'replay').click()
    until_page(browser, 'document.getElementById("caption").textContent.startsWith("Today at ")')
    until_page(browser, 'eol.drawing.paths.cascades[0].joins.length === 7')
    server = serve()
    server.routes.documents['terrain'] = (terrain.landscape(1) * 65535).astype('<u2').tobytes()
    server.hub.put('notices', {'t': 'cascades', **day}, sticky='cascades')
    visit(browser, f'http://127.0.0.1:{server.port}', '/wall/left')
    until_page(browser, 'eol.link.heard.cascades')
    press(browser, 'g')
    until_page(browser, 'eol.replay && eol.replay.paths.cascades.length && eol.replay.land')
    until_page(browser, 'performance.now() - eol.replay.paths.cascades[0].slips[3].at > 0')
    until_page(browser, 'document.getElementById("replay").hidden')
