# SPDX-License-Identifier: Apache-2.0
"""What is answered to which address, and to whom."""

import asyncio
import hashlib
import math
import mimetypes
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aiohttp import WSCloseCode, WSMsgType, web

from eol_ros.core.budget import Budget
from eol_ros.core.table import Table
from eol_ros.errors import EolError, UsageError
from eol_ros.said import LANGUAGES, parts_of, said
from eol_ros.streams.requests import KINDS, SET, Asked
from eol_ros.web import guard, notices, screens, wire
from eol_ros.web.connections import VIEWING, Connection, heaviest
from eol_ros.web.controls import CONTROLS
from eol_ros.web.hub import Hub, Viewer
from eol_ros.web.visitor import Visitor

STATIC = Path(__file__).parent / 'static'
PAGES = {
    '/': 'panel.html',
    '/table': 'table.html',
    '/about': 'about.html',
    '/remote': 'remote.html',
    '/wall/left': 'wall.html',
    '/wall/right': 'wall.html',
}
MAX_BODY = 16384  # 16 paths of 100 points
MAX_MESSAGE = 4096
GRAINS_PER_S = 30.0  # sound files read for outlines; a pointer that sweeps over grains asks less
KERNEL_BUFFER = 131072  # bytes on their way to one viewer: some five images

mimetypes.add_type('text/javascript', '.js')
mimetypes.add_type('application/json', '.json')


class Routes:
    """The handlers. `documents` are what pages fetch: `/lattice`, `/terrain`, `/corpus`,
    `/status`, or what makes them when they are asked for."""

    def __init__(
        self,
        settings: Any,
        hub: Hub,
        bridge: Any,
        say: Callable[[str], None],
        picture: Callable[[str], Path | None] = lambda name: None,
        table: Table = Table(),
    ):
        self.settings, self.hub, self.bridge, self.say = settings, hub, bridge, say
        self.picture = picture
        self.pin = guard.PinGate(settings.pin)
        self.open = not guard.is_loopback(settings.host)
        self.lattice = notices.lattice(table)
        self.documents: dict[str, bytes | Callable[[], bytes]] = {
            'lattice': wire.text(self.lattice).encode()
        }
        self.grain: Callable[[int], dict[str, Any] | None] = lambda number: None
        self._grains = Budget(GRAINS_PER_S)
        self.screens: dict[str, Any] = {}  # by name: corners and edges, kept by the panel
        self.skew_ms = 0.0
        self._flips: dict[str, tuple[int, float]] = {}
        self._sockets: set[web.WebSocketResponse] = set()
        self._lines: dict[Viewer, Connection] = {}  # in order of arrival
        self._files = {
            path.relative_to(folder).as_posix(): _File(path)
            for folder, pattern in ((STATIC, '*'), (LANGUAGES.parent, 'lang/*'))
            for path in sorted(folder.glob(pattern))
        }

    def application(self) -> web.Application:
        """Return the aiohttp application."""
        app = web.Application(middlewares=[self._gate], client_max_size=MAX_BODY)
        for address, page in PAGES.items():
            app.router.add_get(address, self._page(page))
        app.router.add_get('/static/{name:.+}', self._static)
        app.router.add_get('/media/{name:.+}', self._media)
        for name in ('lattice', 'terrain', 'corpus', 'status'):
            app.router.add_get(f'/{name}', self._document(name))
        app.router.add_get('/grain/{number:[0-9]{1,7}}', self._grain)
        app.router.add_get('/live', self._live)
        app.router.add_post('/pin', self._check_pin)
        app.router.add_get('/screen/{name:[a-z0-9-]{1,40}}', self._screen)
        app.router.add_post('/screen/{name:[a-z0-9-]{1,40}}', self._keep_screen)
        app.router.add_post('/control/{name}', self._control)
        return app

    async def close(self) -> None:
        """Say goodbye to every viewer."""
        for viewer in list(self.hub.viewers):
            self.hub.leave(viewer)
        closing = [s.close(code=WSCloseCode.GOING_AWAY) for s in self._sockets]
        await asyncio.wait_for(asyncio.gather(*closing, return_exceptions=True), 2.0)

    @web.middleware
    async def _gate(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Refuse foreign hosts and origins; put the headers on everything."""
        host, origin = request.headers.get('Host', ''), request.headers.get('Origin')
        try:
            if not guard.host_allowed(host, self.open, self.settings.names):
                self.say(f'refused host: {host[:60]!r} (panel.names allows further ones)')
                response: web.StreamResponse = _error(403, 'this host name is not served')
            elif not guard.same_origin(origin, host):
                self.say(f'refused origin: {str(origin)[:60]!r} from {request.remote}')
                response = _error(403, 'requests from other sites are refused')
            else:
                with _connection(request).serving():
                    response = await handler(request)
        except web.HTTPRequestEntityTooLarge as error:
            response = _error(error.status, f'a request has at most {MAX_BODY} bytes')
        except web.HTTPException as error:
            response = _error(error.status, error.reason)
        if not response.prepared:
            for name, value in guard.HEADERS.items():
                response.headers.setdefault(name, value)
        return response

    def _page(self, page: str) -> Any:
        async def handler(request: web.Request) -> web.Response:
            return self._files[page].response(request)

        return handler

    async def _static(self, request: web.Request) -> web.Response:
        file = self._files.get(request.match_info['name'])
        return file.response(request) if file else _error(404, 'no such file')

    def _document(self, name: str) -> Any:
        async def handler(request: web.Request) -> web.Response:
            found = self.documents.get(name)
            body = await asyncio.to_thread(found) if callable(found) else found
            if body is None:
                return _error(404, f'no {name} yet')
            kind = 'application/octet-stream' if name == 'terrain' else 'application/json'
            return web.Response(body=body, content_type=kind, headers={'Cache-Control': 'no-store'})

        return handler

    async def _grain(self, request: web.Request) -> web.Response:
        if not self._grains.take(time.monotonic()):
            return _error(429, 'too many at once')
        number = int(request.match_info['number'])
        found = await asyncio.get_running_loop().run_in_executor(None, self.grain, number)
        if found is None:
            return _error(404, 'no such grain')
        return web.json_response(found, headers={'Cache-Control': 'max-age=5'})

    async def _media(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info['name']
        path = await asyncio.get_running_loop().run_in_executor(None, self.picture, name)
        if path is None or not path.is_file():
            return _error(404, 'no such image')
        response = web.FileResponse(path)
        if path.suffix.lower() == '.svgz':
            response.content_type = 'image/svg+xml'
            response.headers['Content-Encoding'] = 'gzip'
        # An image acts on nothing, whatever an SVG file says.
        response.headers['Content-Security-Policy'] = (
            "default-src 'none'; style-src 'unsafe-inline'"
        )
        response.headers['Cache-Control'] = 'max-age=5'
        return response

    def pin_state(self, request: web.Request, given: str | None = None) -> str:
        """Return the result of the PIN check of `given`, or of the PIN in the request."""
        if given is None:
            given = request.headers.get('X-Pin', '')
        return self.pin.check(given, request.remote or '', time.monotonic())

    async def _check_pin(self, request: web.Request) -> web.Response:
        state = self.pin_state(request)
        return web.json_response({'ok': True}) if state == 'ok' else self._refusal(request, state)

    def _refusal(self, request: web.Request, state: str) -> web.Response:
        if state == 'locked':
            wait_s = math.ceil(self.pin.wait_s(request.remote or '', time.monotonic()))
            self.say(f'too many wrong PINs from {request.remote}: locked out for {wait_s} s')
            refusal = _error(429, said('pin_wait', seconds=wait_s))
            refusal.headers['Retry-After'] = str(wait_s)
            return refusal
        return _error(401, said('pin_asked'))

    async def _screen(self, request: web.Request) -> web.Response:
        found = self.screens.get(request.match_info['name'], {})
        return web.json_response(found, headers={'Cache-Control': 'no-store'})

    async def _keep_screen(self, request: web.Request) -> web.Response:
        if (state := self.pin_state(request)) != 'ok':
            return self._refusal(request, state)
        name = request.match_info['name']
        if name not in self.screens and len(self.screens) >= screens.MOST_SCREENS:
            return _error(409, said('most_screens', count=screens.MOST_SCREENS))
        try:
            found = screens.checked(wire.loads(await _body(request)))
        except ValueError as error:
            return _error(400, said('not_json', why=error))
        except UsageError as error:
            return _error(400, str(error))
        self.screens = self.screens | {name: found}
        return web.json_response({'ok': True})

    async def _control(self, request: web.Request) -> web.Response:
        control = CONTROLS.get(request.match_info['name'])
        if control is None:
            return _error(404, f'controls are: {", ".join(CONTROLS)}')
        if (state := self.pin_state(request)) != 'ok':
            return self._refusal(request, state)
        try:
            body = wire.loads(await _body(request) or b'{}')
        except ValueError as error:
            return _error(400, said('not_json', why=error))
        try:
            return await self._ask(control.read(body, f'panel {request.remote}'))
        except UsageError as error:
            return _error(400, str(error))
        except EolError as error:
            return _error(409, str(error))

    async def _ask(self, asked: Asked) -> web.Response:
        """Ask the graph, and answer with what its nodes make of it."""
        loop = asyncio.get_running_loop()
        heard: asyncio.Future[Any] = loop.create_future()

        def settle(answers: Any) -> None:
            if not heard.done():
                heard.set_result(answers)

        answers = self.bridge.ask(asked, lambda found: loop.call_soon_threadsafe(settle, found))
        try:
            await asyncio.wait_for(heard, KINDS[asked.kind].within_s)
        except asyncio.TimeoutError:
            self.bridge.give_up(answers)
            return _error(409, answers.silent)
        if answers.refusal:
            return _error(409, answers.refusal)
        text = answers.text
        told = {'ok': True, 'text': text, 'said': text.parts}
        if asked.kind == SET:  # so that a page need not wait for the node's next state
            told |= {'node': asked.node, 'values': asked.values}
        return web.json_response(told)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        connection = _connection(request)
        ws = web.WebSocketResponse(heartbeat=10.0, max_msg_size=MAX_MESSAGE, compress=False)
        if not ws.can_prepare(request).ok:
            return _error(400, 'a WebSocket is spoken here')
        if not self._room_for_viewer(connection.address):
            return _error(503, 'too many viewers')
        ws.headers.update(guard.HEADERS)
        await ws.prepare(request)
        line = request.transport
        if line is None:
            return ws
        _keep_short(line)
        visitor = Visitor(self, request)
        viewer = self.hub.join(line, visitor.hello)
        self._lines[viewer], connection.state = connection, VIEWING
        self._sockets.add(ws)
        try:
            async for message in ws:
                if message.type == WSMsgType.TEXT:
                    why = visitor.take(message.data)
                elif message.type == WSMsgType.ERROR:
                    break
                else:
                    why = 'only text is taken'
                if why:
                    self.say(f'refused message: {why} (from {request.remote})')
                    self.hub.leave(viewer)  # nothing may follow the goodbye
                    await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=why.encode()[:100])
                    break
            if ws.close_code == WSCloseCode.MESSAGE_TOO_BIG:
                self.say(
                    f'refused message: longer than {MAX_MESSAGE} bytes (from {request.remote})'
                )
        finally:
            self._sockets.discard(ws)
            self._lines.pop(viewer, None)
            self.hub.leave(viewer)
            visitor.leave()
        return ws

    def _room_for_viewer(self, address: str) -> bool:
        """Return whether `address` gets a viewer; drop one of an address with more if needed."""
        if len(self.hub.viewers) < self.settings.viewers:
            return True
        self.say(f'too many viewers: {self.settings.viewers} are connected (panel.viewers)')
        held = {v: line.address for v, line in self._lines.items() if v in self.hub.viewers}
        most = heaviest(held.values(), address)
        if most == address:
            return False
        newest = next(viewer for viewer in reversed(held) if held[viewer] == most)
        self.hub.leave(newest)
        self._lines.pop(newest).drop()
        return True

    def flipped(self, side: str, change: int, time_ms: float) -> None:
        """A wall says when it changed; with both sides of one change, their skew is known."""
        self._flips[side] = (change, time_ms)
        left, right = self._flips.get('left'), self._flips.get('right')
        if left and right and left[0] == right[0]:
            self.skew_ms = abs(left[1] - right[1])


def _connection(request: web.Request) -> Connection:
    connection = request.protocol
    assert isinstance(connection, Connection)
    return connection


async def _body(request: web.Request) -> bytes:
    """Return the body; raises ValueError if its compression is not that of its header."""
    try:
        return await request.read()
    except web.RequestPayloadError as error:
        raise ValueError(f'the body cannot be read: {str(error).splitlines()[0]}') from None


def _keep_short(line: asyncio.BaseTransport) -> None:
    """Let the kernel keep little: what waits there grows old and cannot be replaced."""
    sock = line.get_extra_info('socket')
    if sock is not None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER)


class _File:
    """One static file, held in memory."""

    def __init__(self, path: Path):
        self.body = path.read_bytes()
        self.kind = mimetypes.guess_type(path.name)[0] or 'application/octet-stream'
        self.etag = f'"{hashlib.sha256(self.body).hexdigest()[:16]}"'

    def response(self, request: web.Request) -> web.Response:
        headers = {'ETag': self.etag, 'Cache-Control': 'no-cache'}
        if request.headers.get('If-None-Match') == self.etag:
            return web.Response(status=304, headers=headers)
        charset = 'utf-8' if self.kind.startswith(('text/', 'application/json')) else None
        return web.Response(
            body=self.body, content_type=self.kind, charset=charset, headers=headers
        )


def _error(status: int, why: str) -> web.Response:
    return web.json_response({'error': why, 'said': parts_of(why)}, status=status)
