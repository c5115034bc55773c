# SPDX-License-Identifier: Apache-2.0
"""A projector that speaks PJLink class 1, written from the specification, not from our client.

PJLink Specifications 1.04, chapters 4 and 5: greeting and authentication, POWR, LAMP, ERST, NAME,
CLSS, ERR1 to ERR4. It takes time to warm up and to cool down, by a clock that the test moves.
"""

import hashlib
import secrets
import socketserver
import threading


class FakeProjector:
    """`unplug` and `plug` it; `now_s` is its clock; `log` has what it was told."""

    WARM_S, COOL_S = 60.0, 90.0

    def __init__(self, password=''):
        self.password, self.now_s = password, 0.0
        self.power, self.since_s = 0, -1e9
        self.lamps = [(1200, 0)]
        self.errors, self.failed = '000000', False
        self.log, self.port = [], 0
        self.server = None
        self.plug()

    @property
    def address(self):
        return f'127.0.0.1:{self.port}'

    def plug(self):
        fake = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self):
                fake.serve(self.rfile, self.wfile)

        socketserver.ThreadingTCPServer.allow_reuse_address = True
        self.server = socketserver.ThreadingTCPServer(('127.0.0.1', self.port), Handler)
        self.server.daemon_threads = True
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def unplug(self):
        self.server.shutdown()
        self.server.server_close()

    def settle(self):
        """Lamps that have had their time are warm, or cold."""
        if self.power == 3 and self.now_s - self.since_s >= self.WARM_S:
            self.power = 1
        if self.power == 2 and self.now_s - self.since_s >= self.COOL_S:
            self.power = 0

    def serve(self, rfile, wfile):
        expected = ''
        if self.password:
            random = secrets.token_hex(4)
            expected = hashlib.md5((random + self.password).encode()).hexdigest()
            wfile.write(f'PJLINK 1 {random}\r'.encode())
        else:
            wfile.write(b'PJLINK 0\r')
        line = b''
        while byte := rfile.read(1):
            if byte != b'\r':
                line += byte
                continue
            text, line = line.decode('ascii'), b''
            if expected:
                if not text.startswith(expected):
                    wfile.write(b'PJLINK ERRA\r')
                    return
                text, expected = text.removeprefix(expected), ''
            assert text.startswith('%1') and len(text) <= 135
            self.log.append(text[2:])
            wfile.write(f'{text[:6]}={self.answer(text[2:6], text[7:])}\r'.encode())

    def answer(self, command, value):
        self.settle()
        if self.failed:
            return 'ERR4'
        if command == 'POWR' and value == '?':
            return str(self.power)
        if command == 'POWR' and value in ('0', '1'):
            if self.power in (2, 3):
                return 'ERR3'
            if value != str(self.power):
                self.power, self.since_s = (3 if value == '1' else 2), self.now_s
            return 'OK'
        if command == 'LAMP' and value == '?':
            return ' '.join(f'{h} {lit}' for h, lit in self.lamps) if self.lamps else 'ERR1'
        if command == 'ERST' and value == '?':
            return self.errors
        return 'ERR2' if command in ('POWR', 'LAMP', 'ERST') else 'ERR1'
