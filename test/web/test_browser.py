# SPDX-License-Identifier: Apache-2.0
"""The pages in a real Chromium, against the whole work running: what visitors and operators meet.

One graph and one browser serve all tests, in order; the last one ends the graph. EOL_SHOTS names a
folder for the screenshots, to be looked at.
"""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

webdriver = pytest.importorskip('selenium.webdriver')
BROWSER, DRIVER = shutil.which('chromium'), shutil.which('chromedriver')
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (BROWSER and DRIVER), reason='needs chromium and chromedriver'),
]
FLAGS = (
    '--headless=new',
    '--no-sandbox',
    '--disable-gpu',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--hide-scrollbars',
    '--mute-audio',
    '--autoplay-policy=no-user-gesture-required',
    '--disable-backgrounding-occluded-windows',
    '--disable-renderer-backgrounding',
    '--disable-background-timer-throttling',
)
SCENE = """
scene: browser
nodes:
  twin: {{hands: nobody}}
  tracker: {{}}
  motion: {{}}
  leds: {{port: twin}}
  grains: {{}}
  sound: {{device: wav, wav: {folder}/sound.wav}}
  montage: {{}}
  panel: {{port: {port}}}
"""


@pytest.fixture(scope='module')
def graph(tmp_path_factory):
    """The work without hands: whatever moves was moved by the tests. Yields the panel's address."""
    folder = tmp_path_factory.mktemp('graph')
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    scene = folder / 'browser.yaml'
    scene.write_text(SCENE.format(folder=folder, port=port))
    log = (folder / 'log').open('w')
    work = subprocess.Popen(
        [sys.executable, '-m', 'eol_ros.bringup', str(scene)], stdout=log, stderr=log, cwd=folder
    )
    address = f'http://127.0.0.1:{port}'
    try:
        wanted = {'twin', 'tracker', 'motion', 'leds', 'grains', 'sound', 'montage', 'panel'}
        until(
            lambda: work.poll() is not None or wanted <= healthy(address),
            90,
            lambda: (folder / 'log').read_text(),
        )
        assert work.poll() is None, (folder / 'log').read_text()
        yield address, work
    finally:
        if work.poll() is None:
            work.send_signal(signal.SIGINT)
            work.wait(20)


def healthy(address):
    """Return the names of the nodes that say they do their work."""
    try:
        with urllib.request.urlopen(f'{address}/status', timeout=2) as answer:
            return {n for n, s in json.load(answer).items() if s['level'] in ('ok', 'warn')}
    except OSError:
        return set()


@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f'--user-data-dir={tmp_path_factory.mktemp("profile")}'):
        options.add_argument(flag)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    driver = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
    driver.set_script_timeout(30)
    yield driver
    driver.quit()


def until(what, seconds=10.0, why=lambda: 'it did not come about'):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = what()
        if found:
            return found
        time.sleep(0.05)
    pytest.fail(why())


def visit(browser, address, path, width=1280, height=800):
    browser.execute_cdp_cmd(
        'Emulation.setDeviceMetricsOverride',
        {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': False},
    )
    browser.get(address + path)
    ready = 'return location.pathname.startsWith("/wall") || Boolean(window.eol)'
    until(lambda: browser.execute_script(ready))


def complaints(browser):
    """Return what the console says of errors since the last look."""
    return [e['message'] for e in browser.get_log('browser') if e['level'] == 'SEVERE']


def picture(browser, name=''):
    """Return a screenshot as an array, and keep it where EOL_SHOTS says."""
    png = browser.get_screenshot_as_png()
    if os.environ.get('EOL_SHOTS') and name:
        Path(os.environ['EOL_SHOTS'], f'{name}.png').write_bytes(png)
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def mouse(browser, kind, x, y, buttons=1):
    browser.execute_cdp_cmd(
        'Input.dispatchMouseEvent',
        {'type': kind, 'x': x, 'y': y, 'button': 'left', 'buttons': buttons, 'clickCount': 1},
    )


@pytest.mark.parametrize('width', [360, 1280, 3840])
@pytest.mark.parametrize('path', ['/', '/table', '/wall/left', '/wall/right'])
def test_pages_fill_every_screen(graph, browser, path, width):
    address, _ = graph
    height = {360: 740, 1280: 800, 3840: 2160}[width]
    visit(browser, address, path, width, height)
    if path == '/':
        until(
            lambda: browser.execute_script(
                'return document.querySelector("#camera canvas").dataset.images > 0'
                ' && document.querySelector("#space canvas").dataset.grains > 0'
            ),
            20,
        )
        full = browser.execute_script('return document.documentElement.scrollHeight')
        visit(browser, address, path, width, max(full, height))
        until(
            lambda: browser.execute_script(
                'return document.querySelector("#camera canvas").dataset.images > 0'
            ),
            20,
        )
        time.sleep(0.6)
    elif path == '/table':
        until(
            lambda: browser.execute_script(
                'return eol.counts.packets > 5 && eol.drawing.land && eol.counts.flips > 1'
            ),
            20,
        )
        time.sleep(0.3)
    else:
        until(
            lambda: browser.execute_script(
                'return document.getElementById("wall").dataset.picture'
            ),
            20,
        )
        time.sleep(0.2)
    shot = picture(browser, f'{path.strip("/").replace("/", "-") or "panel"}-{width}')
    assert complaints(browser) == []
    overflow = 'return document.documentElement.scrollWidth - document.documentElement.clientWidth'
    assert browser.execute_script(overflow) <= 0
    # Structure: something is drawn in every ninth of a wall, in every canvas of the panel.
    assert shot.shape[1] == width
    if path == '/':
        for box in browser.execute_script(CANVASES):
            part = shot[box['y'] : box['y'] + box['h'], box['x'] : box['x'] + box['w']]
            assert part.size and part.std() > 1.5, box
    else:
        rows, columns = (
            np.array_split(np.arange(shot.shape[0]), 3),
            np.array_split(np.arange(width), 3),
        )
        for r in rows:
            for c in columns:
                assert shot[r[0] : r[-1], c[0] : c[-1]].std() > 0.8


CANVASES = """
return [...document.querySelectorAll('.card canvas')].filter((c) => c.offsetParent).map((c) => {
  const box = c.getBoundingClientRect();
  const round = Math.round;
  return {x: round(box.x), y: round(box.y + scrollY), w: round(box.width), h: round(box.height)};
});
"""


def test_a_drag_moves_lights_sounds_and_changes_the_pair(graph, browser):
    """End to end: hand -> rim -> slip -> flash, sound, walls, all in one browser."""
    address, _ = graph
    visit(browser, address, '/table')
    until(lambda: browser.execute_script('return eol.counts.packets > 30'), 20)
    browser.find_element('id', 'listen').click()
    until(lambda: browser.execute_script('return eol.listener.packets > 3'), 20)
    before = browser.execute_script(
        'return {rim: [...eol.state().rim], x: [...eol.state().x], ...eol.counts}'
    )
    now, heard = before, 0.0

    def look():
        nonlocal now, heard
        now = browser.execute_script(
            'const {rim, x} = eol.state();'
            'return {rim: [...rim], x: [...x], level: eol.listener.level, ...eol.counts}'
        )
        heard = max(heard, now['level'] or 0)
        return heard > 0.001 and all(now[k] > before[k] for k in ('slips', 'flashes', 'flips'))

    mouse(browser, 'mousePressed', 640, 400)
    for step in range(60):
        mouse(browser, 'mouseMoved', 640 + 2.5 * step, 400 + 0.8 * step)
        time.sleep(0.03)
        look()
    mouse(browser, 'mouseReleased', 787, 447, 0)
    until(look, 15, lambda: f'from {before} to {now}, heard {heard}')
    assert now['rim'][0] - before['rim'][0] > 0.15  # 147 px are 0.31 m at 470 px/m
    assert max(b - a for a, b in zip(before['x'], now['x'], strict=True)) > 0.02
    assert complaints(browser) == []


def test_keys_and_two_fingers_turn_the_rim(graph, browser):
    address, _ = graph
    visit(browser, address, '/table')
    until(lambda: browser.execute_script('return eol.counts.packets > 30'), 20)
    yaw = 'return eol.state().rim[2]'
    start = browser.execute_script(yaw)
    key = {'key': 'q', 'code': 'KeyQ', 'text': 'q', 'windowsVirtualKeyCode': 81}
    browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyDown', **key})
    until(lambda: browser.execute_script(yaw) > start + 0.05)
    browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyUp', **key})
    time.sleep(0.5)
    turned = browser.execute_script(yaw)

    def touch(kind, *points):
        browser.execute_cdp_cmd(
            'Input.dispatchTouchEvent',
            {
                'type': kind,
                'touchPoints': [{'x': x, 'y': y, 'id': i} for i, (x, y) in enumerate(points)],
            },
        )

    touch('touchStart', (560, 400))
    touch('touchStart', (560, 400), (720, 400))
    for step in range(25):  # turn clockwise about the middle
        a = -0.012 * step
        dx, dy = 80 * np.cos(a), -80 * np.sin(a)
        touch('touchMove', (640 - dx, 400 - dy), (640 + dx, 400 + dy))
        time.sleep(0.03)
    until(lambda: browser.execute_script(yaw) < turned - 0.05)
    touch('touchEnd')


def test_walls_never_flash_and_change_together(graph, browser):
    """Shuffle for 4 s by pushing, and count in the captured pictures, as WCAG 2.3.1 does."""
    address, _ = graph
    visit(browser, address, '/table')
    until(lambda: browser.execute_script('return eol.counts.packets > 30'), 20)
    flips = browser.execute_async_script(SAMPLE_WALLS)
    times, light = np.array(flips['times']), np.array(flips['light'])
    changes = np.array(flips['flips'])
    assert len(changes) >= 4 and len(times) > 40
    assert np.diff(changes).min() > 330
    assert light.min() > 0.002  # never black between
    # A flash is a pair of opposing changes of 10 % or more of full luminance.
    turns = []
    held = light[0]
    for t, value in zip(times, light, strict=True):
        if abs(value - held) >= 0.1:
            turns.append(t)
            held = value
    assert all(sum(t <= u < t + 1000 for u in turns) // 2 <= 3 for t in turns)


SAMPLE_WALLS = """
const done = arguments[arguments.length - 1];
const wall = eol.walls[0];
const small = new OffscreenCanvas(64, 36).getContext('2d', {willReadFrequently: true});
const linear = (c) => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
const times = [], light = [], flips = [];
const old = wall.onflip;
wall.onflip = (next, now) => { flips.push(now); old(next, now); };
const begin = performance.now();
let turn = 1;
const push = setInterval(() => {
  eol.link.send({rim: [0.12 * Math.sign(Math.sin((performance.now() - begin) / 500)), 0, 0]});
}, 40);
const look = setInterval(() => {
  small.drawImage(wall.layers[wall.front], 0, 0, 64, 36);
  const {data} = small.getImageData(0, 0, 64, 36);
  let sum = 0;
  for (let i = 0; i < data.length; i += 4) {
    sum += 0.2126 * linear(data[i]) + 0.7152 * linear(data[i + 1]) + 0.0722 * linear(data[i + 2]);
  }
  times.push(performance.now());
  light.push(sum / (64 * 36));
  if (performance.now() - begin > 5000) {
    clearInterval(push);
    clearInterval(look);
    done({times, light, flips});
  }
}, 33);
"""


def test_both_walls_in_one_browser_change_within_an_image(graph, browser):
    address, _ = graph
    visit(browser, address, '/wall/left', 640, 360)
    first = browser.current_window_handle
    browser.switch_to.new_window('window')
    second = browser.current_window_handle
    try:
        visit(browser, address, '/wall/right', 640, 360)
        shown = (
            'const {change, picture} = document.getElementById("wall").dataset;'
            'return [change, picture];'
        )
        until(lambda: browser.execute_script(shown)[0], 20)
        right = browser.execute_script(shown)
        browser.switch_to.window(first)
        until(lambda: browser.execute_script(shown)[0] == right[0], 20)
        left = browser.execute_script(shown)
        assert left[1].replace('left', '') == right[1].replace('right', '')
        card = {'key': 't', 'code': 'KeyT', 'text': 't'}
        browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyDown', **card})
        until(lambda: browser.execute_script('return !document.getElementById("card").hidden'))
        assert picture(browser, 'card').std() > 20
    finally:
        browser.switch_to.window(second)
        browser.close()
        browser.switch_to.window(first)


def test_the_panel_by_keyboard_alone(graph, browser):
    address, _ = graph
    visit(browser, address, '/')
    until(
        lambda: browser.execute_script(
            'return document.querySelector("#space canvas").dataset.grains > 0'
        ),
        20,
    )
    count = browser.execute_script(FOCUSABLE)
    seen = []
    tab = {'key': 'Tab', 'code': 'Tab', 'windowsVirtualKeyCode': 9}
    for _ in range(count + 3):
        browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyDown', **tab})
        seen.append(browser.execute_script(FOCUSED))
    names = {s['name'] for s in seen if s}
    assert all(s['name'] and s['ring'] for s in seen if s), [s for s in seen if s and not s['name']]
    for name in ('Sleep', 'Wake', 'Threshold', 'Listen here', 'Table', 'Reach', '中文'):
        assert name in names
    assert len({s['at'] for s in seen if s}) == count
    # Keys of the picture, and Enter on a control.
    for key, view in (('t', 'threshold'), ('n', 'off'), ('s', 'source')):
        browser.execute_script('document.activeElement.blur()')
        stroke = {'key': key, 'code': f'Key{key.upper()}', 'text': key}
        browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyDown', **stroke})
        until(
            lambda view=view: (
                browser.execute_script(
                    'return document.querySelector("#camera canvas").dataset.view'
                )
                == view
            )
        )
    for name, asleep in (('sleep', 'true'), ('wake', 'false')):
        browser.execute_script(f'document.querySelector("[data-control={name}]").focus()')
        enter = {'key': 'Enter', 'code': 'Enter', 'text': '\r', 'windowsVirtualKeyCode': 13}
        browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyDown', **enter})
        browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyUp', **enter})
        until(
            lambda asleep=asleep: (
                browser.execute_script('return document.getElementById("live").dataset.asleep')
                == asleep
            )
        )


FOCUSABLE = """
return [...document.querySelectorAll('a, button, input, select, [tabindex="0"]')]
  .filter((e) => !e.disabled && e.getClientRects().length && e.tabIndex >= 0).length;
"""
FOCUSED = """
const e = document.activeElement;
if (e === document.body) return null;
const label = e.closest('label');
const by = e.getAttribute('aria-labelledby');
return {
  name: e.getAttribute('aria-label') || (by && document.getElementById(by).textContent)
    || (label && label.textContent.trim().replace(/[0-9]+ mm$/, '')) || e.textContent.trim(),
  ring: getComputedStyle(e).outlineStyle !== 'none',
  at: [...document.querySelectorAll('*')].indexOf(e),
};
"""


def test_both_languages(graph, browser):
    address, _ = graph
    visit(browser, address, '/')
    texts = {}
    for name in ('zh-Hant', 'en'):
        browser.find_element('css selector', f'[data-language={name}]').click()
        until(
            lambda name=name: browser.execute_script('return document.documentElement.lang') == name
        )
        time.sleep(0.5)
        texts[name] = browser.execute_script(
            'return [...document.querySelectorAll("[data-say]")]'
            '.map((e) => [e.dataset.say, e.textContent])'
        )
        picture(browser, f'panel-{name}')
    assert [key for key, text in texts['en'] if not text or '_' in text] == []
    same = [k for (k, a), (_, b) in zip(texts['en'], texts['zh-Hant'], strict=True) if a == b]
    assert same == []
    assert complaints(browser) == []


def test_reduced_motion_stills_flashes_and_waves(graph, browser):
    address, _ = graph
    feature = {'name': 'prefers-reduced-motion', 'value': 'reduce'}
    browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': [feature]})
    try:
        visit(browser, address, '/table')
        still = """
            const {waves, brush} = eol.drawing;
            eol.drawing.slip(12, 1, performance.now());
            let arcs = 0;
            const arc = brush.arc;
            brush.arc = () => arcs++;
            eol.drawing.draw(performance.now(), eol.state(), new Uint8Array(25));
            brush.arc = arc;
            return [arcs, eol.drawing.waves.length];
        """
        until(lambda: browser.execute_script('return eol.counts.packets > 3'), 20)
        arcs, waves = browser.execute_script(still)
        assert arcs == 0 and waves > 0
        browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})
        arcs, waves = browser.execute_script(still)
        assert arcs == waves > 0
    finally:
        browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})


def test_a_wall_outlives_the_panel_and_takes_it_up_again(graph, browser):
    address, _ = graph
    visit(browser, address, '/wall/left', 640, 360)
    shown = 'return document.getElementById("wall").dataset.picture'
    name = until(lambda: browser.execute_script(shown), 20)
    time.sleep(0.3)
    before = picture(browser)
    with urllib.request.urlopen(f'{address}/status', timeout=5) as answer:
        os.kill(int(json.load(answer)['panel']['pid']), signal.SIGKILL)
    until(lambda: 'panel' not in healthy(address))
    time.sleep(0.5)
    assert np.array_equal(picture(browser), before)  # the last pair, and not one word
    assert browser.execute_script('return document.body.innerText.trim()') == ''
    until(lambda: 'panel' in healthy(address), 40)
    # Asked again until it is heard: the new panel may not have met the montage yet.
    for command, seen in (('sleep', lambda p: p.max() < 8), ('wake', lambda p: p.std() > 5)):
        request = urllib.request.Request(f'{address}/control/{command}', data=b'{}')
        end = time.monotonic() + 40
        while not seen(picture(browser)):
            assert time.monotonic() < end, command
            urllib.request.urlopen(request, timeout=5).close()
            time.sleep(1.5)
    assert name


def test_silence_is_seen_within_three_seconds(graph, browser):
    """Last: the graph is killed under a page that shows it."""
    address, work = graph
    visit(browser, address, '/')
    until(
        lambda: browser.execute_script(
            'return document.querySelector("#camera canvas").dataset.images > 0'
        ),
        20,
    )
    assert browser.execute_script('return document.body.classList.contains("stale")') is False
    work.kill()
    work.wait(10)
    killed = time.monotonic()
    until(lambda: browser.execute_script('return document.body.classList.contains("stale")'), 10)
    assert time.monotonic() - killed < 3.5  # 3 s, and the time to ask
    bar = browser.find_element('id', 'stalebar')
    assert bar.is_displayed() and 'no data for' in bar.text
    decoration = browser.execute_script(
        'return getComputedStyle(document.querySelector("#coords td")).textDecorationLine'
    )
    assert decoration == 'line-through'
    picture(browser, 'panel-stale')
