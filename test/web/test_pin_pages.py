# SPDX-License-Identifier: Apache-2.0
"""Pages that ask for the PIN, and their answers; a server without a graph is behind them."""

import pytest
from support import needs
from support.chromium import complaints, press, run, until_page, visit

from eol_ros.core import terrain

pytestmark = [pytest.mark.slow, needs.marker('chromium', 'chromium-driver')]
PIN = '471147'
ANSWER = {'/': 'answer', '/remote': 'answer', '/table': 'pin-answer', '/wall/left': 'pin-words'}


@pytest.mark.parametrize('path', ANSWER)
def test_a_pin_of_any_letters_is_answered_and_wide_digits_are_digits(serve, browser, path):
    server = serve(pin=PIN, visitors=False)
    heights = (terrain.landscape(1) * 65535).astype('<u2').tobytes()
    server.routes.documents['terrain'] = heights  # of the table's covers
    visit(browser, f'http://127.0.0.1:{server.port}', path, 820, 1180)
    wall = path.startswith('/wall')
    if wall:
        press(browser, 'k')
    name = 'pin-pin' if wall else 'pin'
    until_page(browser, f'document.getElementById("{name}").offsetParent')
    for given, words in (
        ('密碼123', 'That is not the PIN.'),
        ('471147é', 'That is not the PIN.'),
        ('４７１１４７', 'done' if wall else 'Controls are open.'),
    ):
        run(browser, f'document.getElementById("{name}").value = "{given}"')
        last = 'document.querySelector("#pin-form button:last-of-type")'
        run(browser, f'{last}.click()')
        answer = f'document.getElementById("{ANSWER[path]}").textContent'
        until_page(browser, f'{answer} === "{words}"')
    if not wall:
        until_page(browser, 'eol.link.mayPush && document.getElementById("pin-form").hidden')
    wrong = [line for line in complaints(browser) if '401' not in str(line)]
    assert wrong == []


def test_an_answer_is_said_in_another_language_and_its_time_goes_on(serve, browser):
    server = serve()
    visit(browser, f'http://127.0.0.1:{server.port}', '/remote')
    answer = 'document.getElementById("answer").textContent'
    run(browser, 'document.querySelector("[data-control=mute]").click()')
    until_page(browser, f'{answer} === "Mute: done"')
    answered = run(browser, 'return eol.desk.answered')
    for language, words in (('zh-Hant', '靜音：完成'), ('en', 'Mute: done')):
        run(browser, f'document.querySelector("[data-language={language}]").click()')
        until_page(browser, f'{answer}.replace(": ", "：") === "{words.replace(": ", "：")}"')
    assert run(browser, 'return eol.desk.answered') == answered
    run(browser, 'eol.desk.answered -= 60001')
    until_page(browser, f'{answer} === ""')
