# SPDX-License-Identifier: Apache-2.0
"""Which graph a verb means: on this machine or on the network, and in which namespace."""

import argparse

NAMESPACE_HELP = 'of the graph; without it that of the one that runs here, else eol'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what all verbs take that look at a running graph."""
    parser.add_argument('--lan', action='store_true', help='look on the network, not only here')
    parser.add_argument('--namespace', metavar='NAME', help=NAMESPACE_HELP)


def of(args: argparse.Namespace) -> tuple[str, str]:
    """Return the reach, local or lan, and the namespace."""
    from eol_ros.bringup import plan, status
    from eol_ros.scene import Scene

    namespace = status.namespace_of(args.namespace, plan.domain(Scene('', {})))
    return 'lan' if args.lan else 'local', namespace
