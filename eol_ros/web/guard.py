# SPDX-License-Identifier: Apache-2.0
"""Who may do what: hosts, origins, the PIN, the headers. Pure rules; the server applies them."""

import hmac
import ipaddress
import math
import socket
from collections.abc import Iterable
from itertools import pairwise
from typing import Any
from urllib.parse import urlsplit

from eol_ros.errors import ConfigError

HEADERS = {
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
        "media-src 'self'; "
        "connect-src 'self'; worker-src 'self'; manifest-src 'self'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'self'"
    ),
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Permissions-Policy': 'camera=(), microphone=(), geolocation=()',
}
PRIVATE = ('image', 'sound')  # channels that show and let hear the people at the table
FREE_TRIES = 3  # wrong PINs from an address before it has to wait
LONGEST_WAIT_S = 86_400.0  # for an address that never gave the right PIN
LONGEST_KNOWN_WAIT_S = 900.0
FORGOTTEN_S = 7 * 86_400.0  # time for which wrong PINs of an address count
MOST_GUESSERS = 256  # addresses counted one by one: all of a /24 network
MOST_KNOWN = 256
_OTHERS = ''  # key of all further addresses


def is_loopback(host: str) -> bool:
    """Return whether an address to serve on is reachable from this machine only."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_settings(host: str, pin: str) -> None:
    """Raise ConfigError when the panel would be open to the network with no PIN or a weak one."""
    if pin and not (pin.isascii() and pin.isprintable() and 6 <= len(pin) <= 64):
        raise ConfigError(
            'panel.pin: must have 6 to 64 ASCII characters, such as six digits or a passphrase'
        )
    if pin and len({ord(b) - ord(a) for a, b in pairwise(pin)}) == 1:
        raise ConfigError('panel.pin: is easy to guess; choose another')
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
    """Checks the PIN. An address waits longer after each wrong one: 2 s, 4 s ... a day.

    An address is an IPv4 address, or the 64-bit network of an IPv6 address. Each waits only for its
    own wrong PINs. MOST_GUESSERS addresses are counted one by one; further addresses count as one.
    An address that has given the right PIN is known: it waits 15 min at most, and is always counted
    by itself.
    """

    def __init__(self, pin: str):
        self._pin = pin
        self._wrong: dict[str, tuple[int, float]] = {}  # how many, and when the last
        self._known: dict[str, None] = {}  # in order of their last right PIN

    @property
    def needed(self) -> bool:
        """Whether there is a PIN at all."""
        return bool(self._pin)

    @property
    def known(self) -> list[str]:
        """Addresses that have given the right PIN, to be persisted over a restart."""
        return list(self._known)

    def remember(self, known: Any) -> None:
        """Restore persisted addresses, as far as they are valid."""
        found = [a for a in known if isinstance(a, str)] if isinstance(known, list) else []
        self._known = dict.fromkeys(found[-MOST_KNOWN:])

    def wait_s(self, address: str, now_s: float) -> float:
        """Return for how many seconds no PIN is taken from `address`; 0: one may be tried now."""
        key = self._counted_as(address)
        count, last_s = self._wrong.get(key, (0, -math.inf))
        if count < FREE_TRIES:
            return 0.0
        longest_s = LONGEST_KNOWN_WAIT_S if key in self._known else LONGEST_WAIT_S
        pause_s = min(2.0 ** min(count - FREE_TRIES + 1, 30), longest_s)
        return max(last_s + pause_s - now_s, 0.0)

    def check(self, given: str, address: str, now_s: float) -> str:
        """Return 'ok', 'wrong' or 'locked': not looked at, for the address has to wait."""
        if not self._pin:
            return 'ok'
        if self.wait_s(address, now_s) > 0:
            return 'locked'
        if hmac.compare_digest(given.encode('utf-8', 'replace'), self._pin.encode()):
            self._know(network_of(address))
            return 'ok'
        if given:  # a control tried without any PIN is no guess
            if len(self._wrong) >= MOST_GUESSERS:
                self._forget(now_s)
            key = self._counted_as(address)
            count, last_s = self._wrong.get(key, (0, now_s))
            if now_s - last_s > FORGOTTEN_S:
                count = 0
            self._wrong[key] = count + 1, now_s
        return 'wrong'

    def _counted_as(self, address: str) -> str:
        """Return the key that counts the wrong PINs of an address."""
        key = network_of(address)
        alone = key in self._known or key in self._wrong or len(self._wrong) < MOST_GUESSERS
        return key if alone else _OTHERS

    def _know(self, key: str) -> None:
        self._wrong.pop(key, None)
        self._known.pop(key, None)
        self._known[key] = None
        while len(self._known) > MOST_KNOWN:
            self._known.pop(next(iter(self._known)))

    def _forget(self, now_s: float) -> None:
        old = [key for key, (_, last_s) in self._wrong.items() if now_s - last_s > FORGOTTEN_S]
        for key in old:
            del self._wrong[key]


def network_of(address: str) -> str:
    """Return what one guesser has at hand: an IPv4 address, or 64 bits of an IPv6 address."""
    try:
        found = ipaddress.ip_address(address.partition('%')[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return address
    if found.ipv4_mapped:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, 64), strict=False))
