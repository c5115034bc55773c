# SPDX-License-Identifier: Apache-2.0
"""The pages of tables that are not 5x5: what they draw of packets made here, without a graph."""

import time

import cv2
import numpy as np
import pytest
from support import needs
from support.chromium import complaints, picture, run, until_page, visit
from support.waiting import wait_until

from eol_ros.core import terrain
from eol_ros.core.table import Table
from eol_ros.web import wire

pytestmark = [pytest.mark.slow, needs.marker('chromium', 'chromium-driver')]
RING = Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))
WIDE = Table(rows=3, columns=4, gap_y_m=0.05, platform_m=(1.2, 0.8))
GREAT = Table(rows=8, columns=8, gap_m=0.05, platform_m=(1.6, 1.6))
PER_M = 400.0  # pixels of the camera


@pytest.fixture(params=[WIDE, RING, GREAT], ids=['3x4', 'ring', '8x8'])
def shown(request, serve):
    """Serve the pages of a table, whose block of the highest id moves and is lit."""
    table = request.param
    server = serve(table=table)
    land = terrain.landscape(1, table.rows, table.columns)
    server.routes.documents['terrain'] = (land * 65535).astype('<u2').tobytes()
    x, y = np.where(table.present, table.rest.T, np.nan)
    last = int(table.ids[-1])
    rows = np.zeros(
        table.cells, [(n, 'f8') for n in ('x', 'y', 'yaw', 'u', 'v', 'sigma', 'visibility', 'seen')]
    )
    rows['x'], rows['y'], rows['seen'] = x, y, table.present
    rows['u'], rows['v'] = 640 + PER_M * x, 400 - PER_M * y
    moving, white = np.arange(table.cells) == last, np.zeros(table.cells, np.uint8)
    white[last] = 255
    packets = {
        'blocks': wire.blocks(1.0, 1, False, rows),
        'truth': wire.truth(1.0, (0.0, 0.0, 0.0), [x, y, np.zeros(table.cells)], moving),
        'leds': wire.leds(1.0, white, True),
        'image': wire.image(1.0, cv2.imencode('.jpg', np.zeros((400, 640), np.uint8))[1]),
    }

    def put():
        wait_until(lambda: server.hub.demand >= {'blocks', 'slips', 'leds'})
        for channel, packet in packets.items():
            server.hub.put(channel, packet)
        server.hub.put('slips', {'t': 'slip', 'block': last, 'start': 1, 'stamp': time.time(),
                                 'cascade': 1, 'onset': 1.0})  # fmt: skip

    return table, server, put


def test_the_monitor_shows_each_block_where_it_is(shown, browser):
    table, server, put = shown
    visit(browser, f'http://127.0.0.1:{server.port}', '/', 1920, 1080)
    areas = [0] * table.count + [3]
    areas[1] = 40
    server.hub.put('notices', {'t': 'cascades', 'areas': areas, 'recent': [], 'law': {}})
    put()
    until_page(browser, 'eol.camera.past.length && eol.views.lights.levels.some((l) => l)')
    seen = f'{table.count} of {table.count} seen'
    until_page(browser, f'document.getElementById("camera-state").textContent.startsWith("{seen}")')
    rows = '[...document.querySelectorAll("#coords tbody tr")]'
    listed = f'{rows}.map((row) => row.cells[0].textContent).join()'
    until_page(browser, f'{listed} === "{",".join(map(str, table.ids))}"')
    wide = 'return [scrollX, innerHeight - document.querySelector("body").scrollHeight]'
    assert run(browser, wide) == [0, 0]
    walk = """
    const {canvas} = eol.camera, found = [], {camera} = eol;
    for (const key of arguments[0]) {
      canvas.dispatchEvent(new KeyboardEvent('keydown', {key}));
      found.push(camera.pointed);
    }
    return found;
    """
    first, right = table.ids[0], table.ids[1]
    keys = ['ArrowUp', 'ArrowRight', 'ArrowUp', 'ArrowDown', 'ArrowDown']
    above = table.ids[(table.ids > right) & (table.ids % table.columns == right % table.columns)][0]
    assert run(browser, walk, keys) == [first, right, above, right, right]
    until_page(browser, 'document.getElementById("light-sum").textContent.startsWith("1 ")')
    assert complaints(browser) == []


def test_the_table_page_draws_rim_blocks_and_springs(shown, browser):
    table, server, put = shown
    visit(browser, f'http://127.0.0.1:{server.port}', '/table', 1600, 1000)
    put()
    until_page(browser, 'eol.state()?.rim && eol.drawing.land && eol.counts.flashes')
    drawn = """
    const {drawing} = eol, found = {springs: [], blocks: [], light: []};
    drawing.spring = (a, b) => found.springs.push([a, b]);
    drawing.drawBlock = (id) => found.blocks.push(id);
    drawing.draw(performance.now(), eol.state(), new Uint8Array(arguments[0]));
    delete drawing.spring;
    delete drawing.drawBlock;
    return found;
    """
    found = run(browser, drawn, table.cells)
    assert found['blocks'] == table.ids.tolist()
    poses = np.column_stack([table.rest, np.zeros(table.cells)])
    ends = table.spring_ends(poses, np.zeros(3))
    order = lambda springs: sorted(np.round(np.sort(s, axis=0), 4).tolist() for s in springs)  # noqa: E731
    assert np.allclose(order(found['springs']), order(ends), atol=2e-4)
    run(browser, 'eol.hands.heldAt = performance.now(); eol.drawing.dirty = true;')
    until_page(browser, '!eol.drawing.hint && !eol.drawing.dirty')
    shot = picture(browser)
    box = run(browser, 'const b = eol.drawing.canvas.getBoundingClientRect();'
                       'return [b.left, b.top, eol.drawing.side, eol.drawing.perM]')  # fmt: skip
    left, top, side, per_m = box

    def at(x, y):
        return shot[int(top + side / 2 - y * per_m), int(left + side / 2 + x * per_m)].astype(int)

    for width, depth in np.array([[1, 0], [0, 1]]) * table.rim_m():  # steel is grey and light
        steel = at(
            *(np.sign([width, depth]) * (max(width, depth) + table.rim_width_m) / 2).tolist()
        )
        assert steel.min() > 60 and np.ptp(steel) < 20
    corner = np.array(table.platform_m) / 2
    assert at(*(corner - 0.02)).max() > at(*(corner + 0.02)).max()
    assert complaints(browser) == []


def test_a_page_of_another_table_loads_again(serve, browser):
    server = serve(table=WIDE)
    visit(browser, f'http://127.0.0.1:{server.port}', '/table')
    server.routes.lattice = {**server.routes.lattice, 'rows': 2}
    server.routes.documents['lattice'] = wire.text(server.routes.lattice).encode()
    run(browser, 'window.before = true; eol.link.socket.close();')
    until_page(browser, '!window.before && eol.link.viewer')
    rows = 'return import("/static/lattice.js").then(({ROWS}) => ROWS)'
    assert run(browser, rows) == 2
