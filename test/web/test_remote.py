# SPDX-License-Identifier: Apache-2.0
"""The remote on a phone, and cues on both pages, against a server without a graph."""

import time

import pytest
from support import needs
from support.chromium import complaints, phone, press, run, touch, until_page, visit
from support.waiting import wait_until
from test_browser import flawless, speak

from eol_ros.said import clauses, said
from eol_ros.streams.work_state import work_state
from eol_ros.web import notices

pytestmark = [pytest.mark.slow, needs.marker('chromium', 'chromium-driver')]
SIZE = (390, 844)
CUES = ['day', 'evening', 'a-cue-with-a-name-as-long-as-any-can-be-that-a-museum-thinks-of-x']


STILL = said('still')
LOWER = """const slider = document.getElementById('gain_db');
slider.stepDown();
for (const name of ['input', 'change']) slider.dispatchEvent(new Event(name));"""
LIVE = """return [...document.querySelectorAll('main :is(button, input)')]
.filter((e) => !e.disabled && e.offsetParent).map((e) => e.id || e.dataset.say)"""


def tell(server, node, values=(), text=STILL):
    notice = {
        't': 'health', 'node': node, 'level': 'ok', 'text': text, 'said': text.parts, 'rate': 1,
        'values': dict(values), 'at': time.time(),
    }  # fmt: skip
    server.hub.put('notices', notice, sticky=f'health {node}')


def furnish(server):
    """Let the server say what the nodes of a museum say."""
    server.hub.put('notices', notices.work(work_state([])), sticky='work')
    following = said('next_cue', cue='evening', day=said('fri'), time='18:30')
    hours = clauses([said('open_until', day=said('fri'), time='22:00'), following])
    tell(server, 'hours', {'cues': CUES}, hours)
    tell(server, 'montage', {'asleep': False}, STILL)
    tell(server, 'sound', {'muted': True, 'gain_db': -6.0})
    for node in ('tracker', 'motion', 'leds', 'grains', 'recorder'):
        tell(server, node, text=STILL)


@pytest.fixture
def page(serve, browser):
    """Open a page of a new server, on a phone."""
    with phone(browser):

        def show(path='/remote', size=SIZE, **settings):
            server = serve(**settings)
            furnish(server)
            visit(browser, f'http://127.0.0.1:{server.port}', path, *size, mobile=True)
            speak(browser, 'en')
            until_page(browser, 'document.querySelectorAll("#cues button").length === 3')
            return server

        yield show


def tap(browser, selector):
    box = f"document.querySelector('{selector}').getBoundingClientRect()"
    run(browser, f'document.querySelector(\'{selector}\').scrollIntoView({{block: "center"}})')
    x, y = run(browser, f'const b = {box}; return [b.x + b.width / 2, b.y + b.height / 2]')
    touch(browser, 'touchStart', (x, y))
    touch(browser, 'touchEnd')


@pytest.mark.parametrize('size', [SIZE, (360, 640), (844, 390)])
def test_one_column_that_a_thumb_can_use_in_both_languages(page, browser, size):
    page(size=size)
    for language, following in (('en', 'next cue evening Fri 18:30'), ('zh-Hant', '週五 18:30')):
        speak(browser, language)
        until_page(browser, f'document.getElementById("hours").textContent.includes("{following}")')
        flawless(browser, '/remote', touch=True)
    assert complaints(browser) == []


@pytest.mark.parametrize('path', ['/', '/remote'])
def test_a_cue_is_given_and_its_refusal_told(page, browser, path):
    server = page(path)
    tap(browser, '#cues button:nth-child(2)')
    wait_until(lambda: server.bridge.calls)
    assert server.bridge.calls[-1][:3] == ('cue', '', {'name': 'evening'})
    answer = 'document.getElementById("answer").textContent'
    until_page(browser, f'{answer} === "Cue evening: done"')
    why = said('of_request', request='set leds peak=0.5', why=said('does_not_answer', names='leds'))
    server.bridge.answer = False, why
    tap(browser, '#cues button:nth-child(1)')
    until_page(browser, f'{answer} === "Cue day: hours: set leds peak=0.5: leds does not answer"')
    tell(server, 'hours', {'cues': []}, said('open_ever'))
    until_page(browser, 'document.getElementById("cues").hidden')
    complaints(browser)  # of the refusal


def test_every_control_asks_the_graph(page, browser):
    server = page()
    for name in ('sleep', 'wake', 'mute', 'unmute', 'test'):
        tap(browser, f'[data-control={name}]')
        wait_until(lambda name=name: server.bridge.calls and server.bridge.calls[-1][0] == name)
    pressed = 'document.querySelector("[data-control={}]").ariaPressed === "true"'.format
    until_page(browser, f'{pressed("wake")} && {pressed("mute")}')
    assert run(browser, 'return document.querySelector("output").value') == '-6 dB'
    run(browser, LOWER)
    wait_until(lambda: server.bridge.calls[-1][:3] == ('set', 'sound', {'gain_db': -7}))
    until_page(browser, 'document.querySelector("output").value === "-7 dB"')
    server.bridge.answer = False, said('muted')
    run(browser, LOWER)  # refused: what the node has is shown again
    until_page(browser, 'document.querySelector("output").value === "-7 dB"')
    complaints(browser)  # of the refusal


def test_with_a_pin_nothing_can_be_asked_before_it(page, browser):
    server = page(pin='271828')
    assert run(browser, LIVE) == ['pin', 'unlock']
    flawless(browser, '/remote', touch=True)
    run(browser, 'document.getElementById("pin").focus()')
    for digit in '271828':
        press(browser, digit)
    press(browser, 'Enter')
    until_page(browser, 'document.getElementById("pin-form").hidden')
    assert len(run(browser, LIVE)) == 9
    tap(browser, '[data-control=sleep]')
    wait_until(lambda: server.bridge.calls and server.bridge.calls[-1][0] == 'sleep')


def test_the_remote_by_keyboard(page, browser):
    page()
    seen = []
    for _ in range(13):
        press(browser, 'Tab')
        seen.append(run(browser, 'return document.activeElement.textContent || "slider"'))
    assert seen[:7] == ['Sleep', 'Wake', 'Mute', 'Unmute', 'slider', 'Test', 'day']
    assert seen[10] == 'English'
