# SPDX-License-Identifier: Apache-2.0
"""eol kiosk: both walls, full screen."""

import contextlib
import http.client
import ssl
import sys
import time
import urllib.error
import urllib.request

from eol_ros import interrupts
from eol_ros.cli import within

HELP = 'Open the two walls full screen, one on each screen, and bring a lost window back.'
EXAMPLES = [
    'eol kiosk',
    'eol kiosk --swap',
    'eol kiosk --url http://192.168.1.20:8080 --screens 1920x1080+0+0 1920x1080+1920+0',
]


HERE = ['http://127.0.0.1:8080', 'https://127.0.0.1:8080']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        '--url',
        help=f'URL of the panel (default: {HERE[0]}, or the same over HTTPS)',
    )
    parser.add_argument(
        '--swap', action='store_true', help='show the left image on the right screen'
    )
    parser.add_argument(
        '--screens',
        nargs=2,
        metavar='WxH+X+Y',
        help='geometry of both screens, in place of that from xrandr',
    )
    parser.add_argument('--browser', default='', help='command that starts Chromium')
    parser.add_argument(
        '--for', dest='seconds', type=within(0, 1e9), metavar='SECONDS', help='close after SECONDS'
    )


def run(args):
    """Wait for the panel, open both windows, keep them open until Ctrl-C or SIGTERM."""
    from eol_ros.devices.browser import kiosk
    from eol_ros.errors import DeviceMissing

    browser = kiosk.find_browser(args.browser)
    if args.screens:
        places = [kiosk.Screen.parse(text) for text in args.screens]
    else:
        places = kiosk.screens()
        if not places:
            raise DeviceMissing('no screen found by xrandr; name two with --screens')
        if len(places) == 1:
            whole = places[0]
            half = whole.width // 2
            print(f'one screen only ({whole.name}): the walls share it', file=sys.stderr)
            places = [
                kiosk.Screen(whole.x, whole.y, half, whole.height, whole.name),
                kiosk.Screen(whole.x + half, whole.y, half, whole.height, whole.name),
            ]
    shared = len({place.name for place in places}) == 1 and not args.screens
    sides = ('right', 'left') if args.swap else ('left', 'right')
    with interrupts.until_stopped(args.seconds) as goes_on, contextlib.ExitStack() as opened:
        base = _wait_for([args.url] if args.url else HERE, goes_on)
        if not base:
            return 0
        windows = [
            opened.enter_context(
                contextlib.closing(kiosk.Window(browser, f'{base}/wall/{side}', place, not shared))
            )
            for side, place in zip(sides, places[:2], strict=True)
        ]
        while goes_on():
            for window in windows:
                news = window.keep(time.monotonic())
                if news:
                    print(news, file=sys.stderr, flush=True)
            time.sleep(0.1)
    return 0


def _wait_for(urls, goes_on):
    """Wait until the panel answers; return its URL, or an empty text when asked to stop before."""
    from eol_ros.devices.browser import kiosk
    from eol_ros.errors import DeviceMissing, UsageError

    told = False
    while goes_on():
        for url in (url.rstrip('/') for url in urls):
            tls = ssl.create_default_context()
            if kiosk.is_here(url):
                tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
            try:
                urllib.request.urlopen(f'{url}/wall/left', timeout=2, context=tls).close()
                return url
            except urllib.error.HTTPError as error:
                raise DeviceMissing(f'{url}: not the panel of this work ({error})') from None
            except ValueError as error:
                raise UsageError(f'--url {url}: {error}') from None
            except (OSError, http.client.HTTPException) as error:
                if isinstance(getattr(error, 'reason', None), ssl.SSLCertVerificationError):
                    raise DeviceMissing(
                        f'{url}: its certificate is not trusted on this machine; make it one of '
                        "this machine's authorities (update-ca-certificates), or open the walls "
                        'on the machine of the panel'
                    ) from None
        if not told:
            print(f'waiting for the panel at {urls[0]}', file=sys.stderr, flush=True)
            told = True
        time.sleep(0.5)
    return ''
