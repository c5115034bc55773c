# SPDX-License-Identifier: Apache-2.0
"""Which graph a verb means: on this machine or on the network, and in which namespace."""

import argparse

NAMESPACE_HELP = 'of the graph; without it that of the one that runs here, else eol'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what all verbs take that look at a running graph."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--lan', action='store_true', help='look on the network, not only here')
    where.add_argument(
        '--secure', action='store_true', help='look where `eol keys` lets this machine in, too'
    )
    parser.add_argument('--namespace', metavar='NAME', help=NAMESPACE_HELP)


def of(args: argparse.Namespace) -> tuple[str, str]:
    """Return the reach, local, secure or lan, and the namespace.

    Raises ConfigError where this machine has no keys, DeviceMissing where the tunnel is not up.
    """
    from eol_ros.bringup import plan, status
    from eol_ros.errors import DeviceMissing
    from eol_ros.ros import wireguard
    from eol_ros.scene import Scene

    namespace = status.namespace_of(args.namespace, plan.domain(Scene('', {})))
    if args.secure and not (keys := wireguard.read()).up:
        raise DeviceMissing(f'--secure: {keys.address} is not up: {keys.how_up}')
    return 'secure' if args.secure else 'lan' if args.lan else 'local', namespace
