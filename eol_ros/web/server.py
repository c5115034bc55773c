# SPDX-License-Identifier: Apache-2.0
"""The server: one thread with one event loop beside the node's executor.

It imports no ROS. Its requests to the graph go through its `bridge`, from its own thread: `ask`,
`give_up` and `rim` of the panel node. Data of the graph for viewers comes through `Hub.put`.
"""

import asyncio
import errno
import logging
import resource
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from aiohttp import web, web_response

from eol_ros.devices.rounds import Rounds
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.web import certificate, guard
from eol_ros.web.connections import Connection, Connections
from eol_ros.web.hub import Hub
from eol_ros.web.routes import Routes

TICK_S = 1.0
HANDSHAKE_S = 5.0  # of TLS: who takes longer is sent away
SPARE_CONNECTIONS = 128  # pages and images beside the viewers' sockets
BACKLOG = 1024  # connections that the kernel queues until they are accepted
NO_FILES_S = 0.1  # pause if the system has no descriptors left
# Versions are nobody's business; this counts also for what aiohttp refuses by itself.
web_response.__dict__['SERVER_SOFTWARE'] = 'eol'


class _Lines(logging.Handler):
    """Turns whatever the HTTP library reports into one line."""

    def __init__(self, say: Callable[[str], None]):
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        cause = record.exc_info[1] if record.exc_info else None
        text = record.getMessage().splitlines()[0]
        self._say(f'{text}: {cause!r}' if cause else text)


def logger(say: Callable[[str], None]) -> logging.Logger:
    """Return to what the HTTP library reports; `say` is given each report as one line."""
    log = logging.Logger('eol.web')
    log.addHandler(_Lines(say))
    return log


class WebServer:
    """Serves the pages from `start` to `stop`.

    Raises ConfigError when it would stand open without a PIN or its certificate is no good,
    DeviceMissing when the address cannot be had.
    """

    def __init__(
        self, settings: Any, bridge: Any, say: Callable[[str], None] = print, **pages: Any
    ):
        guard.check_settings(settings.host, settings.pin)
        self.hub = Hub()
        self.settings = settings
        self._say = say
        self._said: dict[str, float] = {}
        self._tls = certificate.context(settings.certificate) if settings.certificate else None
        self.routes = Routes(settings, self.hub, bridge, self.say, **pages)
        self._socket = _listen(settings.host, settings.port)
        self.port = self._socket.getsockname()[1]
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name='web', daemon=True)
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self.rounds = Rounds()

    @property
    def address(self) -> str:
        """Where a browser finds the panel."""
        host = self.settings.host
        if host in ('0.0.0.0', '::'):
            host = socket.gethostname()
        scheme = 'https' if self._tls else 'http'
        return (
            f'{scheme}://[{host}]:{self.port}' if ':' in host else f'{scheme}://{host}:{self.port}'
        )

    def say(self, text: str) -> None:
        """Report one line; lines of one kind, whatever their address, at most every 5 s."""
        kind, now = text.partition(':')[0].partition(' from ')[0], time.monotonic()
        if now - self._said.get(kind, -1e9) >= 5.0:
            self._said[kind] = now
            self._say(text)

    def start(self) -> None:
        """Serve from now on."""
        self._thread.start()
        self._ready.wait(10.0)
        if self._failure:
            raise DeviceMissing(f'panel: cannot serve: {self._failure}')

    def stop(self) -> None:
        """Close every connection and end the thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopping.set)
            self._thread.join(5.0)
        self._socket.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except BaseException as error:
            self._failure = error
            if self._ready.is_set():  # it served before: the process must end
                raise
            if not isinstance(error, EolError):
                self.say(f'web server: {error!r}')
        finally:
            self._ready.set()
            self.rounds.rest()
            self._loop.close()

    async def _serve(self) -> None:
        self._stopping = asyncio.Event()
        self.hub.attach(self._loop)
        self._loop.set_exception_handler(self._on_loop_error)
        runner = web.AppRunner(
            self.routes.application(), access_log=None, handle_signals=False, shutdown_timeout=1.0
        )
        await runner.setup()
        most = self.settings.viewers + SPARE_CONNECTIONS
        _allow_files(most + 256)
        held = Connections(most)
        ticking = [
            self._loop.create_task(self._tick()),
            self._loop.create_task(self._accept(runner.server, held)),
        ]
        self._ready.set()
        stopping = self._loop.create_task(self._stopping.wait())
        await asyncio.wait([stopping, *ticking], return_when=asyncio.FIRST_COMPLETED)
        for task in ticking:
            if task.done():
                task.result()  # raises the exception that ended it
            task.cancel()
        await self.routes.close()
        await runner.cleanup()
        held.drop_all()  # those in a handshake
        await asyncio.sleep(0)

    async def _accept(self, server: Any, held: Connections) -> None:
        """Accept connections, one in each round of the loop, so that others are served, too."""
        log = logger(self.say)
        while True:
            try:
                sock, peer = await self._loop.sock_accept(self._socket)
            except OSError as error:
                if error.errno != errno.ECONNABORTED:
                    self.say(f'no connection accepted: {error.strerror}')
                    await asyncio.sleep(NO_FILES_S)
                continue
            address = guard.network_of(peer[0])
            if len(held) >= held.most:
                self.say(f'too many connections: {held.most} are open, {peer[0]} opens another')
            if held.make_room(address):
                one = Connection(
                    held, address, server, loop=self._loop, logger=log, keepalive_timeout=15.0,
                    access_log=None,
                )  # fmt: skip
                held.add(one)
                one.accepting = self._loop.create_task(self._take(one, held, sock))
            else:
                sock.close()
            await asyncio.sleep(0)

    async def _take(self, one: Connection, held: Connections, sock: socket.socket) -> None:
        """Serve an accepted connection, after its TLS handshake if it has one."""
        try:
            await self._loop.connect_accepted_socket(
                lambda: one, sock, ssl=self._tls,
                ssl_handshake_timeout=HANDSHAKE_S if self._tls else None,
            )  # fmt: skip
        except OSError:
            pass  # the handshake failed
        finally:
            if one.transport is None:
                held.discard(one)

    async def _tick(self) -> None:
        """Tell all viewers that we live, and how old what they look at is."""
        while True:
            self.rounds.done()
            await asyncio.sleep(TICK_S)
            if self.hub.viewers:
                tick = {'t': 'tick', 'now': time.time(), 'viewers': len(self.hub.viewers)}
                self.hub.put('notices', tick)

    def _on_loop_error(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self.say(f'web: {context.get("exception") or context.get("message")}')


def _allow_files(count: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < count:
        most = count if hard == resource.RLIM_INFINITY else min(count, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def _listen(host: str, port: int) -> socket.socket:
    """Return a bound socket; raises DeviceMissing in one line."""
    try:
        family, kind, proto, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except OSError as error:
        raise DeviceMissing(f'panel.host: {host}: {error.strerror or error}') from None
    sock = socket.socket(family, kind, proto)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.setblocking(False)
    try:
        sock.bind(address)
        sock.listen(BACKLOG)
    except OSError as error:
        sock.close()
        if error.errno == errno.EADDRINUSE:
            raise DeviceMissing(
                f'panel.port: {port} on {host} is taken; stop the other program or set another port'
            ) from None
        raise DeviceMissing(f'panel: {host}:{port}: {error.strerror}') from None
    return sock
