# SPDX-License-Identifier: Apache-2.0
"""The DDS transport: shared memory large enough for images, and UDP that stays on this machine.

Fast DDS's default segment loses half of 1 MB images. `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` is
no barrier: a peer that lists our address gets in; a UDP whitelist of the loopback interface is one.
"""

import contextlib
import os
import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eol_ros import folders
from eol_ros.disk import DISK
from eol_ros.errors import ConfigError, UsageError
from eol_ros.ros import wireguard
from eol_ros.streams.graph import MAX_DOMAIN

if TYPE_CHECKING:
    from eol_ros.scene import Scene

BIG_SEGMENT = 20 << 20  # of a process that publishes images: more than its history
SMALL_SEGMENT = 2 << 20
MAX_MESSAGE = 2 << 20
OPEN = (
    'network: lan lets every machine on the network see all topics and send requests; '
    'keep that network closed, or use network: secure or local'
)

# Who was not heard when a participant appeared is heard when it announces itself next: 3 s later by
# default, and a node that was started again got nothing for so long.
_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>eol_shm</transport_id>
        <type>SHM</type>
        <segment_size>{segment}</segment_size>
        <maxMessageSize>{message}</maxMessageSize>
      </transport_descriptor>
      <transport_descriptor>
        <transport_id>eol_udp</transport_id>
        <type>UDPv4</type>{peers}{whitelist}
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="eol" is_default_profile="true">
      <rtps>
        <userTransports>
          <transport_id>eol_shm</transport_id>
          <transport_id>eol_udp</transport_id>
        </userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
        <builtin>
          <discovery_config>
            <leaseAnnouncement>
              <sec>1</sec>
            </leaseAnnouncement>
          </discovery_config>
        </builtin>
      </rtps>
    </participant>{writers}
  </profiles>
</dds>
"""
# A replay waits for its readers. Where a history is full they are asked what they have; where they
# have told of a part of it meanwhile, only at the next heartbeat: by default once in 3 s.
_WRITERS = """
    <data_writer profile_name="eol_asks" is_default_profile="true">
      <times>
        <heartbeatPeriod>
          <nanosec>20000000</nanosec>
        </heartbeatPeriod>
      </times>
    </data_writer>"""
_WHITELIST = """
        <interfaceWhiteList>{addresses}
        </interfaceWhiteList>"""
_ADDRESS = """
          <address>{}</address>"""
# A tunnel carries no multicast: so many participants of each peer are spoken to one by one.
_PEERS = """
        <maxInitialPeersRange>32</maxInitialPeersRange>"""


def profile(images: bool, addresses: Sequence[str] = (), asks: bool = False) -> str:
    """Return the Fast DDS profile as XML; it uses these `addresses` alone, or all if none.

    `asks`: readers are asked often what they have, for who waits for them.
    """
    whitelist = _WHITELIST.format(addresses=''.join(map(_ADDRESS.format, addresses)))
    return _PROFILE.format(
        segment=BIG_SEGMENT if images else SMALL_SEGMENT,
        message=MAX_MESSAGE,
        peers=_PEERS if len(addresses) > 1 else '',
        whitelist=whitelist if addresses else '',
        writers=_WRITERS if asks else '',
    )


def asks(scene: 'Scene', nodes: Collection[str]) -> bool:
    """Return whether a process of these nodes must soon learn what its readers lack.

    A replay waits for its readers. A cable may lose packets: of 1 % lost, half of the grains came
    0.8 s late or more.
    """
    return 'replay' in nodes or bool(scene.machines)


def warnings(network: str) -> list[str]:
    """Return what a person should know of `network` at every start."""
    if network == 'lan':
        return [OPEN]
    if network == 'secure' and not (keys := wireguard.read()).up:
        return [
            f'network: secure: {keys.address} is not up, so nobody else is let in; {keys.how_up}'
        ]
    return []


def of_driver(network: str) -> str:
    """Return what a camera driver that is not ours must be started with, for people."""
    name = 'FASTRTPS_DEFAULT_PROFILES_FILE'
    file = environment(network, images=True).get(name)
    if file is None:  # one that the user has named
        return ''
    return (
        f'images come from elsewhere: start the camera driver with {name}={file}, or DDS loses some'
    )


def changes(network: str) -> Callable[[bool], str]:
    """Return what says, each time it is called, whether all nodes must be started again, and why.

    Its argument says that one is about to be. Participants tell each other their addresses once,
    and know by them whether they share a machine. Those from before the tunnel came up or went
    down, and those from after, would not find each other. Where the machine has had other addresses
    meanwhile (another lease, a cable pulled) they would, but a node that is started again then
    would take images over UDP, with losses, and not through shared memory.
    """
    keys = wireguard.read() if network == 'secure' else None
    was_up, was = bool(keys and keys.up), addresses()

    def look(restarting: bool) -> str:
        nonlocal was_up, was
        if keys and keys.up != was_up:
            was_up, was = not was_up, addresses()
            return f'network: secure: {keys.address} is {"up" if was_up else "down"} now'
        if restarting and (now := addresses()) != was:
            was = now
            return 'this machine has other addresses than before'
        return ''

    return look


def addresses() -> frozenset[str]:
    """Return the addresses of this machine, as the kernel lists them."""
    found = set()
    with contextlib.suppress(OSError):
        tree = Path('/proc/net/fib_trie').read_text()
        found.update(re.findall(r'-- (\S+)\n\s+/32 host LOCAL', tree))
    with contextlib.suppress(OSError):
        found.update(row.split()[0] for row in Path('/proc/net/if_inet6').read_text().splitlines())
    return frozenset(found)


def environment(network: str = 'local', images: bool = False, asks: bool = False) -> dict[str, str]:
    """Return what to add to the environment of a process before it calls rclpy.init.

    `images`: it publishes images; `asks`: it waits for its readers.

    A profile that the user has named in FASTRTPS_DEFAULT_PROFILES_FILE is left as it is. Ours lies
    in the cache, as Fast DDS reads nothing but a file with a place on a disk; every process that
    starts writes it again where it is gone. Raises ConfigError where it cannot be written.
    """
    theirs = os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', '')
    if theirs and 'eol-dds-' not in theirs:
        return {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'}
    values = {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'}
    allowed = [] if network == 'lan' else ['127.0.0.1']
    if network == 'secure':
        keys = wireguard.read()
        allowed.append(keys.address)
        # Who is reached by others names none, and is found as ever by those on its own machine; who
        # comes from elsewhere names both, for then that is how it finds its own machine's too.
        if reached := [peer.address for peer in keys.peers if peer.endpoint]:
            values['ROS_STATIC_PEERS'] = ';'.join(['127.0.0.1', *reached])
    if network != 'local':
        values['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    kind = ('images' if images else 'small') + ('-asks' if asks else '')
    file = folders.cache('dds') / f'eol-dds-{network}-{kind}.xml'
    _keep(file, profile(images, allowed, asks))
    return values | {'FASTRTPS_DEFAULT_PROFILES_FILE': str(file)}


def _keep(file: Path, text: str) -> None:
    """Let `file` hold `text`, whole at every moment: other processes read it."""
    with contextlib.suppress(OSError):
        if file.read_bytes() == text.encode():
            return
    try:
        DISK.write(file, text)
    except OSError as error:
        raise ConfigError(
            f'{file}: {error.strerror}; set EOL_CACHE to a folder that can be written'
        ) from None


def configure(network: str = 'local', images: bool = False, asks: bool = False) -> None:
    """Set the environment of this process; call it before rclpy.init.

    Raises UsageError where ROS_DOMAIN_ID is none.
    """
    os.environ.update(environment(network, images, asks))
    domain()


def participants(number: int) -> bool | None:
    """Return whether any participant of DDS domain `number` runs on this machine.

    Each opens UDP ports of its domain (RTPS 2.3, 9.6.1.1). None: not known, as of a profile that
    the user has named.
    """
    theirs = os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', '')
    if theirs and 'eol-dds-' not in theirs:
        return None
    first = 7400 + 250 * number
    try:
        rows = Path('/proc/net/udp').read_text().splitlines()[1:]
    except OSError:
        return None
    return any(first <= int(row.split()[1].rpartition(':')[2], 16) < first + 250 for row in rows)


def domain() -> int:
    """Return the DDS domain that ROS_DOMAIN_ID names; raise UsageError where it names none."""
    text = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_DOMAIN):
        raise UsageError(f'ROS_DOMAIN_ID is {text!r}, not a whole number from 0 to {MAX_DOMAIN}')
    return int(text)
