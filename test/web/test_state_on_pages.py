# SPDX-License-Identifier: Apache-2.0
"""Every page shows every state of the work in the same words, also if opened in the middle of it.

A server without a graph gets each state as the panel node publishes it.
"""

import itertools
import time

import pytest
from support import needs
from support.chromium import AXE, barriers, complaints, run, until_page, visit
from support.work_states import STATES

from eol_ros.core import terrain
from eol_ros.said import said, translated
from eol_ros.streams.work_state import work_state
from eol_ros.web import notices

pytestmark = [pytest.mark.slow, needs.marker('chromium', 'chromium-driver')]
PLACES = {
    '/': 'work-state',
    '/table': 'work',
    '/about': 'state',
    '/remote': 'work-state',
    '/wall/left': 'work',
}
STYLES = 'test', 'work_fault', 'awake'  # a card, loud words, plain words
PAGES = list(itertools.product(PLACES, ('en', 'zh-Hant')))
# A test first: the pages are opened in the middle of one.
WALK = ['test', *(code for code in STATES if code != 'test')]


@pytest.mark.parametrize(
    ('path', 'language', 'looked_at'),
    [
        *((*page, STYLES) for k, page in enumerate(PAGES) if k % 4 in (0, 3)),
        *(pytest.param(*page, (*STATES, 'stopped'), marks=pytest.mark.soak) for page in PAGES),
    ],
)
def test_a_page_shows_every_state(serve, browser, path, language, looked_at):
    """axe-core finds nothing in the states `looked_at`, nor after the connection is lost."""
    server = serve()
    heights = (terrain.landscape(1) * 65535).astype('<u2').tobytes()
    server.routes.documents['terrain'] = heights  # of the table's covers
    address = f'http://127.0.0.1:{server.port}'

    def put(state):
        server.hub.put('notices', notices.work(state), sticky='work')
        words = translated(state, language)
        until_page(browser, f'document.getElementById("{PLACES[path]}").textContent === "{words}"')
        if path.startswith('/wall'):
            wall = {'en': 'Left wall', 'zh-Hant': '左牆'}[language]
            until_page(browser, f'document.title === "{wall}: {words}"')
            tests = str(state == said('test')).lower()
            until_page(browser, f'document.getElementById("card").hidden !== {tests}')
        if AXE.exists() and state.parts[0][0] in looked_at:
            assert barriers(browser) == []

    browser.get(f'{address}/about')
    run(browser, f'localStorage.setItem("language", "{language}")')
    server.hub.put('notices', notices.work(said('test')), sticky='work')
    visit(browser, address, path)
    for code in WALK:
        put(work_state(STATES[code][0]))
    put(said('stopped'))
    assert complaints(browser) == []
    server.stop()
    until_page(browser, 'eol.link.age() > 6')
    assert not AXE.exists() or barriers(browser) == []
    complaints(browser)  # of the lost connection
    if not AXE.exists():
        pytest.skip('tools/setup_env.sh test installs axe-core, with npm')


def test_the_last_word_of_a_work_that_was_stopped_stays(serve, browser):
    server = serve()
    visit(browser, f'http://127.0.0.1:{server.port}', '/table')
    server.hub.put('notices', notices.work(said('stopped')), sticky='work')
    until_page(browser, 'eol.link.work.code === "stopped"')
    server.stop()
    until_page(browser, 'document.getElementById("words").textContent === "stopped"')
    complaints(browser)  # of the lost connection


def test_a_table_that_starts_is_not_said_to_be_absent(serve, browser):
    server = serve()
    visit(browser, f'http://127.0.0.1:{server.port}', '/table')
    words = 'document.getElementById("words").textContent'
    until_page(
        browser,
        f'performance.now() > 4000 && {words} === "There is no virtual table in this scene."',
    )
    server.hub.put('notices', notices.work(said('starting')), sticky='work')
    until_page(
        browser, f'{words} === "" && document.getElementById("work").textContent === "starting"'
    )
    server.hub.put('notices', notices.work(said('awake')), sticky='work')
    until_page(browser, f'{words} !== ""')
    complaints(browser)  # of covers that nobody gave


def test_about_says_what_is_heard_and_that_walls_and_table_sleep(serve, browser):
    server = serve()
    visit(browser, f'http://127.0.0.1:{server.port}', '/about')
    health = {'t': 'health', 'level': 'ok', 'text': '', 'rate': 1}
    for code, (rows, english, _) in STATES.items():
        for node, values in (('sound', {}), ('twin', {'playing': 'visitors'})):
            notice = health | {'node': node, 'values': values, 'at': time.time()}
            server.hub.put('notices', notice, sticky=f'health {node}')
        server.hub.put('notices', notices.work(work_state(rows)), sticky='work')
        words = 'can be heard' if code == 'awake' else english
        until_page(browser, f'document.getElementById("sound").textContent === "{words}"')
        asleep = english if code.startswith('asleep') else ''
        for row, else_words in (
            ('walls', 'unknown at the moment'),
            ('hands', 'nobody: it plays itself'),
        ):
            words = asleep or else_words
            assert run(browser, f'return document.getElementById("{row}").textContent') == words


def test_a_node_s_row_has_the_latency_that_it_measures(serve, browser):
    server = serve()
    visit(browser, f'http://127.0.0.1:{server.port}', '/')
    values = {'image_to_blocks_p50_ms': 3.9, 'image_to_blocks_p99_ms': 10.4}
    health = {'t': 'health', 'node': 'tracker', 'level': 'ok', 'text': '25 seen', 'rate': 60}
    row = 'document.querySelector(\'#nodes li[data-node="tracker"] .why\').textContent'
    for found, words in (
        (values, '60 Hz, image to blocks 4 ms (99 %: 10), 25 seen'),
        ({}, '60 Hz, 25 seen'),
    ):
        notice = health | {'values': found, 'at': time.time()}
        server.hub.put('notices', notice, sticky='health tracker')
        until_page(browser, f"{row} === '{words}'")
