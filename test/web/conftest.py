# SPDX-License-Identifier: Apache-2.0
"""A server with a bridge that writes down what it is asked, and no graph behind it."""

import dataclasses
import json

import pytest
from support.chromium import browser, chromium, graph, status  # noqa: F401  fixtures

from eol_ros.core.table import Table
from eol_ros.ros.requests import Answers, expected_of
from eol_ros.settings import PanelSettings
from eol_ros.web.server import WebServer


class Notebook:
    """A Bridge that only remembers."""

    def __init__(self):
        self.calls = []
        self.answer = True, ''  # of the first node that must answer; None: nobody answers
        self.missing = set()

    def ask(self, asked, done):
        expected = expected_of(asked.kind, asked.node, lambda node: node not in self.missing)
        self.calls.append((asked.kind, asked.node, asked.values, asked.source))
        answers = Answers(asked, expected)
        if self.answer is not None:
            node = min(expected)
            answers.found = {n: (True, '') for n in expected} | {node: self.answer}
            done(answers)
        return answers

    def give_up(self, answers):
        self.calls.append(('give up', answers.asked.kind))

    def rim(self, *args):
        self.calls.append(('rim', *args))


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

    def start(picture=lambda name: None, table=Table(), **settings):
        chosen = dataclasses.replace(PanelSettings(), port=0, **settings)
        lines = []
        server = WebServer(chosen, Notebook(), lines.append, picture=picture, table=table)
        server.lines = lines
        server.bridge = server.routes.bridge
        server.start()
        servers.append(server)
        return server

    yield start
    for server in servers:
        server.stop()
