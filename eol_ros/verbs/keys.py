# SPDX-License-Identifier: Apache-2.0
"""eol keys: who may reach the graph from other machines (`network: secure`)."""

import shlex
import socket
import sys

from eol_ros.cli import within
from eol_ros.disk import content
from eol_ros.ros import wireguard

HELP = (
    'Manage the keys with which other machines reach a graph with `network: secure`, through '
    'WireGuard. On the machine of the work: make, add, revoke, list. On the other machine: join, '
    'then for example `eol topics --secure`; `env` prints the environment for stock ROS 2 tools '
    '(eval "$(eol keys env)").'
)
EXAMPLES = [
    'eol keys make',
    'eol keys add laptop --endpoint museum.local > laptop.conf',
    'eol keys revoke laptop',
    'eol keys list',
    'eol keys join laptop.conf',
    'eol keys env',
]


def add_arguments(parser):
    """Declare the command line."""
    verbs = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    make = verbs.add_parser('make', help='make the keys of the machine of the work')
    make.add_argument('--subnet', default=wireguard.SUBNET, help='addresses inside of the tunnel')
    make.add_argument(
        '--port', type=within(1, 65535, int), default=wireguard.PORT, help='UDP port to listen on'
    )
    add = verbs.add_parser(
        'add', help='add a key, and print the file for the other machine to join'
    )
    add.add_argument('name', help='name for the key')
    add.add_argument(
        '--endpoint', metavar='HOST[:PORT]', default=socket.gethostname(),
        help='address of this machine for the other one (default: its name)',
    )  # fmt: skip
    add.add_argument('--public', metavar='KEY', default='', help='public key of the other machine')
    revoke = verbs.add_parser('revoke', help='revoke a key')
    revoke.add_argument('name', help='name of the key')
    verbs.add_parser('list', help='list the keys, and whether the tunnel is up')
    join = verbs.add_parser('join', help='install on this machine the file that `add` printed')
    join.add_argument('file', help='the file, or - for standard input')
    verbs.add_parser('env', help='print the environment for stock ROS 2 tools')


def run(args):
    """Change or show the keys."""
    from eol_ros.errors import ConfigError
    from eol_ros.ros import network

    if args.action == 'make':
        keys = wireguard.make(args.subnet, args.port)
        _say(f'{keys.path}: made; it is secret. Bring the tunnel up with `{keys.how_up}`,')
        _say(
            'at every boot with `sudo systemctl enable --now wg-quick@eol0` and a link to the file'
        )
        _say(f'in /etc/wireguard. UDP port {args.port} must reach this machine.')
    elif args.action == 'add':
        keys, theirs = wireguard.add(args.name, args.endpoint, args.public)
        print(theirs, end='')
        _say(f'{args.name} may join as {keys.peers[-1].address}; keep this output secret.')
        _say(_renew(keys))
    elif args.action == 'revoke':
        keys = wireguard.revoke(args.name)
        _say(f'{args.name} may no longer join. {_renew(keys)}')
    elif args.action == 'join':
        try:
            from eol_ros.yaml_text import decoded

            text = decoded(content(args.file)).lstrip('\ufeff')
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, 'strerror', 'not text in UTF-8')
            raise ConfigError(f'{args.file}: {why}') from None
        keys = wireguard.join(text, args.file)
        _say(f'{keys.path}: joined as {keys.address}; `{keys.how_up}` brings the tunnel up')
    elif args.action == 'env':
        for name, value in network.environment('secure').items():
            print(f'export {name}={shlex.quote(value)}')
    else:
        keys = wireguard.read()
        print(f'{keys.address:15}  this machine, {"up" if keys.up else "not up: " + keys.how_up}')
        for peer in keys.peers:
            print(f'{peer.address:15}  {peer.name}  {peer.public}')
    return 0


def _renew(keys):
    if not keys.up:
        return f'It counts when the tunnel is up: {keys.how_up}'
    return f"It counts after `sudo bash -c 'wg syncconf eol0 <(wg-quick strip {keys.path})'`"


def _say(text):
    print(text, file=sys.stderr)
