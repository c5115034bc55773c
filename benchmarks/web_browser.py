# SPDX-License-Identifier: Apache-2.0
"""The part of `eol bench web` that sits before a screen: a headless Chromium, drawn by software."""

import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from support.running import TICK_HZ, summary

from eol_ros.errors import DeviceMissing, EolError, pip_install

FLAGS = (
    'headless=new no-sandbox disable-gpu no-first-run disable-sync mute-audio'
    ' disable-background-networking disable-component-update'
    ' autoplay-policy=no-user-gesture-required window-size=1280,800'
)
CASCADES = 3  # kept going in the drawing while its rate is counted


def start(profile: str | Path) -> Any:
    """Start a Chromium that keeps what it keeps in the folder `profile`; return its driver.

    Raises EolError without selenium, DeviceMissing without Chromium.
    """
    try:
        from selenium import webdriver
    except ImportError:
        raise EolError(f'--browser needs selenium: {pip_install("selenium")}') from None
    browser, driver_path = shutil.which('chromium'), shutil.which('chromedriver')
    if not (browser and driver_path):
        raise DeviceMissing('--browser needs chromium and chromedriver (chromium-driver)')
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for flag in (*FLAGS.split(), f'user-data-dir={profile}'):
        options.add_argument(f'--{flag}')
    return webdriver.Chrome(options, webdriver.ChromeService(driver_path))


def measure_browser(url: str, seconds: float, sound_latency_s: float) -> dict[str, Any]:
    """Look at the monitor, push the rim of the table, count two walls; return the figures."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        driver = start(profile)
        try:
            driver.set_script_timeout(seconds + 30)
            return {
                **_idle(driver, url, seconds),
                **_monitor(driver, url, seconds),
                **_table(driver, url, seconds, sound_latency_s),
                **_walls(driver, url, seconds / 2),
            }
        finally:
            driver.quit()


def wait(driver: Any, condition: str, seconds: float = 30.0) -> None:
    """Return when `condition` holds in the page; raise EolError after `seconds`."""
    end = time.monotonic() + seconds
    while not driver.execute_script(f'return Boolean(window.eol) && ({condition})'):
        if time.monotonic() > end:
            raise EolError(f'the page does not come to: {condition}')
        time.sleep(0.1)


def _idle(driver: Any, url: str, seconds: float) -> dict[str, Any]:
    """Processor of the whole browser before a table that nobody touches, with its hint and without.

    Of a core, in percent; an empty page beside it.
    """
    driver.get(f'{url}/table')
    wait(driver, 'eol.counts.packets > 30 && eol.drawing.land')
    found = {}
    for name, script in (
        ('table_hint_percent', 'eol.hands.heldAt = -Infinity'),
        ('table_still_percent', 'eol.hands.heldAt = performance.now()'),
        ('empty_page_percent', 'location = "about:blank"'),
    ):
        driver.execute_script(script)
        time.sleep(2)
        pids = _with_children(driver.service.process.pid)
        before, begin_s = _used_s(pids), time.monotonic()
        time.sleep(seconds)
        span_s = time.monotonic() - begin_s
        found[name] = round(100 * (_used_s(pids) - before) / span_s, 1)
    return found


def _with_children(pid: int) -> list[int]:
    found = [pid]
    for task in Path(f'/proc/{pid}/task').glob('*/children'):
        found += [one for child in task.read_text().split() for one in _with_children(int(child))]
    return found


def _used_s(pids: list[int]) -> float:
    fields = [Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split() for pid in pids]
    return sum(int(one[11]) + int(one[12]) for one in fields) / TICK_HZ


def _monitor(driver: Any, url: str, seconds: float) -> dict[str, Any]:
    driver.get(url)
    wait(driver, 'eol.link.viewer')
    driver.execute_script(_SHAKE)
    wait(driver, 'eol.drawn.starts > 3 && eol.link.offsets.length > 4')
    driver.execute_script('eol.drawn.latencies.length = 0')
    time.sleep(seconds)
    drawn = driver.execute_script('return eol.drawn.latencies')
    return {'slip_to_drawn_ms': summary([s * 1e3 for s in drawn])}


def _table(driver: Any, url: str, seconds: float, sound_latency_s: float) -> dict[str, Any]:
    driver.get('about:blank')
    empty = driver.execute_async_script(_TICKS, 3000)
    driver.get(f'{url}/table')
    wait(driver, 'eol.counts.packets > 30 && eol.drawing.land')
    driver.find_element('id', 'listen').click()
    wait(driver, 'eol.listener.latency !== null')
    time.sleep(6)  # the ring learns how little it may hold
    played = driver.execute_async_script(_PLAY, seconds * 1e3, CASCADES)
    heard = [(sound_latency_s + s) * 1e3 for s in played['sounds']]
    return {
        'drag_to_rim_ms': summary([ms for ms, _ in played['moved']]),
        'drag_to_rim_seen_ms': summary([ms for _, ms in played['moved']]),
        'drags_without_answer': played['missed'],
        'drawings_per_s': round(played['drawings'] / played['span'], 1),
        'offered_per_s': round(played['offered'] / played['span'], 1),  # by the browser, meanwhile
        'empty_page_per_s': round(empty, 1),  # what it offers a page that does nothing
        'late_drawings': played['late'],  # more than an image of the screen after the one before
        'slip_to_heard_ms': summary(heard),
        'sound_starved': played['starved'],
    }


def _walls(driver: Any, url: str, seconds: float) -> dict[str, Any]:
    """Both walls, a window each: how far apart they show the same change."""
    first = driver.current_window_handle
    flips = []
    driver.get(f'{url}/wall/left')
    driver.switch_to.new_window('window')
    second = driver.current_window_handle
    driver.get(f'{url}/wall/right')
    wait(driver, 'eol.link.viewer')
    driver.execute_script(_SHAKE)
    for window in (first, second):
        driver.switch_to.window(window)
        wait(driver, 'eol.flips.length > 1')
    time.sleep(seconds)
    for window in (first, second):
        driver.switch_to.window(window)
        flips.append(dict(driver.execute_script('return eol.flips.slice(2)')))
    left, right = flips
    return {'wall_skew_ms': summary([abs(left[n] - right[n]) for n in left.keys() & right.keys()])}


# Pushes to and fro, so that blocks slip.
_SHAKE = """
setInterval(() => {
  eol.link.send({rim: [0.12 * Math.sign(Math.sin(performance.now() / 700)), 0, 0]});
}, 50);
"""
# How many images a second the browser offers to a page that draws nothing.
_TICKS = """
const [length, done] = arguments;
let first = 0, count = 0;
requestAnimationFrame(function tick(now) {
  first ||= now;
  if (now - first < length) count++, requestAnimationFrame(tick);
  else done(1000 * count / (now - first));
});
"""
# Turns the rim with the link itself at known times, to and fro about its middle, and waits each
# time until the rate of turning, as the twin tells it, jumps. Two ends of that wait are noted: the
# stamp of the first image with the jump, which is when the rim had moved, and when the page knew.
# The sound's latency is noted with each report of the audio thread. Drawings are counted from
# image to image of the screen, once the first cascade runs; with them what the browser offered.
_PLAY = """
const [length, cascades, done] = arguments;
const {link, counts, listener, drawing} = eol;
const moved = [], sounds = [];
const begin = performance.now();
const starved = listener.starved;
let first = 0, last = 0, drawings = 0, offered = 0, late = 0, counted = false;
let sent = 0, sentAt = 0, way = 1, missed = 0, before = [];
link.on('truth', ({stamp}) => {
  const rim = eol.state().rim[2];
  before.push(rim);
  if (before.length > 3) before.shift();
  const [a, b, c] = before;
  if (sent && before.length === 3 && way * ((c - b) - (b - a)) > 0.0007) {
    moved.push([(stamp - sentAt) * 1e3, performance.now() - sent]);
    sent = 0;
  }
});
listener.onreport = (latency) => sounds.push(latency);
const cascade = () => {
  for (let k = 0; k < cascades; k++) {
    drawing.slip(Math.floor(Math.random() * 25), 1e6 + k, performance.now());
  }
};
cascade();
const wave = setInterval(cascade, 100);
setTimeout(() => requestAnimationFrame(function tick(now) {
  if (!first) [first, drawings] = [now, counts.drawings];
  else offered++;
  if (last && now - last > 25) late++;
  last = now;
  if (now - begin < length) requestAnimationFrame(tick);
  else [drawings, counted] = [counts.drawings - drawings, true];
}), 300);
const push = setInterval(() => {
  if (counted) {
    clearInterval(push);
    clearInterval(wave);
    done({moved, missed, sounds, drawings, offered, late, span: (last - first) / 1000,
      starved: listener.starved - starved});
    return;
  }
  if (sent) missed++;
  way = eol.state().rim[2] > 0 ? -1 : 1;
  sent = performance.now();
  sentAt = link.now();
  link.send({rim: [0, 0, 1.2 * way]});
  setTimeout(() => link.send({rim: [0, 0, 0]}), 60);
}, 200);
"""
