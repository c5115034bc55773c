# SPDX-License-Identifier: Apache-2.0
"""The DDS transport: shared memory large enough for images, and UDP that stays on this machine.

Fast DDS's default segment loses half of 1 MB images. `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` is
no barrier: a peer that lists our address gets in; a UDP whitelist of the loopback interface is one.
"""

import contextlib
import os
from pathlib import Path

from eol_ros import folders
from eol_ros.errors import ConfigError

BIG_SEGMENT = 20 << 20  # of a process that publishes images: more than its history
SMALL_SEGMENT = 2 << 20
MAX_MESSAGE = 2 << 20

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
        <type>UDPv4</type>{whitelist}
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="eol" is_default_profile="true">
      <rtps>
        <userTransports>
          <transport_id>eol_shm</transport_id>
          <transport_id>eol_udp</transport_id>
        </userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
      </rtps>
    </participant>
  </profiles>
</dds>
"""
_LOOPBACK = """
        <interfaceWhiteList>
          <address>127.0.0.1</address>
        </interfaceWhiteList>"""


def profile(network: str, images: bool) -> str:
    """Return the Fast DDS profile for `network` ('local' or 'lan') as XML."""
    return _PROFILE.format(
        segment=BIG_SEGMENT if images else SMALL_SEGMENT,
        message=MAX_MESSAGE,
        whitelist=_LOOPBACK if network == 'local' else '',
    )


def environment(network: str = 'local', images: bool = False) -> dict[str, str]:
    """Return what to add to the environment of a process before it calls rclpy.init.

    A profile that the user has named in FASTRTPS_DEFAULT_PROFILES_FILE is left as it is. Ours lies
    in the cache, as Fast DDS reads nothing but a file with a place on a disk; every process that
    starts writes it again where it is gone. Raises ConfigError where it cannot be written.
    """
    theirs = os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', '')
    if theirs and 'eol-dds-' not in theirs:
        return {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'}
    file = folders.cache('dds') / f'eol-dds-{network}-{"images" if images else "small"}.xml'
    _keep(file, profile(network, images))
    values = {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp', 'FASTRTPS_DEFAULT_PROFILES_FILE': str(file)}
    if network == 'lan':
        values['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    return values


def _keep(file: Path, text: str) -> None:
    """Let `file` hold `text`, whole at every moment: other processes read it."""
    with contextlib.suppress(OSError):
        if file.read_text() == text:
            return
    part = file.with_suffix(f'.{os.getpid()}')
    try:
        part.write_text(text)
        part.replace(file)
    except OSError as error:
        raise ConfigError(
            f'{file}: {error.strerror}; set EOL_CACHE to a folder that can be written'
        ) from None


def configure(network: str = 'local', images: bool = False) -> None:
    """Set the environment of this process; call it before rclpy.init."""
    os.environ.update(environment(network, images))
