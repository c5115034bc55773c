# SPDX-License-Identifier: Apache-2.0
"""What bringup tells systemd: that it has started, how it is, that it still runs, that it stops.

The protocol of sd_notify(3): datagrams of `NAME=value` lines to the socket that $NOTIFY_SOCKET
names. Started by anything else, nothing is told and nothing costs.
"""

import os
import socket
import time
from collections.abc import Callable, MutableMapping

STATUS_S = 1.0  # no status is told more often


class ServiceManager:
    """Tell the service manager that started this process, if one did, how it is.

    Takes its variables out of `environ`, so that no child speaks in the name of this process.
    """

    def __init__(
        self,
        environ: MutableMapping[str, str] = os.environ,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._clock, self._status, self._told_s = clock, '', -STATUS_S
        self._ready = False
        self._address = environ.pop('NOTIFY_SOCKET', '').replace('@', '\0', 1)
        period_us, watched = environ.pop('WATCHDOG_USEC', ''), environ.pop('WATCHDOG_PID', '')
        ours = watched in ('', str(os.getpid()))
        # As sd_watchdog_enabled(3) advises: twice as often as is asked.
        self._beat_s = int(period_us) * 0.5e-6 if period_us.isdigit() and ours else 0.0
        self._beaten_s = clock()
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def __enter__(self) -> 'ServiceManager':
        return self

    def __exit__(self, *_exc: object) -> None:
        if self._socket is not None:
            self._socket.close()

    @property
    def there(self) -> bool:
        """Whether a service manager started this process."""
        return self._socket is not None

    def ready(self) -> None:
        """Say, once, that the nodes are being started and watched."""
        if not self._ready:
            self._ready = True
            self._tell('READY=1')

    def status(self, text: str) -> None:
        """Say in a line how the work is; `systemctl status` shows it."""
        now = self._clock()
        if text != self._status and now - self._told_s >= STATUS_S:
            self._status, self._told_s = text, now
            self._tell(f'STATUS={text}')

    def beat(self) -> None:
        """Say that the loop turns; to be called several times a second."""
        now = self._clock()
        if self._beat_s and now - self._beaten_s >= self._beat_s:
            self._beaten_s = now
            self._tell('WATCHDOG=1')

    def stopping(self) -> None:
        """Say that the end has begun."""
        self._tell('STOPPING=1')

    def _tell(self, line: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(line.encode(), self._address)
        except OSError:
            pass  # it listens no longer, or not just now: the next line tells again
