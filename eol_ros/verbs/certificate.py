# SPDX-License-Identifier: Apache-2.0
"""eol certificate: let browsers reach the panel over HTTPS."""

import datetime
import socket
import sys
from pathlib import Path

HELP = (
    'Make a certificate for the panel, so that browsers reach it over HTTPS: what is typed and '
    'shown cannot be read on the way, and sound plays in browsers on other machines, which they '
    'allow over HTTPS alone. Or show the certificate of a file. Needs the extra `tls`.'
)
EXAMPLES = [
    'eol certificate',
    'eol certificate echoes.museum 192.168.1.20 --output /etc/eol/panel.pem',
    'eol certificate --show panel.pem',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'names', nargs='*', metavar='NAME',
        help='host names and addresses under which browsers reach it (default: those of this '
        'machine)',
    )  # fmt: skip
    parser.add_argument(
        '-o', '--output', metavar='FILE', default='panel.pem', help='the file to write'
    )
    parser.add_argument('--show', metavar='FILE', help='say for whom and until when one is valid')


def run(args):
    """Make one, or show one."""
    from eol_ros.web import certificate

    now = datetime.datetime.now(datetime.timezone.utc)
    if args.show:
        found = certificate.read(args.show)
    else:
        path = Path(args.output).expanduser().absolute()
        found = certificate.make(path, args.names or _own_names(), now)
        print(f'{path}: certificate and private key; keep it to yourself', file=sys.stderr)
        print(f'in the scene: panel: {{certificate: {path}}}', file=sys.stderr)
        print(
            'a browser asks once whether to trust it: compare the fingerprint it shows',
            file=sys.stderr,
        )
    for name in certificate.names_of(found):
        print(f'name         {name}')
    left = certificate.days_left(found, now)
    print(f'valid until  {found.not_valid_after_utc:%Y-%m-%d} ({left:.0f} days)')
    print(f'SHA-256      {certificate.fingerprint(found)}')
    return 0 if left > 0 else 1


def _own_names():
    """Return the names and addresses of this machine, its own name first."""
    own = socket.gethostname().lower()
    names = [own] if '.' in own else [own, f'{own}.local']
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.connect(('192.0.2.1', 9))  # sends nothing; tells which address would be used
            names.append(sock.getsockname()[0])
        except OSError:
            pass  # no network yet
    return list(dict.fromkeys([*names, 'localhost', '127.0.0.1', '::1']))
