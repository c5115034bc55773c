# SPDX-License-Identifier: Apache-2.0
"""Where other machines are reached."""

import contextlib
import ipaddress
from collections.abc import Iterable

from eol_ros.errors import ConfigError

BROADCAST = ipaddress.IPv4Address('255.255.255.255')


def host_and_port(text: str) -> tuple[str, int] | None:
    """Return what HOST:PORT names, [ADDRESS]:PORT for IPv6; None where it is not that."""
    host, _, port = text.rpartition(':')
    good = host and port.isdigit() and 0 < int(port) < 65536
    return (host.strip('[]'), int(port)) if good else None


def target(text: str) -> tuple[str, int]:
    """Return what HOST:PORT names; raise ConfigError where it is not that."""
    found = host_and_port(text)
    if found is None:
        raise ConfigError(f'{text!r}: give HOST:PORT, such as 127.0.0.1:57120')
    return found


def own_address(text: str) -> str:
    """Return an IPv4 address of this machine, or ''; raise ConfigError where it is neither."""
    if not text:
        return ''
    with contextlib.suppress(ValueError):
        found = ipaddress.IPv4Address(text)
        if not (found.is_multicast or found.is_unspecified or found == BROADCAST):
            return str(found)
    what = "give the IPv4 address of one of this machine's network cards, such as 10.0.0.1"
    raise ConfigError(f'{text!r}: {what}')


def networks(peers: Iterable[str]) -> list[ipaddress.IPv4Network]:
    """Return this machine and `peers` as networks; raise ConfigError that names what is none."""
    found = [ipaddress.IPv4Network('127.0.0.0/8')]
    for peer in peers:
        try:
            found.append(ipaddress.IPv4Network(peer, strict=False))
        except ValueError:
            what = 'give an IPv4 address or network, such as 10.0.0.5 or 10.0.0.0/24'
            raise ConfigError(f'{peer!r}: {what}') from None
    return found
