# SPDX-License-Identifier: Apache-2.0
"""eol bench web_frames: one written frame for all viewers, against aiohttp's own WebSocket writer.

The traffic of the pages in real time goes to viewers over socket pairs, which another process
empties; every second viewer is a monitor, which takes states at its own pace. `hub` is what the
panel does: a frame is made once, and the loop writes it to each wire, joined with what else waits.
`aiohttp` gives each viewer its WebSocketWriter and a task, as a server does that leaves framing to
the library and must not let one slow viewer hold up the rest. `in a row` does without tasks: one
slow viewer holds up all, and none has a pace. Processor time is that of the thread of the loop.
"""

import argparse
import asyncio
import multiprocessing
import selectors
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

from benchmarks.machine import tell
from eol_ros.web.hub import EVENTS, Hub

HELP = "Compare the panel's WebSocket frames with those of aiohttp."
EXAMPLES = ['eol bench web_frames --viewers 5,50 --seconds 10 --json']
IMAGES_PER_S = 60
PACE_S = 0.033  # of the monitor page; the table has none
# Channel, bytes of a payload, and every how many images there is one.
TRAFFIC = (
    ('blocks', 728, 1), ('truth', 424, 1), ('leds', 44, 1), ('slips', 180, 3), ('meter', 5200, 4),
    ('image', 30_000, 6),
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--viewers', default='5,50', help='crowds, parted by commas')
    parser.add_argument('--seconds', type=float, default=10.0, help='per crowd and way')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    found = []
    for count in (int(word) for word in args.viewers.split(',')):
        for name, begin in WAYS.items():
            print(f'{name}, {count} viewers', file=sys.stderr, flush=True)
            found.append({'way': name, 'viewers': count} | measure(begin, count, args.seconds))
    tell({'ways': found}, args.json, table)
    return 0


def measure(begin: Callable[..., Any], count: int, seconds: float) -> dict[str, float]:
    """Return what `begin`, which returns how to send, costs with `count` viewers."""
    pairs = [socket.socketpair() for _ in range(count)]
    context = multiprocessing.get_context('fork')
    crowd = context.Process(target=drain, args=(pairs,), daemon=True)
    crowd.start()
    for _, far in pairs:
        far.close()
    try:
        return asyncio.run(_play(begin, [near for near, _ in pairs], seconds))
    finally:
        crowd.join(10)
        crowd.kill()


def drain(pairs: list[tuple[socket.socket, socket.socket]]) -> None:
    """Read all that comes, until every wire is closed."""
    chosen = selectors.DefaultSelector()
    for near, far in pairs:
        near.close()
        chosen.register(far, selectors.EVENT_READ)
    left = len(pairs)
    while left:
        for key, _ in chosen.select(10.0):
            if not key.fileobj.recv(1 << 18):  # type: ignore[union-attr]  # always a socket here
                chosen.unregister(key.fileobj)
                left -= 1


async def _play(
    begin: Callable[..., Any], ends: list[socket.socket], seconds: float
) -> dict[str, float]:
    from aiohttp.base_protocol import BaseProtocol

    loop = asyncio.get_running_loop()
    wires = [await loop.create_connection(lambda: BaseProtocol(loop), sock=end) for end in ends]
    send = begin(wires)
    payloads = {channel: bytes(size) for channel, size, _ in TRAFFIC}
    sent, began_s, used_s = 0, loop.time(), time.thread_time()
    for image in range(round(seconds * IMAGES_PER_S)):
        await asyncio.sleep(max(began_s + image / IMAGES_PER_S - loop.time(), 0.0))
        for channel, _, every in TRAFFIC:
            if image % every == 0:
                sent += 1
                done = send(channel, payloads[channel])
                if done is not None:
                    await done
    await asyncio.sleep(0.1)
    used_s = time.thread_time() - used_s
    for transport, _ in wires:
        transport.close()
    await asyncio.sleep(0.1)
    return {
        'percent_of_a_core': round(100 * used_s / seconds, 2),
        'us_per_packet_and_viewer': round(1e6 * used_s / sent / len(ends), 2),
    }


def hub(wires: list[Any]) -> Callable[[str, bytes], None]:
    """Send as the panel does."""
    spread = Hub()
    spread.attach(asyncio.get_running_loop())
    for number, (transport, _) in enumerate(wires):
        viewer = spread.join(transport)
        viewer.pace_s = PACE_S * (number % 2)
        spread.want(viewer, [channel for channel, _, _ in TRAFFIC])
    return spread.put


def writers(wires: list[Any]) -> Callable[[str, bytes], None]:
    """Send by aiohttp, each viewer with a task and a queue; of states only the newest waits."""
    from aiohttp import WSMsgType
    from aiohttp.http_websocket import WebSocketWriter

    viewers = []

    async def serve(
        writer: Any, waiting: dict[Any, bytes], news: asyncio.Event, pace_s: float
    ) -> None:
        while True:
            await news.wait()
            while waiting:
                await writer.send_frame(waiting.pop(next(iter(waiting))), WSMsgType.BINARY)
            news.clear()
            if pace_s:  # an event would have to wake it; here even that may wait
                await asyncio.sleep(pace_s)

    for number, (transport, protocol) in enumerate(wires):
        waiting: dict[Any, bytes] = {}
        news = asyncio.Event()
        writer = WebSocketWriter(protocol, transport)
        task = asyncio.ensure_future(serve(writer, waiting, news, PACE_S * (number % 2)))
        viewers.append((waiting, news, task))

    def send(channel: str, payload: bytes) -> None:
        for waiting, news, _ in viewers:
            waiting[(channel, len(waiting)) if channel in EVENTS else channel] = payload
            news.set()

    return send


def in_a_row(wires: list[Any]) -> Callable[[str, bytes], Any]:
    """Send by aiohttp, one viewer after the other."""
    from aiohttp import WSMsgType
    from aiohttp.http_websocket import WebSocketWriter

    made = [WebSocketWriter(protocol, transport) for transport, protocol in wires]

    async def send(_: str, payload: bytes) -> None:
        for writer in made:
            await writer.send_frame(payload, WSMsgType.BINARY)

    return send


WAYS = {'hub': hub, 'aiohttp': writers, 'aiohttp, in a row': in_a_row}


def table(results: dict[str, Any]) -> str:
    """Return the results for people."""
    rows = [
        '| way | viewers | % of a core | us per packet and viewer |',
        '| --- | --- | --- | --- |',
    ]
    rows += [
        f'| {row["way"]} | {row["viewers"]} | {row["percent_of_a_core"]} | '
        f'{row["us_per_packet_and_viewer"]} |'
        for row in results['ways']
    ]
    return '\n'.join(rows)
