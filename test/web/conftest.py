# SPDX-License-Identifier: Apache-2.0
"""A server with a bridge that writes down what it is asked, and no graph behind it."""

import dataclasses
import json

import pytest
from chromium import browser, graph, status  # noqa: F401  fixtures

from eol_ros.settings import PanelSettings
from eol_ros.web.server import WebServer


class Notebook:
    """A Bridge that only remembers."""

    def __init__(self):
        self.calls = []
        self.answer = ''
        self.missing = set()

    def runs(self, node):
        return node not in self.missing

    def control(self, *args):
        self.calls.append(('control', *args))

    def change(self, node, values, done):
        self.calls.append(('change', node, values))
        done(self.answer)

    def rim(self, *args):
        self.calls.append(('rim', *args))

    def play(self, grain):
        self.calls.append(('play', grain))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Show, beside a failure before the whole graph, what the graph says of itself."""
    report = yield
    if report.failed and 'graph' in getattr(item, 'funcargs', {}):
        address, work = item.funcargs['graph']
        lines = work.log.read_text(errors='replace').splitlines()
        report.sections.append(('log of the graph', '\n'.join(lines[-60:])))
        report.sections.append(('status of the nodes', json.dumps(status(address), indent=1)))
    return report


@pytest.fixture
def serve():
    """Return a function that starts a server; all are stopped at the end."""
    servers = []

    def start(picture=lambda name: None, **settings):
        chosen = dataclasses.replace(PanelSettings(), port=0, **settings)
        lines = []
        server = WebServer(chosen, Notebook(), lines.append, picture=picture)
        server.lines = lines
        server.bridge = server.routes.bridge
        server.start()
        servers.append(server)
        return server

    yield start
    for server in servers:
        server.stop()
