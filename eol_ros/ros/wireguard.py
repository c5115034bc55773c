# SPDX-License-Identifier: Apache-2.0
"""The keys of `network: secure`: one WireGuard configuration file, which `wg-quick` brings up.

WireGuard lets in who has a key and answers nobody else, and the kernel does it before any of our
code or DDS's sees a packet. The file is all there is: who is let in stands in it, each with a name.
J. Donenfeld, WireGuard: Next Generation Kernel Network Tunnel, NDSS 2017; `man wg-quick`.
"""

import ipaddress
import re
import socket
import subprocess
from dataclasses import dataclass
from pathlib import Path

from eol_ros import folders
from eol_ros.disk import DISK
from eol_ros.errors import ConfigError, DeviceMissing

INTERFACE = 'eol0'
PORT = 51820
SUBNET = '10.77.0.0/24'
KEEPALIVE_S = 25  # keeps a router between the two from forgetting them
# Linux takes what is for any of its addresses from any of its cables. What is for the tunnel comes
# through the tunnel, or not at all; and what is to go into it goes nowhere else while it is down.
_GUARD = """\
PostUp = nft 'add table inet %i; flush table inet %i'
PostUp = nft 'add chain inet %i input {{ type filter hook input priority -300; }}'
PostUp = nft 'add rule inet %i input iifname != {{ "%i", "lo" }} ip daddr {subnet} drop'
PostUp = nft 'add rule inet %i input iifname != {{ "%i", "lo" }} ip saddr {subnet} drop'
PostUp = nft 'add chain inet %i output {{ type filter hook output priority 0; }}'
PostUp = nft 'add rule inet %i output oifname != {{ "%i", "lo" }} ip daddr {subnet} drop'
"""
_NAME = re.compile(r'[\w][\w.-]{0,30}')


@dataclass(frozen=True)
class Peer:
    """Another machine: its address in the tunnel, and the public key that proves it.

    `endpoint`: where it is reached; empty for those who come by themselves.
    """

    name: str
    address: str
    public: str
    endpoint: str = ''


@dataclass(frozen=True)
class Keys:
    """What the file says: this machine's address in the tunnel, and who is let in."""

    path: Path
    address: str
    subnet: str
    peers: tuple[Peer, ...]

    @property
    def up(self) -> bool:
        """Whether the tunnel is up: its address is one of this machine's."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            try:
                sock.bind((self.address, 0))
            except OSError:
                return False
        return True

    @property
    def how_up(self) -> str:
        """What a person does to bring it up."""
        return f'sudo wg-quick up {self.path}'


def place() -> Path:
    """Return where the file is kept; it may not be there yet."""
    return folders.config_path() / f'{INTERFACE}.conf'


def read(path: Path | None = None) -> Keys:
    """Return the keys of this machine; raises ConfigError where there are none."""
    path = path or place()
    try:
        text = path.read_text('utf-8')
    except FileNotFoundError:
        raise ConfigError(
            f'network: secure needs keys, and {path} is not there: run `eol keys make` on the '
            'machine of the work, or `eol keys join FILE` with the output of its `eol keys add`'
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f'{path}: {getattr(error, "strerror", error)}') from None
    try:
        return parse(text, path)
    except (ValueError, KeyError, IndexError):
        raise ConfigError(
            f'{path}: not a WireGuard configuration as `eol keys` writes it'
        ) from None


def parse(text: str, path: Path) -> Keys:
    """Return what a configuration says; raises ValueError, KeyError or IndexError."""
    head, *rest = re.split(r'^\[Peer\]', text, flags=re.M)
    own = ipaddress.ip_interface(_fields(head)['address'])
    peers = []
    for part in rest:
        fields = _fields(part)
        allowed = ipaddress.ip_interface(fields['allowedips'])
        name = re.search(r'^# (.+)$', part, re.M)
        called = name[1] if name else '?'
        endpoint = fields.get('endpoint', '')
        peers.append(Peer(called, str(allowed.ip), fields['publickey'], endpoint))
    return Keys(path, str(own.ip), str(own.network), tuple(peers))


def _fields(part: str) -> dict[str, str]:
    """Return the lines `Key = value` of a part, keys in lower case."""
    rows = re.findall(r'^\s*(\w+)\s*=\s*(.*?)\s*$', part, re.M)
    return {key.lower(): value for key, value in rows}


def make(subnet: str = SUBNET, port: int = PORT) -> Keys:
    """Write the file of a machine that others reach; raises ConfigError, DeviceMissing."""
    try:
        net = ipaddress.IPv4Network(subnet)
    except ValueError as error:
        raise ConfigError(f'--subnet {subnet}: {error}') from None
    if net.num_addresses < 4:
        raise ConfigError(f'--subnet {subnet}: has no room for two machines')
    text = (
        '# Echoes of the Land: who may reach its graph. Written by `eol keys`, read by wg-quick.\n'
        f'[Interface]\nAddress = {net[1]}/{net.prefixlen}\nListenPort = {port}\n'
        f'PrivateKey = {_wg("genkey")}\n{_GUARD.format(subnet=net)}'
    )
    path = place()
    _write(path, text, new=True)
    return read(path)


def add(name: str, endpoint: str, public: str = '') -> tuple[Keys, str]:
    """Let somebody in; return the keys, and the configuration for their machine.

    endpoint: `host` or `host:port` under which they reach this machine. public: their public key,
    where they have made their keys themselves: then what they get holds no private one.
    Raises ConfigError for a name that is there already or cannot be one, and where no address is
    left.
    """
    keys = read()
    text = keys.path.read_text('utf-8')
    if not _NAME.fullmatch(name):
        raise ConfigError(f'{name!r}: a name has letters, figures, dot and hyphen, at most 31')
    if name in {peer.name for peer in keys.peers}:
        raise ConfigError(f'{name}: has a key already; run `eol keys revoke {name}` first')
    if public and not re.fullmatch(r'[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=', public):
        raise ConfigError(f'--public {public}: not a WireGuard key (44 characters)')
    net = ipaddress.ip_network(keys.subnet)
    taken = {keys.address, *(peer.address for peer in keys.peers)}
    free = (str(a) for a in net.hosts() if str(a) not in taken)
    address = next(free, '')
    if not address:
        raise ConfigError(f'{keys.subnet}: no address is free')
    own = _fields(text.partition('[Peer]')[0])
    if not re.search(r':\d+$', endpoint):
        endpoint = f'{endpoint}:{own["listenport"]}'
    private = '' if public else _wg('genkey')
    shared = _wg('genpsk')
    theirs = (
        f'# Echoes of the Land: {name}. Written by `eol keys add`; `eol keys join` takes it.\n'
        f'[Interface]\nAddress = {address}/{keys.subnet.partition("/")[2]}\n'
        f'PrivateKey = {private or "YOUR-PRIVATE-KEY"}\n{_GUARD.format(subnet=keys.subnet)}\n'
        f'[Peer]\n# work\nPublicKey = {_wg("pubkey", own["privatekey"])}\nPresharedKey = {shared}\n'
        f'AllowedIPs = {keys.address}/32\nEndpoint = {endpoint}\n'
        f'PersistentKeepalive = {KEEPALIVE_S}\n'
    )
    _write(
        keys.path,
        f'{text.rstrip()}\n\n[Peer]\n# {name}\nPublicKey = {public or _wg("pubkey", private)}\n'
        f'PresharedKey = {shared}\nAllowedIPs = {address}/32\n',
    )
    return read(keys.path), theirs


def revoke(name: str) -> Keys:
    """Let somebody in no longer; raises ConfigError where nobody is called that."""
    keys = read()
    if name not in {peer.name for peer in keys.peers}:
        known = ', '.join(peer.name for peer in keys.peers) or 'none'
        raise ConfigError(f'{name}: has no key; names with keys: {known}')
    head, *parts = re.split(r'^\[Peer\]', keys.path.read_text('utf-8'), flags=re.M)
    kept = [part.strip() for part in parts if not re.search(rf'^# {re.escape(name)}$', part, re.M)]
    _write(keys.path, '\n\n'.join([head.strip(), *(f'[Peer]\n{part}' for part in kept)]) + '\n')
    return read(keys.path)


def join(text: str, source: str = 'keys') -> Keys:
    """Write what another machine's `add` gave in the file `source`; raises ConfigError."""
    path = place()
    try:
        parse(text, path)
    except (ValueError, KeyError, IndexError):
        raise ConfigError(f'{source}: not what `eol keys add` writes') from None
    _write(path, text, new=True)
    return read(path)


def _write(path: Path, text: str, new: bool = False) -> None:
    """Write a file that its owner alone can read, whole at every moment."""
    if new and path.exists():
        raise ConfigError(f'{path}: exists already; to start over, remove it, with all keys in it')
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with DISK.replacing(path) as part:
            part.touch(0o600)
            part.write_text(text)
    except OSError as error:
        raise ConfigError(
            f'{path}: {error.strerror}; set EOL_CONFIG to a folder that can be written'
        ) from None


def _wg(what: str, given: str = '') -> str:
    """Return what `wg genkey`, `wg pubkey` or `wg genpsk` says."""
    try:
        done = subprocess.run(
            ['wg', what], input=given, capture_output=True, text=True, timeout=10, check=True
        )
    except FileNotFoundError:
        raise DeviceMissing('no WireGuard here: sudo apt-get install wireguard nftables') from None
    except subprocess.SubprocessError as error:
        raise ConfigError(
            f'wg {what}: {str(getattr(error, "stderr", "") or error).strip()}'
        ) from None
    return done.stdout.strip()
