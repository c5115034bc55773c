# SPDX-License-Identifier: Apache-2.0
"""Every page at every size, in both languages and in each state of the work, on sheets to look at.

    python -m assets.screens      some fifteen minutes; writes build/screens/STATE-LANGUAGE.png

A row of a sheet is a page in its whole length, a column a size; a pixel is a pixel of the screen.
What a machine can see is printed, with exit code 1:
small text, small controls on a touch screen, text that is cut off, a page wider than its screen.
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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from selenium.common import WebDriverException
from support.chromium import healthy

from benchmarks.web_browser import start as start_browser
from benchmarks.web_browser import wait
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
CUT = 'eol.link.open = () => {}; eol.link.socket.close();'
STALE_S = 7  # after which every page marks what it shows
READY = {
    '/': '#camera canvas',
    '/table': 'canvas',
    '/about': 'dd',
    '/remote': '#nodes li',
    '/wall/left': '#wall',
    '/wall/right': '#wall',
}
# What is wrong with a page, by kind: texts smaller than `least` px, controls smaller than 44 px ...
LOOK = """
const [least, touch] = arguments;
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
};
"""


def main(argv: list[str] | None = None) -> int:
    """Run the work, look at it; return 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=Path, default=ROOT / 'build' / 'screens')
    parser.add_argument('--states', nargs='+', choices=STATES, default=list(STATES))
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
            address = ''
            states = sorted(args.states, key=list(STATES).index)
            for state, language in track(list(itertools.product(states, LANGUAGES)), 'sheets'):
                if state != 'starting':
                    address = address or begin(Path(folder), ending)
                    lead_to(address, state)
                sheet = []
                for path in PAGES:
                    with contextlib.ExitStack() as alone:
                        at = address or begin(Path(folder), alone, only_panel=True)
                        sheet.append(row_of(browser, at, path, state, language, wrong))
                cv2.imwrite(str(args.output / f'{state}-{language}.png'), joined(sheet))
        except (EolError, OSError, WebDriverException) as error:
            print(f'no screens: {error}', file=sys.stderr)
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
    nodes = {'panel': {'port': port}, 'recorder': 'off', 'sound': {'device': 'wav', 'wav': ''}}
    scene.write_text(json.dumps({'scene': 'screens', 'include': 'rehearsal', 'nodes': nodes}))
    module = ['eol_ros.nodes', 'panel', '--scene'] if only_panel else ['eol_ros.bringup']
    work = subprocess.Popen(
        [sys.executable, '-m', *module, str(scene)], cwd=folder,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=os.environ | {'EOL_STATE': str(folder / 'state')},
    )  # fmt: skip
    ending.callback(work.wait, 60)
    ending.callback(work.send_signal, signal.SIGINT)
    address, end = f'http://127.0.0.1:{port}', time.monotonic() + 1200  # it may compile first
    awaited = {'panel'} if only_panel else {'tracker', 'sound', 'montage'}
    while not healthy(address) >= awaited:
        if work.poll() is not None or time.monotonic() > end:
            raise EolError('the rehearsal did not start: try `eol run rehearsal`')
        time.sleep(0.5)
    return address


def lead_to(address: str, state: str) -> None:
    """Bring the work into a state, from that before."""
    for control in STATES[state]:
        ask(address, control)
    time.sleep(4)


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


def row_of(*row: Any) -> list[np.ndarray]:
    """Return pictures of a page, one a size, at the third try at last.

    On a busy machine bringup may restart the panel, or a state come late.
    """
    for _ in range(2):
        with contextlib.suppress(EolError, OSError, WebDriverException):
            return list(look_at(*row))
        time.sleep(15)
    return list(look_at(*row))


def look_at(
    browser: Any, address: str, path: str, state: str, language: str, wrong: dict[str, set[str]]
) -> Iterator[np.ndarray]:
    """Yield pictures of a page, one a size; note what is wrong with it."""
    browser.get(address + path)
    browser.execute_script(f"localStorage.setItem('language', '{language}')")
    browser.refresh()
    wait(browser, f"eol.link.viewer && document.querySelector('{READY[path]}')")
    if state == 'stale':
        time.sleep(2)  # there is something to show, which gets old
        browser.execute_script(CUT)
        wait(browser, f'eol.link.age() > {STALE_S}')
    for width, height in SIZES:
        touch = width <= TOUCH_PX
        metrics = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': touch}
        browser.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', metrics)
        browser.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': touch})
        code = 'return eol.link.work.code'
        if state == 'test' and browser.execute_script(code) != state:
            ask(address, 'test')  # a test ends by itself
            with contextlib.suppress(EolError):  # noted below
                wait(browser, 'eol.link.work.code === "test"')
        time.sleep(0.7)  # it is laid out and painted again
        if state != 'stale' and not (now := browser.execute_script(code)).startswith(state):
            wrong.setdefault(f'another state, {path}', set()).add(f'{now} ({state}, {width})')
        for what, names in browser.execute_script(
            LOOK, 14 if path == '/table' else 12, touch
        ).items():
            for name in names:
                wrong.setdefault(f'{what}, {path}', set()).add(f'{name} ({state}, {width})')
        high = browser.execute_script('return document.documentElement.scrollHeight')
        clip = {'x': 0, 'y': 0, 'width': width, 'height': max(height, high), 'scale': 1}
        asked = {'captureBeyondViewport': True, 'clip': clip}
        png = base64.b64decode(browser.execute_cdp_cmd('Page.captureScreenshot', asked)['data'])
        yield cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


if __name__ == '__main__':
    sys.exit(main())
