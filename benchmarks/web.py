# SPDX-License-Identifier: Apache-2.0
"""eol bench web: what viewers cost, and the latency of what they see, hear and do.

The rehearsal runs; crowds of WebSocket viewers, in a process of their own, ask for what the pages
ask for, one crowd after the other; then, with --browser, a headless Chromium looks at the monitor
and plays on the virtual table (`benchmarks.web_browser`).
"""

import argparse
import asyncio
import itertools
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
from support.running import Film, Graph, stand_in, summary

from benchmarks.machine import tell
from eol_ros.errors import EolError

HELP = 'Measure CPU and memory of the panel per viewer, and latency to page, ear and rim.'
EXAMPLES = [
    'eol bench web --viewers 0,5,0,50,0 --seconds 12 --json',
    'eol bench web --viewers 0,50,0 --seconds 60',
    'eol bench web --viewers none --browser',
]
# What the pages ask for: static/panel.js, static/table.js, and soundwire.js of one of them.
MONITOR = {'wants': ['blocks', 'slips', 'triggers', 'meter', 'leds', 'image']}, {'pace': 0.033}
TABLE = ({'wants': ['truth', 'slips', 'leds']},)
SOUND = ({'wants': ['sound']},)
PAGES = MONITOR, TABLE, MONITOR, TABLE, SOUND
LINGER_S = 5.0  # of nodes/panel.py
NICE_CROWD = 10  # real viewers bring processors of their own


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--viewers', default='0,5,0,50,0', help='numbers of viewers, separated by commas, or none'
    )
    parser.add_argument(
        '--seconds',
        type=float,
        default=12.0,
        help='duration for each number of viewers and each page',
    )
    parser.add_argument('--without', default='recorder', help='nodes left out, separated by commas')
    parser.add_argument('--browser', action='store_true', help='measure pages in Chromium, too')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    crowds = [] if args.viewers == 'none' else [int(word) for word in args.viewers.split(',')]
    results: dict[str, Any] = {'load': os.getloadavg()[0], 'crowds': []}
    parts = [part for part, wanted in (('crowds', crowds), ('browser', args.browser)) if wanted]
    with tempfile.TemporaryDirectory(prefix='eol-bench-') as place:
        for part in parts:
            folder = Path(place, part)
            folder.mkdir()
            scene = stand_in('rehearsal', folder, Film(folder), None)
            values = yaml.safe_load(scene.read_text())
            for name in args.without.split(','):
                values['nodes'].pop(name, None)
            if part == 'browser':  # there the pages push, and know when they did
                values['nodes']['twin']['hands'] = 'nobody'
            names = set(values['nodes'])
            values['nodes'].setdefault('recorder', False)
            scene.write_text(yaml.safe_dump(values, sort_keys=False))
            with Graph(scene, folder / 'bags') as graph:
                wait_for(graph, names)
                url = re.findall(r'http://\S+?(?=,|$)', graph.node('panel')['text'])[0]
                if part == 'crowds':
                    for count in crowds:
                        print(f'{count} viewers: {args.seconds:g} s', file=sys.stderr, flush=True)
                        results['crowds'].append(measure_crowd(graph, url, count, args.seconds))
                else:
                    from benchmarks.web_browser import measure_browser

                    print('a browser looks, and plays', file=sys.stderr, flush=True)
                    latency_s = values['nodes']['sound']['latency_s']
                    results['browser'] = measure_browser(url, args.seconds, latency_s)
    results['with_viewers'] = compare(results['crowds'])
    tell(results, args.json, table)
    return 0


def wait_for(graph: Graph, names: set[str], timeout_s: float = 120.0) -> None:
    """Wait until those nodes do their work, if with a warning."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        try:
            rows = graph.status()['nodes']
        except EolError:
            rows = []
        if names <= {row['node'] for row in rows if row['level'] in (0, 1, 'ok', 'WARN', 'warn')}:
            return
        time.sleep(0.2)
    raise EolError(f'not well within {timeout_s:g} s: {graph.log.read_text().strip()}')


def measure_crowd(graph: Graph, url: str, count: int, seconds: float) -> dict[str, Any]:
    """Let `count` viewers look for `seconds`; return what it cost and how late they saw."""
    context = multiprocessing.get_context('spawn')
    answer, began = context.Queue(), context.Event()
    crowd = context.Process(target=look, args=(url, count, seconds + 2.0, answer, began))
    if count:
        crowd.start()
        began.wait(60)
        time.sleep(1.0)
    else:
        time.sleep(LINGER_S + 1.0)  # streams end so late after the last viewer
    before = panel_memory(graph)
    graph.mark()
    time.sleep(seconds)
    figures = graph.figures()
    after = panel_memory(graph)
    seen = answer.get(timeout=60) if count else {}
    if count:
        crowd.join(10)
    panel = next(row for names, row in figures['nodes'].items() if 'panel' in names)
    return {
        'viewers': count,
        'panel_cpu_percent': panel['cpu_percent'],
        'panel_pss_mb': [before, after],
        'graph_images_per_s': figures['images_per_s'],
        'graph_lost': figures['lost'],
        'graph_latency_ms': {
            topic: graph.latencies(topic) for topic in ('blocks', 'slips', 'grain_triggers')
        },
        **seen,
    }


def panel_memory(graph: Graph) -> float:
    """Return the panel's proportional set size in MB."""
    text = Path(f'/proc/{graph.node("panel")["pid"]}/smaps_rollup').read_text()
    return round(int(re.search(r'^Pss:\s+(\d+)', text, re.M)[1]) / 1024, 1)  # type: ignore[index]


def look(url: str, count: int, seconds: float, answer: Any, began: Any) -> None:
    """Be `count` viewers in a process of one's own; put their figures into the queue."""
    os.nice(NICE_CROWD)
    answer.put(asyncio.run(_look(url, count, seconds, began)))


async def _look(url: str, count: int, seconds: float, began: Any) -> dict[str, Any]:
    import aiohttp

    late: dict[str, list[float]] = {'blocks': [], 'slips': []}
    packets = size = 0
    waiting = count

    async def viewer(client: aiohttp.ClientSession, asks: tuple[dict[str, Any], ...]) -> None:
        nonlocal packets, size, waiting
        async with client.ws_connect(f'{url}/live', max_msg_size=0) as socket:
            for ask in asks:
                await socket.send_json(ask)
            waiting -= 1
            if not waiting:
                began.set()
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0:
                try:
                    message = await socket.receive(timeout=left)
                except asyncio.TimeoutError:
                    return
                now = time.time()
                packets += 1
                if message.type in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT):
                    size += len(message.data)
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
        pages = itertools.islice(itertools.cycle(PAGES), count)
        await asyncio.gather(*(viewer(client, page) for page in pages))
    return {
        'packets_per_viewer_s': round(packets / count / seconds, 1),
        'kb_per_viewer_s': round(size / 1e3 / count / seconds, 1),
        'seen_ms': {name: summary(values) for name, values in late.items()},
    }


def compare(crowds: list[dict[str, Any]]) -> dict[str, Any]:
    """Return, for the largest crowd, the graph's latency over that with no viewer."""
    alone = [row['graph_latency_ms'] for row in crowds if row['viewers'] == 0]
    most = max(crowds, key=lambda row: row['viewers'], default=None)
    if not alone or not most or not most['viewers']:
        return {}
    ratio = {}
    for topic, found in most['graph_latency_ms'].items():
        plain = [row[topic]['p50'] for row in alone if row[topic]]
        if found and plain:
            ratio[topic] = round(found['p50'] * len(plain) / sum(plain), 2)
    return {'viewers': most['viewers'], 'median_latency_ratio': ratio}


def table(results: dict[str, Any]) -> str:
    """Return the figures for people."""
    lines = [f'load before: {results["load"]:.1f}']
    if results['crowds']:
        lines.append(
            'viewers  panel CPU %  PSS MB begin end  images/s'
            '  graph: blocks p50 p99  slips p50 p99  seen: slips p50 p99 (ms)'
        )
    for row in results['crowds']:
        graph, seen = row['graph_latency_ms'], row.get('seen_ms', {})
        begin, end = row['panel_pss_mb']
        lines.append(
            f'{row["viewers"]:7} {row["panel_cpu_percent"]:12} {begin:13} {end:5}'
            f' {row["graph_images_per_s"]:9} {_two(graph["blocks"]):>22} {_two(graph["slips"]):>14}'
            f' {_two(seen.get("slips")):>20}'
        )
    for name, value in results['with_viewers'].items():
        lines.append(f'{name}: {value}')
    for name, value in results.get('browser', {}).items():
        lines.append(f'{name}: {value}')
    return '\n'.join(lines)


def _two(figures: dict[str, float] | None) -> str:
    return f'{figures["p50"]:.1f} {figures["p99"]:.1f}' if figures else '-'
