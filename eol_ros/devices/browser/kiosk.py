# SPDX-License-Identifier: Apache-2.0
"""Browser windows that fill a screen each, with a throw-away profile, and come back when lost."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from eol_ros import parent_death
from eol_ros.devices.backoff import Backoff
from eol_ros.errors import DeviceMissing, UsageError

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
FLAGS = (
    '--noerrdialogs',
    '--no-first-run',
    '--no-default-browser-check',
    '--disable-session-crashed-bubble',
    '--disable-component-update',
    '--disable-background-networking',
    '--disable-sync',
    '--disable-pinch',
    '--overscroll-history-navigation=0',
    '--autoplay-policy=no-user-gesture-required',
)
# Of this machine: nobody stands between, and its certificate names other names, or itself alone.
TRUSTING = ('--ignore-certificate-errors', '--test-type')
LOG_BYTES = 1_000_000  # of what a browser says; it may run for months
SETTLED_S = 20.0  # a window that lived this long failed for another reason, not the same


@dataclass(frozen=True)
class Screen:
    """A screen of the desktop, in its pixels."""

    x: int
    y: int
    width: int
    height: int
    name: str = ''

    @classmethod
    def parse(cls, text: str) -> 'Screen':
        """Return the screen of `1920x1080+1920+0`."""
        match = re.fullmatch(r'(\d+)x(\d+)\+(\d+)\+(\d+)', text)
        if not match:
            raise UsageError(f'{text!r} is not a screen; write WIDTHxHEIGHT+X+Y')
        width, height, x, y = (int(part) for part in match.groups())
        return cls(x, y, width, height)


def screens() -> list[Screen]:
    """Return the connected screens from left to right, by xrandr; empty where that cannot tell."""
    try:
        text = subprocess.run(
            ['xrandr', '--query'], capture_output=True, text=True, timeout=5, check=True
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return []
    return read_xrandr(text)


def read_xrandr(text: str) -> list[Screen]:
    """Return the active screens in the output of `xrandr --query`, from left to right."""
    found = re.findall(r'^(\S+) connected (?:primary )?(\d+)x(\d+)\+(\d+)\+(\d+)', text, re.M)
    rows = [Screen(int(x), int(y), int(w), int(h), name) for name, w, h, x, y in found]
    return sorted(rows, key=lambda s: (s.x, s.y))


def find_browser(name: str) -> str:
    """Return the path of the browser; raises DeviceMissing."""
    for each in (name,) if name else BROWSERS:
        path = shutil.which(each)
        if path:
            return path
    if name:
        raise DeviceMissing(f'{name}: no such browser')
    raise DeviceMissing('no Chromium found: apt install chromium, or name one with --browser')


def is_here(url: str) -> bool:
    """Return whether a URL is served over HTTPS by this very machine."""
    parts = urlsplit(url)
    return parts.scheme == 'https' and parts.hostname in ('127.0.0.1', '::1', 'localhost')


class Window:
    """One full-screen browser window; `keep` brings it back when it is gone."""

    def __init__(self, browser: str, url: str, screen: Screen, full_screen: bool = True):
        self.url, self.screen = url, screen
        self._profile = Path(tempfile.mkdtemp(prefix='eol-wall-'))
        self._command = [
            browser,
            f'--user-data-dir={self._profile}',
            f'--window-position={screen.x},{screen.y}',
            f'--window-size={screen.width},{screen.height}',
            *(('--kiosk',) if full_screen else ()),
            *FLAGS,
            *(TRUSTING if is_here(url) else ()),
            f'--app={url}',
        ]
        self._backoff = Backoff()
        self._process: subprocess.Popen | None = None
        self._log = self._profile / 'eol-browser.log'
        self._due_s = 0.0
        self._since_s = 0.0
        self.starts = 0

    def keep(self, now_s: float) -> str:
        """Start the window when it is due; return what happened, or an empty text."""
        if self._process is not None:
            code = self._process.poll()
            if code is None:
                self._bound_log()
                return ''
            self._process = None
            if now_s - self._since_s > SETTLED_S:
                self._backoff.succeeded()
            wait_s = self._backoff.failed()
            self._due_s = now_s + wait_s
            how = f'code {code}' + (f': {why}' if (why := self._last_words()) else '')
            return f'{self.url}: the window is gone ({how}); again in {wait_s:g} s'
        if now_s < self._due_s:
            return ''
        try:
            self._log.write_bytes(b'')
            with self._log.open('ab') as appended:  # appended to: it may be truncated meanwhile
                self._process = subprocess.Popen(
                    self._command, stdin=subprocess.DEVNULL, stdout=appended, stderr=appended,
                    preexec_fn=parent_death.following(signal.SIGTERM),
                )  # fmt: skip
        except OSError as error:
            raise DeviceMissing(f'{self._command[0]}: {error.strerror}') from None
        self._since_s = now_s
        self.starts += 1
        place = self.screen
        return f'{self.url}: on {place.width}x{place.height} at {place.x},{place.y}'

    def _last_words(self) -> str:
        """Return why the browser says it ended: its last error, else its last line."""
        try:
            lines = [line.strip() for line in self._log.read_text(errors='replace').splitlines()]
        except OSError:
            return ''
        # Chromium begins a line with [process:thread:time:ERROR:file(line)].
        lines = [re.sub(r'^\[[^\]]*\] *', '', line) for line in lines if line]
        errors = [line for line in lines if re.search('error|fail|missing|cannot', line, re.I)]
        return (errors or lines or [''])[-1][:200]

    def _bound_log(self) -> None:
        with contextlib.suppress(OSError):
            if self._log.stat().st_size > LOG_BYTES:
                os.truncate(self._log, 0)

    def close(self) -> None:
        """Close the window and throw its profile away."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(5)
        for _ in range(5):  # a browser's children may write for a moment longer
            shutil.rmtree(self._profile, ignore_errors=True)
            if not self._profile.exists():
                break
            time.sleep(0.2)
