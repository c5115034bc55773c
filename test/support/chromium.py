# SPDX-License-Identifier: Apache-2.0
"""The whole work running, and a headless Chromium before it: what the browser tests stand on.

Nothing here trusts a clock: each wait is for a condition, with time enough for a busy machine.
"""

import contextlib
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

from eol_ros import parent_death
from support.waiting import GENEROUS_S, wait_until

webdriver = pytest.importorskip('selenium.webdriver')
BROWSER, DRIVER = shutil.which('chromium'), shutil.which('chromedriver')
AXE = Path(sys.prefix, 'browser', 'node_modules', 'axe-core', 'axe.min.js')
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
  recorder: off
"""
NODES = {'twin', 'tracker', 'motion', 'leds', 'grains', 'sound', 'montage', 'panel'}


def status(address):
    """Return the state of every node, by name; empty when nobody answers."""
    try:
        with urllib.request.urlopen(f'{address}/status', timeout=5) as answer:
            return json.load(answer)
    except OSError:
        return {}


def healthy(address):
    """Return the names of the nodes that say they do their work."""
    return {n for n, s in status(address).items() if s['level'] in ('ok', 'warn')}


def alive(pids):
    """Return those of the processes that still run."""
    return {pid for pid in pids if Path(f'/proc/{pid}').exists()}


@pytest.fixture(scope='module')
def graph(tmp_path_factory):
    """The work without hands: whatever moves was moved by the tests. Yields the panel's address."""
    folder = tmp_path_factory.mktemp('graph')
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    scene = folder / 'browser.yaml'
    scene.write_text(SCENE.format(folder=folder, port=port))
    with (folder / 'log').open('w') as log:
        work = subprocess.Popen(
            [sys.executable, '-m', 'eol_ros.bringup', str(scene)], stdout=log, stderr=log,
            cwd=folder, preexec_fn=parent_death.following(signal.SIGTERM),
        )  # fmt: skip
    address = f'http://127.0.0.1:{port}'
    work.log = folder / 'log'
    work.nodes = set()  # process ids, also of those that were started again
    try:
        wait_until(
            lambda: work.poll() is not None or healthy(address) >= NODES,
            90,
            why=lambda: (folder / 'log').read_text(),
        )
        assert work.poll() is None, (folder / 'log').read_text()
        work.nodes |= {int(s['pid']) for s in status(address).values()}
        yield address, work
    finally:
        if work.poll() is None:
            work.send_signal(signal.SIGINT)
            work.wait(30)
        end = time.monotonic() + 20  # they end with the graph, however that ended
        while (left := alive(work.nodes)) and time.monotonic() < end:
            time.sleep(0.1)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        assert not left, f'{len(left)} nodes outlived their graph'


@pytest.fixture(scope='session')
def chromium(tmp_path_factory):
    """One browser for all files of a process: it takes seconds to start."""
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f'--user-data-dir={tmp_path_factory.mktemp("profile")}'):
        options.add_argument(flag)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    driver = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
    driver.set_script_timeout(60)
    yield driver
    driver.quit()


@pytest.fixture(scope='module')
def browser(chromium):
    yield chromium
    chromium.get('about:blank')
    complaints(chromium)  # of the pages of this file


@contextlib.contextmanager
def phone(browser):
    """Make the browser one that has fingers, and neither mouse nor keyboard."""
    touches = 'Emulation.setTouchEmulationEnabled'
    browser.execute_cdp_cmd(touches, {'enabled': True, 'maxTouchPoints': 5})
    try:
        yield
    finally:
        browser.execute_cdp_cmd(touches, {'enabled': False})


@contextlib.contextmanager
def reduced_motion(browser):
    """Let the browser report prefers-reduced-motion."""
    features = [{'name': 'prefers-reduced-motion', 'value': 'reduce'}]
    browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': features})
    try:
        yield
    finally:
        browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})


def resize(browser, width, height, mobile=False):
    """Set the size of the screen, in CSS pixels."""
    browser.execute_cdp_cmd(
        'Emulation.setDeviceMetricsOverride',
        {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': mobile},
    )


def visit(browser, address, path, width=1280, height=800, mobile=False):
    """Open a page, and wait until it is connected."""
    resize(browser, width, height, mobile)
    browser.get(address + path)
    until_page(browser, 'eol.link.viewer')


def until_page(browser, condition, seconds=GENEROUS_S):
    """Wait until a condition holds in the page; return its value."""
    script = f'return Boolean(window.eol) && ({condition})'
    return wait_until(
        lambda: browser.execute_script(script),
        seconds,
        turn=lambda: time.sleep(0.05),
        why=lambda: f'never: {condition}',
    )


def run(browser, script, *args):
    """Return what a script in the page returns."""
    return browser.execute_script(script, *args)


def complaints(browser):
    """Return what the console says of errors since the last look."""
    return [e['message'] for e in browser.get_log('browser') if e['level'] == 'SEVERE']


def barriers(browser):
    """Return what axe-core finds on a page by all its rules, also those on the size of targets."""
    if not run(browser, 'return Boolean(window.axe)'):
        run(browser, AXE.read_text(encoding='utf-8'))
    found, passed = browser.execute_async_script(
        'const done = arguments[arguments.length - 1];'
        "axe.run({rules: {'target-size': {enabled: true}}})"
        '.then(({violations, passes}) => done([violations, passes.length]));'
    )
    assert passed > 5, 'rules that had something to look at'
    return [f'{v["id"]}: {v["help"]}: {n["html"]}' for v in found for n in v['nodes']]


def picture(browser):
    """Return a screenshot as an array."""
    png = browser.get_screenshot_as_png()
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def mouse(browser, kind, x, y, buttons=1):
    """Move or press the mouse as a hand does."""
    browser.execute_cdp_cmd(
        'Input.dispatchMouseEvent',
        {'type': kind, 'x': x, 'y': y, 'button': 'left', 'buttons': buttons, 'clickCount': 1},
    )


def touch(browser, kind, *points):
    """Lay fingers down, move them or lift them."""
    browser.execute_cdp_cmd(
        'Input.dispatchTouchEvent',
        {
            'type': kind,
            'touchPoints': [{'x': x, 'y': y, 'id': i} for i, (x, y) in enumerate(points)],
        },
    )


def press(browser, key, hold=False):
    """Press a key; with `hold`, do not let go."""
    codes = {'Tab': 9, 'Enter': 13}
    stroke = {'key': key, 'code': key if key in codes else f'Key{key.upper()}'}
    stroke['windowsVirtualKeyCode'] = codes.get(key, ord(key.upper()[0]))
    if key != 'Tab':
        stroke['text'] = '\r' if key == 'Enter' else key
    browser.execute_cdp_cmd('Input.dispatchKeyEvent', {'type': 'keyDown', **stroke})
    if not hold:
        release(browser, key)


def release(browser, key):
    """Let a key go."""
    codes = {'Tab': 9, 'Enter': 13}
    browser.execute_cdp_cmd(
        'Input.dispatchKeyEvent',
        {
            'type': 'keyUp',
            'key': key,
            'code': key if key in codes else f'Key{key.upper()}',
            'windowsVirtualKeyCode': codes.get(key, ord(key.upper()[0])),
        },
    )
