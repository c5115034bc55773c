# SPDX-License-Identifier: Apache-2.0
"""Tells people what lasts: a webhook and mail, from threads that may be stuck for ever.

The supervisor hands its status over and goes on; each way out has a thread and a short queue of its
own, so that a server that hangs delays nothing but itself.
"""

import contextlib
import email.utils
import http.client
import json
import platform
import re
import shutil
import smtplib
import ssl
import threading
import time
import urllib.error
import urllib.request
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from email.message import EmailMessage
from pathlib import Path
from typing import Any

from eol_ros import folders
from eol_ros.bringup.lasting import Lasting, RestartStorms, Sums, of_disk, of_nodes
from eol_ros.devices.address import host_and_port
from eol_ros.devices.files.day_file import DayFile
from eol_ros.devices.files.time_zone import clock_is_set
from eol_ros.errors import ConfigError, EolError
from eol_ros.said import from_message, said, translated
from eol_ros.scene import Scene
from eol_ros.settings import NotifySettings, RecorderSettings

TIMEOUT_S = 10.0  # of each step of a conversation with a server
AGAIN_S = 30.0, 900.0  # a message that was not taken is sent again so much later, then less often
QUEUE = 20  # messages that wait; beyond it the oldest goes
LOOK_S = 1.0
DISK_S = 60.0
_MAIL = re.compile(r'[^@\s]+@[^@\s]+')


class NotDelivered(EolError):
    """A server did not take a message."""


class Message(dict[str, Any]):
    """What a webhook gets as JSON; `text` is all of it in words, as chats and mail show it."""

    def __init__(
        self, kind: str, scene: str, title: str, texts: tuple[str, ...] = (), language: str = 'en',
        work: str = '',
    ):  # fmt: skip
        host = platform.node()
        title = said('of_scene', scene=scene, host=host, title=title)
        title, work, *lines = (translated(text, language) for text in (title, work, *texts))
        super().__init__(
            kind=kind, scene=scene, host=host, title=title, work=work, lines=lines,
            text='\n'.join([title, *(f'- {line}' for line in (work, *lines) if line)]),
            time=time.strftime('%Y-%m-%dT%H:%M:%S%z'),
        )  # fmt: skip


def mistakes(settings: NotifySettings) -> Iterator[tuple[str, str]]:
    """Yield what cannot be meant, each with the setting."""
    if not settings.webhook and not settings.mail_to:
        yield 'webhook', 'no receiver: give webhook or mail_to'
    if settings.webhook and not re.fullmatch('https?://[!-~]+', settings.webhook):
        yield 'webhook', 'is not an address that begins with https:// or http://'
    for address in settings.mail_to:
        if not _MAIL.fullmatch(address):
            yield 'mail_to', f'{address!r} is not a mail address'
    if settings.mail_to and not _MAIL.fullmatch(settings.mail_from):
        yield 'mail_from', f'{settings.mail_from!r} is not a mail address, which mail needs'
    if settings.mail_to and host_and_port(settings.smtp) is None:
        yield 'smtp', f'{settings.smtp!r} is not HOST:PORT, such as mail.museum.at:587'
    if settings.smtp_user and settings.smtp_security == 'none':
        yield 'smtp_user', 'would send the password in clear: choose smtp_security: starttls or tls'
    if settings.daily and _minutes(settings.daily) is None:
        yield 'daily', f'{settings.daily!r} is not a time of day such as 20:00'


def check(settings: NotifySettings) -> None:
    """Raise ConfigError with a line for each mistake."""
    if found := [f'notify.{name}: {what}' for name, what in mistakes(settings)]:
        raise ConfigError('\n'.join(found))


def _minutes(text: str) -> int | None:
    match = re.fullmatch(r'([01]?\d|2[0-3]):([0-5]\d)', text)
    return 60 * int(match[1]) + int(match[2]) if match else None


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """A POST that is redirected would arrive as a GET, without the message."""

    def redirect_request(self, *_args: Any, **_options: Any) -> None:
        return None


class Webhook:
    """Posts messages as JSON to an address."""

    name = 'webhook'

    def __init__(self, url: str):
        self._url = url
        self._opener = urllib.request.build_opener(_NoRedirect)

    def send(self, message: Mapping[str, Any]) -> str:
        """Send it; return what the server said; raise NotDelivered where it did not take it."""
        request = urllib.request.Request(
            self._url,
            json.dumps(message).encode(),
            {'Content-Type': 'application/json', 'User-Agent': 'eol_ros'},
        )
        try:
            with self._opener.open(request, timeout=TIMEOUT_S) as answer:
                return f'HTTP {answer.status}'
        except urllib.error.HTTPError as error:
            error.close()
            raise NotDelivered(f'HTTP {error.code}') from None
        except urllib.error.URLError as error:
            raise NotDelivered(f'{error.reason}') from None
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise NotDelivered(f'{error or type(error).__name__}') from None


class Mail:
    """Hands messages to a mail server."""

    name = 'mail'

    def __init__(self, settings: NotifySettings, context: ssl.SSLContext | None = None):
        self._settings, self._context = settings, context
        self._server = host_and_port(settings.smtp) or ('', 0)

    def send(self, message: Mapping[str, Any]) -> str:
        """Send it; return what the server is called; raise NotDelivered where it refused."""
        s = self._settings
        mail = EmailMessage()
        mail['From'], mail['To'] = s.mail_from, ', '.join(s.mail_to)
        mail['Subject'] = message['title']
        mail['Date'], mail['Message-ID'] = email.utils.localtime(), email.utils.make_msgid()
        mail['Auto-Submitted'] = 'auto-generated'  # RFC 3834: no answers of absent people
        mail.set_content(message['text'])
        try:
            with self._connected() as server:
                if s.smtp_security == 'starttls':
                    server.starttls(context=self._context or ssl.create_default_context())
                if s.smtp_user:
                    server.login(s.smtp_user, s.smtp_password)
                refused = server.send_message(mail)
        except smtplib.SMTPResponseException as error:
            said = error.smtp_error
            words = said.decode(errors='replace') if isinstance(said, bytes) else str(said)
            raise NotDelivered(f'{error.smtp_code} {words}') from None
        except (OSError, smtplib.SMTPException, ValueError) as error:
            raise NotDelivered(f'{error or type(error).__name__}') from None
        if refused:
            raise NotDelivered(f'not for {", ".join(refused)}')
        return f'taken by {s.smtp}'

    def _connected(self) -> smtplib.SMTP:
        host, port = self._server
        if self._settings.smtp_security == 'tls':
            context = self._context or ssl.create_default_context()
            return smtplib.SMTP_SSL(host, port, timeout=TIMEOUT_S, context=context)
        return smtplib.SMTP(host, port, timeout=TIMEOUT_S)


def ways(settings: NotifySettings) -> list['Webhook | Mail']:
    """Return the ways by which these settings send messages."""
    found: list[Webhook | Mail] = [Webhook(settings.webhook)] if settings.webhook else []
    return found + ([Mail(settings)] if settings.mail_to else [])


class Sender:
    """Sends messages by one way, in a thread; one that is not taken is tried again.

    `trouble` says why the last try failed; empty where it did not.
    """

    def __init__(self, way: Any, again_s: tuple[float, float] = AGAIN_S):
        self._way, self._again_s = way, again_s
        self._queue: deque[Message] = deque(maxlen=QUEUE)
        self._change = threading.Condition()
        self._ended = False
        self.trouble = ''
        self._thread = threading.Thread(target=self._run, name=f'notify {way.name}', daemon=True)

    def put(self, message: Message) -> None:
        """Let it be sent; never waits for a server."""
        with self._change:
            if not self._thread.is_alive():
                self._thread.start()
            self._queue.append(message)
            self._change.notify()

    def end(self) -> None:
        """Send no more; one that is being sent may still arrive, and nobody waits for it."""
        with self._change:
            self._ended = True
            self._change.notify()

    def _run(self) -> None:
        wait_s = self._again_s[0]
        while True:
            with self._change:
                while not self._queue and not self._ended:
                    self._change.wait()
                if self._ended:
                    return
                message = self._queue[0]
            try:
                self._way.send(message)
            except NotDelivered as error:
                self.trouble = f'{self._way.name}: {error}'
            except Exception as error:  # a thread that dies would tell nobody of anything
                self.trouble = f'{self._way.name}: {error!r}'
            else:
                self.trouble, wait_s = '', self._again_s[0]
                with self._change, contextlib.suppress(ValueError):
                    self._queue.remove(message)  # by then a newer one may have taken its place
                continue
            with self._change:
                self._change.wait_for(lambda: self._ended, wait_s)
            wait_s = min(2 * wait_s, self._again_s[1])


class Notifier:
    """What lasts in a run becomes messages; each call of `look` costs microseconds.

    Parameters
    ----------
    scene : Scene
        With `notify`.
    wall : callable
        System time in seconds.
    """

    def __init__(self, scene: Scene, wall: Callable[[], float] = time.time):
        settings = scene.notify
        assert settings is not None
        check(settings)
        self._scene, self._settings, self._wall = scene, settings, wall
        self._senders = [Sender(way) for way in ways(settings)]
        self._lasting, self._storms = Lasting(settings.pause_s), RestartStorms()
        self._sums, self._looked_s = Sums(), float('-inf')
        self._file = DayFile(f'{scene.name}-{scene.namespace}', 'sums')
        self._sums.resume(self._file.load())
        self._recorder: RecorderSettings | None = scene.nodes.get('recorder')
        self._free_bytes: float | None = None
        self._work: str = ''
        self._ended = threading.Event()
        threading.Thread(target=self._keep_house, name='notify disk', daemon=True).start()

    @property
    def trouble(self) -> str:
        """Why messages do not arrive; empty where they do."""
        return '; '.join(sender.trouble for sender in self._senders if sender.trouble)

    def look(
        self, now_s: float, status: Mapping[str, Any], restarts: Mapping[str, int]
    ) -> Message | None:
        """Take the status of a run (`Supervisor.describe`), and how often each process was started
        again; return what is sent, if anything is.
        """
        if now_s - self._looked_s < LOOK_S:
            return None
        self._looked_s, rows, after_s = now_s, status['nodes'], self._settings.after_s
        self._sums.take(now_s, rows, status['restarts'])
        faults = [*of_nodes(rows, after_s), *self._storms.look(now_s, restarts)]
        if self._recorder:
            faults += of_disk(self._free_bytes, self._recorder.min_free_gb, after_s)
        self._work = from_message(**status['work'])
        message = self._day(now_s)
        if news := self._lasting.look(now_s, faults):
            over = tuple(said('well_again', what=what) for what in news.over)
            count = len(news.lasting)
            title = said('faults', count=count) if count else said('all_well')
            message = self._message('trouble' if count else 'well', title, news.lasting + over)
        if message:
            for sender in self._senders:
                sender.put(message)
        return message

    def end(self) -> None:
        """Keep the sums of the day, and send no more."""
        self._ended.set()
        self._file.save(self._sums.kept(), float('inf'))
        for sender in self._senders:
            sender.end()

    def _day(self, now_s: float) -> Message | None:
        """Return the sum of a day when it is due; one whose time came without power, later."""
        wall_s, daily = self._wall(), _minutes(self._settings.daily)
        if daily is None or not clock_is_set(wall_s):
            return None
        if not 0 < self._sums.since_s <= wall_s:
            self._sums.since_s = wall_s
        if wall_s < next_time(self._sums.since_s, daily):
            return None
        title, since_s = self._sums.words(), self._sums.since_s
        self._sums.begin(wall_s)
        date = time.strftime('%Y-%m-%d', time.localtime(since_s))
        title = said('of_day', date=date, sums=title)
        return self._message('day', title, self._lasting.words(now_s))

    def _message(self, kind: str, title: str, lines: tuple[str, ...]) -> Message:
        language = self._settings.language
        return Message(kind, self._scene.name, title, lines, language, self._work)

    def _keep_house(self) -> None:
        """Look at the disk now and then, and keep the sums: one that hangs hangs this thread."""
        folder = Path(self._recorder.folder if self._recorder else '/').expanduser()
        while True:
            with contextlib.suppress(OSError):
                self._free_bytes = shutil.disk_usage(folders.nearest(folder)).free
            if self._ended.wait(DISK_S):
                return
            self._file.save(self._sums.kept(), float('inf'))


def next_time(after_s: float, minutes: int) -> float:
    """Return the first system time after `after_s` at which local clocks show a time of day."""
    then = time.localtime(after_s)
    for day in range(3):
        date = (then.tm_year, then.tm_mon, then.tm_mday + day, minutes // 60, minutes % 60, 0)
        found = time.mktime((*date, 0, 0, -1))
        if found > after_s:
            return found
    raise AssertionError
