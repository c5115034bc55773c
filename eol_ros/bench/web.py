# SPDX-License-Identifier: Apache-2.0
"""eol bench web: what lookers cost, and how late they see, hear and are obeyed.

The rehearsal runs; crowds of WebSocket viewers look at everything, one crowd after the other; then,
with --browser, a headless Chromium plays on the virtual table.
"""

import argparse
import asyncio
import json
import multiprocessing
import os
import re
import struct
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from eol_ros.bench.running import Film, Graph, latencies, stand_in, summary
from eol_ros.errors import EolError

HELP = 'Measure the panel: processor and memory per viewer, latency to page, ear and rim.'
EXAMPLES = ['eol bench web --viewers 0,1,5,50 --seconds 20 --json', 'eol bench web --browser']
WANTS = ['blocks', 'truth', 'slips', 'triggers', 'leds', 'meter', 'image']


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--viewers', default='0,1,5,50', help='crowds, parted by commas')
    parser.add_argument('--seconds', type=float, default=15.0, help='per crowd')
    parser.add_argument('--without', default='recorder', help='nodes left out, parted by commas')
    parser.add_argument('--browser', action='store_true', help='play in Chromium too (selenium)')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    results: dict[str, Any] = {'load': os.getloadavg()[0], 'crowds': []}
    with tempfile.TemporaryDirectory(prefix='eol-bench-') as place:
        folder = Path(place)
        scene = stand_in('rehearsal', folder, Film(folder), None)
        values = yaml.safe_load(scene.read_text())
        for name in args.without.split(','):
            values['nodes'].pop(name, None)
        scene.write_text(yaml.safe_dump(values, sort_keys=False))
        with Graph(scene, folder / 'bags') as graph:
            wait_for(graph, {'twin', 'tracker', 'motion', 'panel'})
            url = re.findall(r'http://\S+?(?=,|$)', graph.node('panel')['text'])[0]
            for count in (int(word) for word in args.viewers.split(',')):
                print(f'{count} viewers: {args.seconds:g} s', file=sys.stderr, flush=True)
                results['crowds'].append(measure_crowd(graph, url, count, args.seconds))
            if args.browser:
                print('a browser plays', file=sys.stderr, flush=True)
                results['browser'] = measure_browser(url, args.seconds)
    print(json.dumps(results, indent=2) if args.json else table(results))
    return 0


def wait_for(graph: Graph, names: set[str], timeout_s: float = 120.0) -> None:
    """Wait until those nodes are well that the measurement needs."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        try:
            rows = graph.status()['nodes']
        except EolError:
            rows = []
        if names <= {row['node'] for row in rows if row['level'] in (0, 'ok')}:
            return
        time.sleep(0.2)
    raise EolError(f'not well within {timeout_s:g} s: {graph.log.read_text().strip()}')


def measure_crowd(graph: Graph, url: str, count: int, seconds: float) -> dict[str, Any]:
    """Let `count` viewers look for `seconds`; return what it cost and how late they saw."""
    context = multiprocessing.get_context('spawn')
    answer = context.Queue()
    crowd = context.Process(target=look, args=(url, count, seconds + 2.0, answer))
    if count:
        crowd.start()
        time.sleep(2.0)
    graph.mark()
    time.sleep(seconds)
    figures = graph.figures()
    seen = answer.get(timeout=60) if count else {}
    if count:
        crowd.join(10)
    panel = next(row for names, row in figures['nodes'].items() if 'panel' in names)
    return {
        'viewers': count,
        'panel_cpu_percent': panel['cpu_percent'],
        'panel_pss_mb': panel['pss_mb'],
        'graph_images_per_s': figures['images_per_s'],
        'graph_lost': figures['lost'],
        'graph_latency_ms': {
            topic: latencies(graph.watch.seen[topic], graph.begin_ns)
            for topic in ('blocks', 'slips', 'grain_triggers')
        },
        **seen,
    }


def look(url: str, count: int, seconds: float, answer: Any) -> None:
    """Be `count` viewers in a process of one's own; put their figures into the queue."""
    answer.put(asyncio.run(_look(url, count, seconds)))


async def _look(url: str, count: int, seconds: float) -> dict[str, Any]:
    import aiohttp

    late: dict[str, list[float]] = {'blocks': [], 'slips': []}
    packets = 0

    async def viewer(client: aiohttp.ClientSession) -> None:
        nonlocal packets
        async with client.ws_connect(f'{url}/live', max_msg_size=0) as socket:
            await socket.send_json({'wants': WANTS})
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0:
                try:
                    message = await socket.receive(timeout=left)
                except asyncio.TimeoutError:
                    return
                now = time.time()
                packets += 1
                if message.type == aiohttp.WSMsgType.BINARY:
                    kind, stamp = struct.unpack_from('<B7xd', message.data)
                    if kind == 1:
                        late['blocks'].append((now - stamp) * 1e3)
                elif message.type == aiohttp.WSMsgType.TEXT and '"t":"slip"' in message.data:
                    late['slips'].append((now - json.loads(message.data)['stamp']) * 1e3)
                elif message.type == aiohttp.WSMsgType.CLOSED:
                    return

    connector = aiohttp.TCPConnector(limit=0)
    async with aiohttp.ClientSession(connector=connector) as client:
        await asyncio.gather(*(viewer(client) for _ in range(count)))
    return {
        'packets_per_viewer_s': round(packets / count / seconds, 1),
        'seen_ms': {name: summary(values) for name, values in late.items()},
    }


def measure_browser(url: str, seconds: float) -> dict[str, Any]:
    """Push the rim in a headless Chromium, and let its pages tell what they measured."""
    import shutil

    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which('chromium') or ''
    flags = ('headless=new no-sandbox disable-gpu no-first-run disable-sync mute-audio'
             ' disable-background-networking disable-component-update'
             ' autoplay-policy=no-user-gesture-required')  # fmt: skip
    with tempfile.TemporaryDirectory() as profile:
        for flag in (*flags.split(), f'user-data-dir={profile}', 'window-size=1280,800'):
            options.add_argument(f'--{flag}')
        driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which('chromedriver')))
        try:
            driver.set_script_timeout(seconds + 30)
            driver.get(f'{url}/table')
            time.sleep(3)
            driver.find_element('id', 'listen').click()
            time.sleep(3)
            played = driver.execute_async_script(_PLAY, seconds * 1e3)
            driver.get(url)
            time.sleep(seconds)
            drawn = driver.execute_script('return eol.drawn.latencies || []')
        finally:
            driver.quit()
    return {
        'slip_to_drawn_ms': summary([s * 1e3 for s in drawn]),
        'drag_to_rim_ms': summary(played['moved']),
        'drawings_per_s': round(played['drawings'] / seconds, 1),
        'sound_latency_ms': played['latency'],
        'sound_starved': played['starved'],
    }


# Pushes with the link itself at known times, against whatever the visitors do, and waits each time
# until the rim's pose, as the twin tells it, moves by more than it did in the same time before.
_PLAY = """
const [length, done] = arguments;
const {link, counts, listener} = eol;
const moved = [];
const begin = performance.now();
const first = counts.drawings;
let sent = 0, before = null, way = 1;
const starved = listener.starved;
link.on('truth', () => {
  const rim = [...eol.state().rim];
  if (sent && before && Math.abs(rim[2] - before[2]) > 0.0012) {
    moved.push(performance.now() - sent);
    sent = 0;
  }
  before = rim;
});
const push = setInterval(() => {
  if (performance.now() - begin > length) {
    clearInterval(push);
    done({moved, drawings: counts.drawings - first, starved: listener.starved - starved,
      latency: listener.latency === null ? null : Math.round(listener.latency * 1000)});
    return;
  }
  if (sent) return;
  way = -way;
  sent = performance.now();
  link.send({rim: [0, 0, 1.2 * way]});
  setTimeout(() => link.send({rim: [0, 0, 0]}), 100);
}, 600);
"""


def table(results: dict[str, Any]) -> str:
    """Return the figures for people."""
    lines = [
        f'load before: {results["load"]:.1f}',
        'viewers  panel CPU %  PSS MB  images/s  blocks p99 ms  seen blocks p99  slips p99',
    ]
    for row in results['crowds']:
        seen = row.get('seen_ms', {})
        figures = [row['graph_latency_ms']['blocks'], seen.get('blocks'), seen.get('slips')]
        p99 = [f'{f["p99"]:.1f}' if f else '-' for f in figures]
        cost = f'{row["viewers"]:7} {row["panel_cpu_percent"]:12} {row["panel_pss_mb"]:7}'
        late = f'{p99[0]:>14} {p99[1]:>16} {p99[2]:>10}'
        lines.append(f'{cost} {row["graph_images_per_s"]:9} {late}')
    for name, value in results.get('browser', {}).items():
        lines.append(f'{name}: {value}')
    return '\n'.join(lines)
