# SPDX-License-Identifier: Apache-2.0
"""Starts bringup, which starts, watches and restarts the nodes of a scene.

ros2 launch eol_ros eol.launch.py scene:=museum bag:=/data/bags only:=camera namespace:=north
"""

import sys

from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

ARGUMENTS = {
    'scene': ('rehearsal', 'scene file, or the name of one that ships'),
    'bag': ('', 'folder to record into, even if the scene says recorder: off'),
    'only': ('', 'nodes to start alone, parted by commas'),
    'namespace': ('', 'in place of that of the scene'),
}
STOP_S = '20'  # bringup stops its nodes in order, and the bag is closed last


def bringup(context):
    """Return the one process; a namespace that an including launch file has pushed counts too."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    namespace = given['namespace'] or context.launch_configurations.get('ros_namespace', '')
    command = [sys.executable, '-m', 'eol_ros.bringup', given['scene']]
    for name in ('bag', 'only'):
        command += [f'--{name}', given[name]] if given[name] else []
    command += ['--ros-args', '-r', f'__ns:={namespace}'] if namespace else []
    return [
        ExecuteProcess(
            cmd=command, name='bringup', output='screen', sigterm_timeout=STOP_S,
            sigkill_timeout=STOP_S, on_exit=[Shutdown(reason='bringup has ended')],
        )
    ]  # fmt: skip


def generate_launch_description():
    """Return what `ros2 launch` asks for."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=bringup)])
