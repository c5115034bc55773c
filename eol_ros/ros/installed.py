# SPDX-License-Identifier: Apache-2.0
"""Whether ROS and the messages can be imported here, and what installs them; imports neither."""

import importlib.util
import os
import sys
from pathlib import Path

from eol_ros.errors import DeviceMissing, pip_install

# What `ros` and `nodes` import beyond the wheel of this package.
PACKAGES = (
    'rclpy', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'rcl_interfaces',
    'rosbag2_interfaces', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs',
    'tf2_msgs', 'visualization_msgs', 'eol_msgs',
)  # fmt: skip


def missing() -> list[str]:
    """Return the packages of the graph that this Python does not find."""
    return [name for name in PACKAGES if importlib.util.find_spec(name) is None]


def require() -> None:
    """Raise DeviceMissing with the command that installs what is missing, if anything is."""
    names = missing()
    if names:
        raise DeviceMissing(
            f'{", ".join(names)} not installed: the graph needs ROS 2 Jazzy and eol_msgs. '
            f'Install with: {command()}'
        )


def explained(error: ModuleNotFoundError) -> DeviceMissing | None:
    """Return `error` as an expected one if it is about a package of the graph, else None."""
    if (error.name or '').partition('.')[0] not in PACKAGES:
        return None
    try:
        require()
    except DeviceMissing as known:
        return known
    return None  # it is there, but broken: that is for the traceback


def command() -> str:
    """Return the command that installs the messages, and ROS with them where it is not there yet.

    Their wheel requires the ROS wheels. Where ROS is of another kind (rclpy is not in this Python's
    prefix, as in /opt/ros) they are built in the workspace instead.
    """
    rclpy = importlib.util.find_spec('rclpy')
    if rclpy and rclpy.origin and not Path(rclpy.origin).is_relative_to(sys.prefix):
        return 'colcon build --packages-select eol_msgs && . install/setup.sh'
    if source := _sources():
        return pip_install(str(source))
    return f'{pip_install()} eol_msgs-*.whl  (docs/guides/packages.md makes it)'


def _sources() -> Path | None:
    """Return the folder of the message package: in a checkout, else as installed with the wheel."""
    prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    folders = [Path(__file__).resolve().parents[2] / 'msg_defs' / 'eol_msgs']
    folders += [Path(p) / 'share' / 'eol_ros' / 'eol_msgs' for p in prefixes if p]
    return next((f for f in folders if (f / 'package.xml').is_file()), None)
