# SPDX-License-Identifier: Apache-2.0
"""Which graph a verb means: on this machine or on the network, and in which namespace."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import Any

NAMESPACE_HELP = 'namespace of the graph (default: that of the graph on this machine, else eol)'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what all verbs take that look at a running graph."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--lan', action='store_true', help='search the network, not only this machine'
    )
    where.add_argument(
        '--secure',
        action='store_true',
        help='also search graphs that this machine has a key for (`eol keys`)',
    )
    parser.add_argument('--namespace', metavar='NAME', help=NAMESPACE_HELP)


def of(args: argparse.Namespace) -> tuple[str, str]:
    """Return the reach, local, secure or lan, and the namespace.

    Raises ConfigError where this machine has no keys, DeviceMissing where the tunnel is not up.
    """
    from eol_ros.bringup import status
    from eol_ros.errors import DeviceMissing
    from eol_ros.ros import network, wireguard

    namespace = status.namespace_of(args.namespace, network.domain())
    if args.secure and not (keys := wireguard.read()).up:
        raise DeviceMissing(f'--secure: {keys.address} is not up: {keys.how_up}')
    return 'secure' if args.secure else 'lan' if args.lan else 'local', namespace


def running(args: argparse.Namespace) -> tuple[str, str]:
    """Return as `of`; raise DeviceMissing at once where nothing of a graph runs on this machine."""
    from eol_ros.bringup import status
    from eol_ros.errors import DeviceMissing
    from eol_ros.ros import network

    where, domain = of(args), network.domain()
    alone = where[0] == 'local' and not status.namespaces(domain)
    if alone and network.participants(domain) is False:
        raise DeviceMissing(
            f'no graph runs on domain {domain}: {status.how_to_start()}; --secure and --lan look'
            ' further'
        )
    return where


def status_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return what the supervisor of the graph on this machine says; see bringup.status.ask."""
    from eol_ros.bringup import status
    from eol_ros.ros import network

    domain = network.domain()
    return status.ask(domain, namespace=status.namespace_of(args.namespace, domain))


@contextlib.contextmanager
def asking(node: str, args: argparse.Namespace) -> Iterator[None]:
    """Let a DeviceMissing about `node` say what the supervisor knows of it, where one runs here."""
    from eol_ros.bringup import status
    from eol_ros.errors import DeviceMissing, EolError

    try:
        yield
    except DeviceMissing as error:
        if not node or args.lan or args.secure:
            raise
        try:
            found = status_of(args)
        except EolError:
            raise error from None
        row = next((row for row in found['nodes'] if row['node'] == node), None)
        if row is None:
            why = f'{node} is not in the scene {found["scene"]}, which runs here'
        else:
            why = f'{node} does not answer; it is {status.WORDS[row["level"]]}: {row["text"]}'
        raise DeviceMissing(why) from None
