# SPDX-License-Identifier: Apache-2.0
"""A wall in a real Chromium, without a graph: the test sends what it shows."""

import time

import cv2
import numpy as np
import pytest
from support import needs
from support.chromium import (
    complaints,
    mouse,
    picture,
    press,
    reduced_motion,
    run,
    until_page,
    visit,
)
from support.waiting import wait_until

from eol_ros.devices.files.media_folder import LIST, Pictures

pytestmark = [pytest.mark.slow, needs.marker('chromium', 'chromium-driver')]
PICTURES = [f'{k}.png' for k in range(8)]


@pytest.fixture
def show(tmp_path, serve, browser):
    """Return a function that opens a wall before the first picture and waits until it is shown."""
    for k, name in enumerate(PICTURES):  # of 16:9
        noise = np.random.default_rng(k).integers(0, 255, (90, 160, 3), np.uint8)
        cv2.imwrite(str(tmp_path / name), noise)
    pairs = [f'{k}.png,{k + 1}.png' for k in range(0, 8, 2)]
    (tmp_path / LIST).write_text('\n'.join(['left,right', *pairs]))
    server = serve(Pictures(str(tmp_path)).file)
    wall = {
        't': 'wall', 'change': 1, 'left': '0.png', 'right': '1.png', 'ahead': PICTURES[2:],
        'caption': 'Ice | Sea', 'caption_zh': '冰｜海', 'credit': 'Echoes of the Land',
        'moving': False, 'flip': 0, 'fade': 0, 'looks': {},
    }  # fmt: skip
    server.hub.put('notices', wall, sticky='wall')

    def open_it(path, width=640, height=360):
        visit(browser, f'http://127.0.0.1:{server.port}', path, width, height)
        until_page(browser, 'eol.view.shows && !eol.view.pending')

    return open_it


def test_a_picture_is_cut_around_its_focus_or_shown_whole(show, browser):
    show('/wall/left', 640, 640)
    placed = """
        const {view} = eol, name = view.shows, {prototype} = CanvasRenderingContext2D;
        const {drawImage} = prototype;
        const found = [];
        prototype.drawImage = (image, ...place) => found.push(place.map(Math.round));
        const looks = [['cover', 0.5, 0.5], ['cover', 0, 0.5], ['cover', 1, 0], ['contain', 0, 0]];
        for (const look of looks) {
          view.looks = {[name]: look};
          view.paint(view.front, name);
        }
        prototype.drawImage = drawImage;
        return found;
    """
    assert run(browser, placed) == [
        [-249, 0, 1138, 640], [0, 0, 1138, 640], [-498, 0, 1138, 640], [0, 140, 640, 360],
    ]  # fmt: skip
    press(browser, 'c')
    until_page(browser, '!document.getElementById("caption").hidden')
    words = run(browser, 'return [...document.querySelectorAll("#caption span")]'
                         '.map((e) => e.textContent)')  # fmt: skip
    assert words == ['Ice | Sea', '冰｜海', 'Echoes of the Land']


def test_the_corners_of_a_projection_are_dragged_and_kept(show, browser):
    where = '/wall/left?screen=north'
    corners = """
        const shown = document.getElementById('wall');
        const map = new DOMMatrix(getComputedStyle(shown).transform);
        return [[0, 0], [1, 0], [1, 1], [0, 1]].map(([x, y]) => {
          const p = map.transformPoint(new DOMPoint(x * innerWidth, y * innerHeight));
          return [p.x / p.w, p.y / p.w];
        });
    """
    show(where, 800, 400)
    press(browser, 'k')
    until_page(browser, '!document.getElementById("pins").hidden')
    # Handles lie whole within the window, and a corner goes as far as its handle is dragged.
    handle = 'const {x, y, right, bottom} = document.querySelector("[data-corner=\\"1\\"]")'
    handle += '.getBoundingClientRect(); return [x, y, right, bottom]'
    assert run(browser, handle) == [756, 0, 800, 44]
    for kind, x, y, buttons in (
        ('mousePressed', 770, 30, 1), ('mouseMoved', 600, 300, 1), ('mouseMoved', 670, 70, 1),
        ('mouseReleased', 670, 70, 0),
    ):  # fmt: skip
        mouse(browser, kind, x, y, buttons)
    assert run(browser, 'return String(getSelection())') == ''  # no words were selected on the way
    run(browser, 'document.querySelector("[data-corner=\\"3\\"]").focus()')
    stroke = "new KeyboardEvent('keydown', {key: 'ArrowUp', shiftKey: true})"
    run(browser, f'document.activeElement.dispatchEvent({stroke})')
    expected = [[0, 0], [700, 40], [800, 400], [0, 390]]
    assert np.allclose(run(browser, corners), expected, atol=0.5)
    slider = 'document.querySelectorAll("#pins input[type=range]")[0]'
    run(browser, f'{slider}.value = 0.2; {slider}.oninput()')
    run(browser, 'document.querySelector("#pin-form button:last-of-type").click()')
    until_page(browser, 'document.getElementById("pin-words").textContent === "done"')
    show(where, 800, 400)
    until_page(browser, 'eol.pin.place.edges[0] === 0.2')
    assert np.allclose(run(browser, corners), expected, atol=0.5)
    wait_until(lambda: picture(browser).std() > 5)
    shot = picture(browser).astype(float)
    assert shot[:15, 780:].max() < 8  # outside of the four corners
    assert shot[100:300, :4].mean() < 0.3 * shot[100:300, 170:200].mean()  # and soft on the left
    show('/wall/left', 800, 400)  # another screen
    assert run(browser, 'return document.getElementById("wall").style.transform') == ''


def test_the_test_card_tells_greys_apart_and_flashes_by_the_second(show, browser):
    show('/wall/right', 960, 540)
    press(browser, 't')
    until_page(browser, '!document.getElementById("card").hidden')
    greys = """
        const card = document.getElementById('card'), {width, height} = card;
        const {data} = card.getContext('2d').getImageData(0, Math.round(0.79 * height), width, 1);
        const middles = Array.from({length: 16}, (_, i) => 0.1 + 0.05 * (i + 0.5));
        return middles.map((share) => data[4 * Math.round(width * share)]);
    """
    assert run(browser, greys) == [17 * i for i in range(16)]
    sync = 'document.getElementById("sync").hidden'
    until_page(browser, f'!{sync} && eol.link.now() % 1 < 0.2')
    until_page(browser, f'{sync} && eol.link.now() % 1 > 0.1')
    press(browser, 't')
    until_page(browser, f'document.getElementById("card").hidden && {sync}')


def test_a_wall_without_a_server_keeps_its_pair_and_fades_to_black(show, browser):
    """The minute is 1 s here (`?lost=1`); the connection is cut in the page itself."""
    show('/wall/right?lost=1')
    wait_until(lambda: picture(browser).std() > 5)
    cut = 'eol.opening = eol.link.open; eol.link.open = () => {}; eol.link.socket.close();'
    run(browser, cut)
    kept = 'const wall = document.getElementById("wall");'
    kept += 'return [eol.link.age(), wall.classList.contains("lost")];'
    looked = 0
    while (found := run(browser, kept))[0] < 0.6:  # until then the pair stands
        assert not found[1]
        looked += 1
        assert picture(browser).std() > 5 or run(browser, kept)[0] > 0.6
    assert looked
    wait_until(lambda: picture(browser).max() < 8)
    assert run(browser, 'return document.body.innerText.trim()') == ''
    run(browser, 'eol.link.open = eol.opening; eol.link.open();')
    wait_until(lambda: picture(browser).std() > 5)


def test_walls_change_slowly_where_quick_changes_are_unwelcome(show, browser):
    with reduced_motion(browser):
        show('/wall/left')
        change = 'const [left] = eol.view.ahead.splice(0, 1); eol.link.emit("wall", {change:'
        change += ' arguments[0], left, right: "x", flip: 0, moving: true, fade: 0, ahead:'
        change += ' eol.view.ahead.flatMap((name) => [name, "x"])});'
        count = run(browser, 'eol.view.lastFlip -= 4000; return eol.flips.length')
        for number in (1, 2, 3):  # the second is passed over: the third has come meanwhile
            run(browser, change, 1000 + number)
            if number == 1:
                until_page(browser, f'eol.flips.length > {count}')
        until_page(browser, f'eol.flips.length > {count + 1}')
        flips = run(browser, f'return eol.flips.slice({count})')
        assert [number for number, _ in flips] == [1001, 1003]
        assert flips[1][1] - flips[0][1] >= 3990
        fades = run(browser, 'return eol.view.layers[eol.view.front].style.transition')
        assert '1.5s' in fades


def test_walls_fade_into_sleep_and_out_of_it_as_slowly_as_the_light(show, browser):
    show('/wall/left')
    opacity = 'Number(getComputedStyle(eol.view.holder).opacity)'
    run(browser, 'eol.name = eol.view.shows;'
        'eol.link.emit("health", {node: "leds", values: {sleep_fade_s: 3}})')  # fmt: skip
    tell = 'eol.link.emit("wall", {change: arguments[0], left: arguments[1], right: "", ahead: [],'
    tell += ' flip: eol.link.now(), moving: false, fade: 0})'
    begun = time.monotonic()
    run(browser, tell, 10_001, '')
    half = until_page(browser, f'{opacity} < 0.5')
    assert half and time.monotonic() - begun > 1.3
    assert run(browser, 'return eol.view.shows === eol.name')  # the picture, not yet black
    run(browser, tell, 10_002, run(browser, 'return eol.name'))  # woken half-way
    until_page(browser, f'{opacity} === 1')
    assert run(browser, 'return eol.view.shows === eol.name')
    run(browser, tell, 10_003, '')
    until_page(browser, f'{opacity} === 0 && !eol.view.shows')
    assert time.monotonic() - begun > 3
    run(browser, 'eol.link.emit("health", {node: "leds", values: {sleep_fade_s: 0}})')
    begun = time.monotonic()
    run(browser, tell, 10_004, run(browser, 'return eol.name'))
    until_page(browser, f'{opacity} === 1 && eol.view.shows === eol.name')
    assert time.monotonic() - begun > 1.9
    assert complaints(browser) == []
