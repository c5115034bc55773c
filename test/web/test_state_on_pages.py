# SPDX-License-Identifier: Apache-2.0
"""Every page shows every state of the work in the same words, also if opened in the middle of it.

A server without a graph gets each state as the panel node publishes it.
"""

import datetime
import itertools
import time

import numpy as np
import pytest
from support import needs
from support.chromium import AXE, barriers, complaints, run, until_page, visit
from support.work_states import STATES

from eol_ros.core import terrain
from eol_ros.core.opening_hours import Door, OpeningHours
from eol_ros.core.science import powerlaw
from eol_ros.said import parts_of, said, translated
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
    until_page(browser, 'eol.link.tries > 0')
    run(browser, 'eol.link.heard.any -= 5000')
    until_page(browser, 'eol.link.age() > 6.2')  # old enough to be marked
    assert not AXE.exists() or barriers(browser) == []
    browser.get('about:blank')
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
    browser.get('about:blank')
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
    row = 'document.querySelector(\'#nodes li[data-node="tracker"] .why\')?.textContent'
    for found, words in (
        (values, '60 Hz, image to blocks 4 ms (99 %: 10), 25 seen'),
        ({}, '60 Hz, 25 seen'),
    ):
        notice = health | {'values': found, 'at': time.time()}
        server.hub.put('notices', notice, sticky='health tracker')
        until_page(browser, f"{row} === '{words}'")


def test_opening_hours_stand_in_words_at_the_top(serve, browser):
    """In the node's words and the museum's time zone; not if the state of the work shows them."""
    visit(browser, f'http://127.0.0.1:{serve().port}', '/')
    tell = (
        'eol.link.emit("health", {node: "hours", at: eol.link.now(), level: "ok", text: "",'
        ' values: {}, rate: 0, said: arguments[0]})'
    )
    shown = 'return document.getElementById("hours").textContent'
    taipei = datetime.timezone(datetime.timedelta(hours=8))
    door = Door(OpeningHours(['Tue-Sun 10:00-18:00'], taipei))
    door.look(datetime.datetime(2026, 11, 23, 12, tzinfo=taipei).timestamp())  # a Monday
    for name, text in (
        ('zh-Hant', '關閉至週二 10:00，已手動喚醒'),
        ('en', 'closed until Tue 10:00, woken by hand'),
    ):
        run(browser, f'document.querySelector("[data-language={name}]").click()')
        run(browser, tell, parts_of(door.words(asleep=False)))
        assert run(browser, shown) == text
    asleep = door.words(asleep=True)
    run(browser, 'eol.link.work = arguments[0]', notices.work(asleep))
    run(browser, tell, parts_of(asleep))
    assert run(browser, shown) == ''
    assert complaints(browser) == []


def test_the_fit_on_the_page_is_that_of_the_project(serve, browser):
    """The panel fits; the page draws the curve and shows its figures, or the count so far."""
    visit(browser, f'http://127.0.0.1:{serve().port}', '/')
    shown = 'eol.link.emit("cascades", arguments[0]);'
    for count, words in ((29, '29 so far'), (300, 'b = ')):
        areas = powerlaw.sample(1.7, 1, 25, count, np.random.default_rng(3))
        newest = [[0, 12, 3, 3, 0.5, [12]]]
        day = notices.Day({'date': 'x', 'order': areas.tolist(), 'recent': newest})
        run(browser, shown, day.notice())
        until_page(
            browser, f'document.getElementById("law-words").textContent.startsWith("{words}")'
        )
    law = powerlaw.cascade_law(areas)
    said = run(browser, 'return document.getElementById("law-words").textContent')
    assert said.startswith(f'b = {law.fit.b_value:.2f} ± {law.tested.error:.2f}')
    areas = np.minimum(np.random.default_rng(1).geometric(0.2, 400), 25)
    rejected = notices.Day({'date': 'x', 'order': areas.tolist(), 'recent': newest})
    run(browser, shown, rejected.notice())
    found = powerlaw.cascade_law(areas)
    words = f'not a power law: KS {found.fit.ks:.2f}, n {found.fit.count}, p '
    until_page(browser, f'document.getElementById("law-words").textContent.startsWith("{words}")')
    beside = run(browser, 'return document.getElementById("law-words").textContent')
    assert beside.endswith('; the automaton of this size: b = 0.77')
