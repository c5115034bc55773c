# SPDX-License-Identifier: Apache-2.0
"""eol kiosk: with a browser that writes down how it was called, and goes away."""

import http.server
import socket
import threading
from pathlib import Path

import pytest
from support.waiting import wait_until

from eol_ros.cli import main
from eol_ros.devices.browser import kiosk
from eol_ros.devices.browser.kiosk import Screen
from eol_ros.web import certificate

XRANDR = """Screen 0: minimum 320 x 200, current 5760 x 1080, maximum 16384 x 16384
HDMI-2 connected 1920x1080+1920+0 (normal left inverted right x axis y axis) 600mm x 340mm
   1920x1080     60.00*+
HDMI-1 connected primary 1920x1080+0+0 (normal left inverted right x axis y axis) 600mm x 340mm
DP-1 disconnected (normal left inverted right x axis y axis)
DP-2 connected (normal left inverted right x axis y axis)
DP-3 connected 1920x1200+3840+0 (normal left inverted right x axis y axis) 600mm x 340mm
"""


class Page(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200 if self.path.startswith('/wall/') else 404)
        self.end_headers()

    def log_message(self, *args):
        pass


@pytest.fixture
def panel():
    """A server that answers as the panel does."""
    server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f'http://127.0.0.1:{server.server_port}'
    server.shutdown()
    server.server_close()


@pytest.fixture
def secure_panel():
    """The same over HTTPS, with a certificate that nobody trusts."""
    tls = certificate.context(str(Path(__file__).parents[1] / 'support/localhost.pem'))
    server = http.server.ThreadingHTTPServer(('0.0.0.0', 0), Page)
    server.socket = tls.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_port
    server.shutdown()
    server.server_close()


@pytest.fixture
def browser(tmp_path):
    """A browser that notes its command line and ends at once."""
    path = tmp_path / 'browser'
    path.write_text(f'#!/bin/sh\necho "$@" >> {tmp_path}/calls\nexit 3\n')
    path.chmod(0o755)
    return path


SCREENS = ['--screens', '800x600+0+0', '1024x768+800+0']


@pytest.mark.parametrize(('swap', 'first'), [([], 'left'), (['--swap'], 'right')])
def test_each_wall_on_its_screen_with_its_own_profile(
    tmp_path, panel, browser, capsys, swap, first
):
    words = ['kiosk', '--url', panel, '--browser', str(browser), '--for', '2', *SCREENS, *swap]
    assert main(words) == 0
    calls = [line.split() for line in (tmp_path / 'calls').read_text().splitlines()]
    calls = calls[:2]  # the browser of this test ends at once, and is started again
    assert len(calls) == 2
    by_place = {next(w for w in c if 'window-position' in w): c for c in calls}
    left = by_place['--window-position=0,0']
    assert f'--app={panel}/wall/{first}' in left and '--kiosk' in left
    assert '--window-size=1024,768' in by_place['--window-position=800,0']
    profiles = {next(w for w in c if 'user-data-dir' in w).split('=')[1] for c in calls}
    assert len(profiles) == 2
    for profile in profiles:
        assert not __import__('pathlib').Path(profile).exists()  # thrown away
    assert 'the window is gone (code 3); again in 1 s' in capsys.readouterr().err


def test_why_a_browser_ended_is_told(tmp_path):
    """As Chromium says it where there is no display, with lines of no use around it."""
    path = tmp_path / 'browser'
    path.write_text(
        '#!/bin/sh\necho "[1:2:0101/000000.1:WARNING:a.cc(1)] slow" >&2\n'
        'echo "[1:2:0101/000000.2:ERROR:b.cc(2)] Missing X server or \\$DISPLAY" >&2\n'
        'echo "Exiting." >&2\nexit 1\n'
    )
    path.chmod(0o755)
    window = kiosk.Window(str(path), 'http://x/wall/left', Screen(0, 0, 800, 600))
    try:
        news = [window.keep(0.0)]
        wait_until(lambda: news.append(window.keep(1.0)) or 'gone' in news[-1])
    finally:
        window.close()
    assert news[-1] == (
        'http://x/wall/left: the window is gone (code 1: Missing X server or $DISPLAY); '
        'again in 1 s'
    )


def test_a_lost_window_comes_back_later_and_later(browser, tmp_path):
    window = kiosk.Window(str(browser), 'http://x/wall/left', Screen(0, 0, 800, 600))
    news, now_s = [], 0.0
    try:
        while window.starts < 4 and now_s < 60:
            said = window.keep(now_s)
            if 'again in' in said:
                news.append(said.rsplit(' ', 2)[1])
            if window._process is not None:
                window._process.wait(5)
            now_s += 0.5
    finally:
        window.close()
    assert news == ['1', '2', '4']


def test_waits_for_the_panel(browser, capsys, tmp_path):
    words = [
        'kiosk',
        '--url',
        'http://127.0.0.1:9',
        '--browser',
        str(browser),
        '--for',
        '0.3',
        *SCREENS,
    ]
    assert main(words) == 0
    assert 'waiting for the panel' in capsys.readouterr().err
    assert not (tmp_path / 'calls').exists()


def test_reads_screens_from_left_to_right():
    assert kiosk.read_xrandr(XRANDR) == [
        Screen(0, 0, 1920, 1080, 'HDMI-1'),
        Screen(1920, 0, 1920, 1080, 'HDMI-2'),
        Screen(3840, 0, 1920, 1200, 'DP-3'),
    ]
    assert kiosk.read_xrandr("Can't open display") == []


@pytest.mark.parametrize(
    ('words', 'code', 'says'),
    [
        (['--browser', 'no-such-browser'], 69, 'no-such-browser: no such browser'),
        (['--screens', 'big', 'small'], 2, 'WIDTHxHEIGHT+X+Y'),
    ],
)
def test_mistakes_are_one_line(capsys, browser, words, code, says):
    base = ['kiosk', '--url', 'http://127.0.0.1:9', '--for', '0.1']
    if '--browser' not in words:
        base += ['--browser', str(browser)]
    assert main([*base, *words]) == code
    text = capsys.readouterr().err
    assert says in text and text.count('\n') == 1


def test_without_a_url_https_is_found(tmp_path, browser, secure_panel, panel, monkeypatch):
    from eol_ros.verbs import kiosk as verb

    urls = ['http://127.0.0.1:9', f'https://127.0.0.1:{secure_panel}']
    monkeypatch.setattr(verb, 'HERE', urls)
    assert main(['kiosk', '--browser', str(browser), '--for', '0.6', *SCREENS]) == 0
    calls = (tmp_path / 'calls').read_text()
    assert f'{urls[1]}/wall/left' in calls
    assert calls.count('--ignore-certificate-errors') == len(calls.splitlines()) >= 2


def test_https_elsewhere_must_be_trusted(capsys, browser, secure_panel):
    url = f'https://{socket.gethostbyname(socket.gethostname())}:{secure_panel}'
    if kiosk.is_here(url):  # the name of this machine stands for the loopback address
        url = f'https://0.0.0.0:{secure_panel}'
    assert main(['kiosk', '--url', url, '--browser', str(browser), *SCREENS]) == 69
    assert 'is not trusted on this machine' in capsys.readouterr().err


def test_another_server_is_not_the_panel(capsys, browser, panel):
    assert main(['kiosk', '--url', f'{panel}/other', '--browser', str(browser), *SCREENS]) == 69
    assert 'not the panel' in capsys.readouterr().err
