# SPDX-License-Identifier: Apache-2.0
"""Who may do what: hosts, origins, the PIN, the headers. Pure rules; the server applies them."""

import hmac
import ipaddress
import socket
from collections.abc import Iterable
from urllib.parse import urlsplit

from eol_ros.errors import ConfigError

HEADERS = {
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
        "connect-src 'self'; worker-src 'self'; manifest-src 'self'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'self'"
    ),
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Permissions-Policy': 'camera=(), microphone=(), geolocation=()',
}
TRIES = 5
TRIES_PERIOD_S = 60.0


def is_loopback(host: str) -> bool:
    """Return whether an address to serve on is reachable from this machine only."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_settings(host: str, pin: str) -> None:
    """Raise ConfigError when the panel would be open to the network without a PIN."""
    if pin and not (pin.isascii() and pin.isprintable() and 4 <= len(pin) <= 32):
        raise ConfigError('panel.pin: 4 to 32 plain characters')
    if not is_loopback(host) and not pin:
        raise ConfigError(
            f'panel.host: {host} opens the panel to the network; set panel.pin too, which every'
            ' control will ask for'
        )


def _bare(host: str) -> str:
    """Return the name in a Host header, without port and brackets, in lower case."""
    try:
        return (urlsplit(f'//{host}').hostname or '').rstrip('.')
    except ValueError:
        return ''


def host_allowed(host: str, open_to_network: bool, names: Iterable[str] = ()) -> bool:
    """Return whether a Host header names this server.

    A foreign name that resolves to us (DNS rebinding) is refused; when open, addresses and the
    machine's own name are fine.
    """
    name = _bare(host)
    if is_loopback(name) or name in {n.lower() for n in names}:
        return True
    if not open_to_network:
        return False
    own = socket.gethostname().lower()
    if name in {own, f'{own}.local', own.split('.')[0]}:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def same_origin(origin: str | None, host: str) -> bool:
    """Return whether a request comes from our own pages; programs send no Origin and pass."""
    if origin is None:
        return True
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ('http', 'https') and parts.netloc.lower() == host.lower() != ''


class PinGate:
    """Asks for the PIN; five wrong ones from an address lock it out for a minute."""

    def __init__(self, pin: str):
        self._pin = pin
        self._wrong: dict[str, list[float]] = {}

    @property
    def needed(self) -> bool:
        """Whether there is a PIN at all."""
        return bool(self._pin)

    def check(self, given: str, address: str, now_s: float) -> str:
        """Return 'ok', 'wrong' or 'locked'."""
        if not self._pin:
            return 'ok'
        recent = [t for t in self._wrong.get(address, ()) if now_s - t < TRIES_PERIOD_S]
        if len(recent) >= TRIES:
            return 'locked'
        if hmac.compare_digest(given.encode('utf-8', 'replace'), self._pin.encode()):
            self._wrong.pop(address, None)
            return 'ok'
        if given:  # a control tried without any PIN is no guess
            if len(self._wrong) > 4096:
                self._wrong.clear()
            self._wrong[address] = [*recent, now_s]
        return 'wrong'
