# SPDX-License-Identifier: Apache-2.0
"""Every page at every size, in both languages and in each state of the work, on sheets to look at.

    python -m assets.screens            some eight minutes; writes build/screens/STATE-LANGUAGE.png
    python -m assets.screens --panel    writes docs/img/panel.png, and no sheet

A row of a sheet is a page in its whole length, a column a size; a pixel is a pixel of the screen.
The program prints what it finds, with exit code 1: findings of axe-core, small text, small controls
on a touch screen, text that is cut off, words of another language, a page wider than its screen.
Needs chromium and chromedriver.
"""

import argparse
import base64
import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image
from selenium.common import WebDriverException
from support import chromium
from support.chromium import barriers, healthy, status

from benchmarks.web_browser import start as start_browser
from benchmarks.web_browser import wait
from eol_ros.bringup import priority
from eol_ros.errors import EolError
from eol_ros.verbs.progress import track
from eol_ros.web.routes import PAGES

ROOT = Path(__file__).resolve().parents[1]
SIZES = (1920, 1080), (1440, 800), (1280, 720), (820, 1180), (390, 844), (360, 740)
TOUCH_PX = 820  # screens up to this width are touched
LANGUAGES = ('en', 'zh-Hant')
STATES = {  # with the requests that lead there from the one before
    'starting': [],  # the panel alone: it waits for the others
    'awake': ['wake', 'unmute'],
    'test': ['test'],
    'muted': ['mute'],
    'asleep': ['unmute', 'sleep'],
    'stale': ['wake'],  # each page then loses its connection: CUT
}
# Makes all data of a page 7 s old, and ends its connection.
CUT = """
eol.link.open = () => {};
eol.link.socket.close();
for (const kind of Object.keys(eol.link.heard)) eol.link.heard[kind] -= 7000;
"""
SPEAK = """
const [name, done] = arguments;
import('/static/i18n.js').then(({speak}) => speak(name)).then(() => setTimeout(done, 1100));
"""
PAINTED = """
const done = arguments[0];
requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 300)));
"""
READY = {  # conditions that hold once a page has all its data
    '/': 'document.querySelector("#camera canvas").dataset.images > 5'
    ' && document.querySelector("#space canvas").dataset.grains > 0'
    ' && document.querySelectorAll("#nodes li").length > 7',
    '/table': 'eol.drawing.land && eol.counts.packets > 5',
    '/about': '!document.querySelector("dd.unknown")',
    '/remote': 'document.querySelectorAll("#nodes li").length > 7',
    '/wall/left': 'eol.view.shows || eol.link.work.code.startsWith("asleep")',
    '/wall/right': 'eol.view.shows || eol.link.work.code.startsWith("asleep")',
}
AXE_SIZES = (1280, 720), (390, 844)  # one of each layout
# What is wrong with a page, by kind: texts smaller than `least` px, controls smaller than 44 px ...
LOOK = r"""
const [least, touch] = arguments;
const { lang } = document.documentElement;
const style = (e) => getComputedStyle(e);
const all = (what) => [...document.querySelectorAll(what)].filter((e) =>
  e.getClientRects().length && style(e).visibility !== 'hidden' && !e.matches('.unseen, .skip'));
const texts = all('body *:not(script, style)').filter((e) =>
  [...e.childNodes].some((n) => n.nodeType === Node.TEXT_NODE && n.data.trim()));
const controls = !touch ? [] : [...document.querySelectorAll('a, button, input, select')]
  .filter((e) => e.getClientRects().length && !e.matches('.skip'));
const names = (found) => found.map((e) => (e.id || e.textContent).trim().slice(0, 40));
const wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
return {
  'small text': names(texts.filter((e) => parseFloat(style(e).fontSize) < least)),
  'cut off': names(texts.filter((e) => style(e).overflowX !== 'visible' && e.clientWidth
    && style(e).textOverflow !== 'ellipsis' && e.scrollWidth > e.clientWidth + 1)),
  'small control': names(controls.filter((e) => {
    const {width, height} = e.getBoundingClientRect();
    return width < 44 || height < 44;
  })),
  'wider than the screen': wide > 0 ? [`${wide} px`] : [],
  'another language': names(texts.filter((e) => e.closest('[lang]').lang === lang
    && (lang === 'en' ? /[\u4e00-\u9fff]/ : /[a-z]{2} [a-z]{2}/)
      .test(e.textContent.replace('Echoes of the Land', '')))),
};
"""


def main(argv: list[str] | None = None) -> int:
    """Run the work, look at it; return 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=Path, default=ROOT / 'build' / 'screens')
    parser.add_argument('--states', nargs='+', choices=STATES, default=list(STATES))
    parser.add_argument('--panel', action='store_true', help='write only docs/img/panel.png')
    args = parser.parse_args(argv)
    args.output.mkdir(parents=True, exist_ok=True)
    wrong: dict[str, set[str]] = {}
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        contextlib.ExitStack() as ending,
    ):
        try:
            browser = start_browser(Path(folder) / 'profile')
            ending.callback(browser.quit)
            browser.set_script_timeout(60)
            browser.set_page_load_timeout(60)
            if args.panel:
                return draw_panel(browser, begin(Path(folder), ending))
            states = sorted(args.states, key=list(STATES).index)
            address = ''
            sheets: dict[str, list[list[np.ndarray]]] = {}
            for state, path in track(list(itertools.product(states, PAGES)), 'pages'):
                with contextlib.ExitStack() as alone:
                    if state == 'starting':
                        at = begin(Path(folder), alone, only_panel=True)
                    else:
                        at = address = address or begin(Path(folder), ending)
                        if path == next(iter(PAGES)):
                            lead_to(address, state)
                    for language, row in row_of(browser, at, path, state, wrong).items():
                        name = f'{state}-{language}'
                        sheets.setdefault(name, []).append(row)
                        if len(sheets[name]) == len(PAGES):
                            png = str(args.output / f'{name}.png')
                            cv2.imwrite(png, joined(sheets.pop(name)))
        except (EolError, OSError, WebDriverException) as error:
            log = Path(folder) / 'log'
            said = log.read_text()[-2000:] if log.exists() else ''
            print(f'{said}no screens: {error}', file=sys.stderr)
            return 1
    for what, where in sorted(wrong.items()):
        print(f'{what}: {"; ".join(sorted(where))}')
    print(args.output)
    return bool(wrong)


def joined(rows: list[list[np.ndarray]]) -> np.ndarray:
    """Return rows of pictures, as wide in each row, as one picture."""
    found = []
    for row in rows:
        high = max(map(len, row))
        found.append(np.hstack([np.pad(p, ((0, high - len(p)), (0, 0), (0, 0))) for p in row]))
    return np.vstack(found)


def begin(folder: Path, ending: contextlib.ExitStack, only_panel: bool = False) -> str:
    """Start a rehearsal that nobody touches, or its panel; return the address of its panel."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    scene = folder / 'screens.yaml'
    nodes = {
        'panel': {'port': port}, 'recorder': 'off', 'sound': {'device': 'wav', 'wav': ''},
        'twin': {'fps': 20},  # leaves the browser more processor time
    }  # fmt: skip
    scene.write_text(json.dumps({'scene': 'screens', 'include': 'rehearsal', 'nodes': nodes}))
    module = ['eol_ros.nodes', 'panel', '--scene'] if only_panel else ['eol_ros.bringup']
    log = (folder / 'log').open('a')
    ending.callback(log.close)
    work = subprocess.Popen(
        [sys.executable, '-m', *module, str(scene)], cwd=folder,
        stdout=log, stderr=log,
        env=os.environ | {'EOL_STATE': str(folder / 'state')},
    )  # fmt: skip
    ending.callback(work.wait, 60)
    ending.callback(work.send_signal, signal.SIGINT)
    address, end = f'http://127.0.0.1:{port}', time.monotonic() + 1200  # it may compile first
    awaited = {'panel'} if only_panel else {'tracker', 'sound', 'montage'}
    while not healthy(address) >= awaited:
        if work.poll() is not None or time.monotonic() > end:
            raise EolError('the rehearsal did not start')
        time.sleep(0.5)
    return address


def lead_to(address: str, state: str) -> None:
    """Request a state, from the one before."""
    for control in STATES[state]:
        ask(address, control)


def ask(address: str, control: str) -> None:
    """Ask for what a button of the panel asks for; what is refused shows as another state."""
    request = urllib.request.Request(
        f'{address}/control/{control}', b'{}', {'Content-Type': 'application/json'}
    )
    for _ in range(3):
        with contextlib.suppress(OSError):  # a busy node answers late
            urllib.request.urlopen(request, timeout=20).read()
            return
        time.sleep(5)


def row_of(
    browser: Any, address: str, path: str, state: str, wrong: dict[str, set[str]]
) -> dict[str, list[np.ndarray]]:
    """Return pictures of a page by language, one a size; black ones if three tries fail.

    On a busy machine bringup may restart the panel, or a state come late.
    """
    for _ in range(3):
        try:
            hasten(address)
            return look_at(browser, address, path, state, wrong)
        except (EolError, OSError, WebDriverException) as error:
            why = str(error).split('\n')[0]
            time.sleep(10)
    wrong.setdefault(f'no picture, {path}', set()).add(f'{why} ({state})')
    black = [np.zeros((height, width, 3), np.uint8) for width, height in SIZES]
    return dict.fromkeys(LANGUAGES, black)


def hasten(address: str) -> None:
    """Raise the panel's low priority: beside Chromium, run by root, it would starve."""
    if panel := status(address).get('panel'):
        priority.step_back(int(panel['pid']), -8)


def look_at(
    browser: Any, address: str, path: str, state: str, wrong: dict[str, set[str]]
) -> dict[str, list[np.ndarray]]:
    """Return pictures of a page by language, one a size; note what is wrong with it."""
    resize(browser, *SIZES[0])
    browser.get(address + path)
    if state != 'test':
        wait(browser, f'eol.link.work.code.startsWith("{"awake" if state == "stale" else state}")')
    if state != 'starting':
        wait(browser, READY[path])
    if state == 'stale':
        browser.execute_script(CUT)
    found = {}
    for language in LANGUAGES:
        browser.execute_async_script(SPEAK, language)
        found[language] = [look(browser, address, path, state, size, wrong) for size in SIZES]
    return found


def look(
    browser: Any, address: str, path: str, state: str, size: tuple[int, int],
    wrong: dict[str, set[str]],
) -> np.ndarray:  # fmt: skip
    """Return a picture of the open page in a size; note what is wrong with it."""
    touch = resize(browser, *size)
    code = 'return eol.link.work.code'
    if state == 'test' and browser.execute_script(code) != state:
        ask(address, 'test')  # a test ends by itself
        wait(browser, 'eol.link.work.code === "test"')
    browser.execute_async_script(PAINTED)
    faults = browser.execute_script(LOOK, 14 if path == '/table' else 12, touch)
    if state != 'stale' and not (now := browser.execute_script(code)).startswith(state):
        faults['another state'] = [now]
    if size in AXE_SIZES:
        faults['axe-core'] = barriers(browser)
    for what, names in faults.items():
        for name in names:
            wrong.setdefault(f'{what}, {path}', set()).add(f'{name} ({state}, {size[0]})')
    return picture(browser, *size)


def resize(browser: Any, width: int, height: int) -> bool:
    """Set the size of the browser's screen in px; return whether it is a touch screen."""
    touch = width <= TOUCH_PX
    chromium.resize(browser, width, height, touch)
    browser.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': touch})
    return touch


def picture(browser: Any, width: int, height: int) -> np.ndarray:
    """Return a picture of the page in its whole length."""
    high = browser.execute_script('return document.documentElement.scrollHeight')
    if high > height:  # a capture beyond the screen does not lay out and paint it
        resize(browser, width, high)
        browser.execute_async_script(PAINTED)
    asked = {'optimizeForSpeed': True}
    png = base64.b64decode(browser.execute_cdp_cmd('Page.captureScreenshot', asked)['data'])
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def draw_panel(browser: Any, address: str) -> int:
    """Write docs/img/panel.png, 1920 x 1080: the panel while many blocks slip."""
    hasten(address)
    resize(browser, *SIZES[0])
    browser.get(address)
    wait(browser, READY['/'])
    wait(browser, 'document.getElementById("law").dataset.total > 20', 300)
    moving = 'parseInt(document.getElementById("moving-count").textContent) > 3'
    good = '!document.querySelector("#nodes [data-level=silent], #nodes [data-level=error]")'
    fresh = 'eol.link.now() - eol.camera.stamp < 0.3'
    wait(browser, f'{good} && {fresh} && {moving}', 300)
    png = ROOT / 'docs' / 'img' / 'panel.png'
    Image.fromarray(picture(browser, *SIZES[0])[..., ::-1]).quantize(256).save(png, optimize=True)
    print(png)
    return 0


if __name__ == '__main__':
    sys.exit(main())
