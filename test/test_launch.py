# SPDX-License-Identifier: Apache-2.0
"""The launch file starts bringup. Where `launch` is not installed a small stand-in executes it.

There are no wheels of ROS's `launch`. The stand-in has those of its classes that the file uses,
with the keywords of Jazzy, and does with them what LaunchService does before it starts a process.
"""

import argparse
import importlib.util
import runpy
import sys
import types
from pathlib import Path

import pytest

from eol_ros import scene as scenes
from eol_ros.bringup import ros_args
from eol_ros.bringup import run as bringup

FILE = Path(__file__).parents[1] / 'launch' / 'eol.launch.py'


class LaunchContext:
    def __init__(self):
        self.launch_configurations = {}


class LaunchDescription:
    def __init__(self, initial_entities=None):
        self.entities = list(initial_entities or ())


class DeclareLaunchArgument:
    def __init__(self, name, *, default_value=None, description=None, choices=None):
        self.name, self.default_value, self.description = name, default_value, description

    def execute(self, context):
        context.launch_configurations.setdefault(self.name, self.default_value)


class LaunchConfiguration:
    def __init__(self, variable_name, *, default=None):
        self.variable_name = variable_name

    def perform(self, context):
        return context.launch_configurations[self.variable_name]


class TextSubstitution:
    def __init__(self, *, text):
        self.text = text

    def perform(self, context):
        return self.text


class OpaqueFunction:
    def __init__(self, *, function, args=None, kwargs=None):
        self.function = function

    def execute(self, context):
        return self.function(context)


class ExecuteProcess:
    def __init__(self, *, cmd, name=None, output='log', sigterm_timeout='5', sigkill_timeout='5',
                 on_exit=None):  # fmt: skip
        assert all(isinstance(word, str) for word in (*cmd, name, sigterm_timeout, sigkill_timeout))
        self.cmd, self._on_exit = [[TextSubstitution(text=word)] for word in cmd], on_exit

    def get_sub_entities(self):
        return self._on_exit


class Shutdown:
    def __init__(self, *, reason='reason not given'):
        self.reason = reason


def installed():
    try:
        return importlib.util.find_spec('launch.actions') is not None
    except ModuleNotFoundError:
        return False


@pytest.fixture
def command(monkeypatch):
    """Return a function from launch arguments to the words that the launch file executes."""
    stand_in = {
        'launch': (LaunchContext, LaunchDescription),
        'launch.actions': (DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown),
        'launch.substitutions': (LaunchConfiguration,),
    }
    for name, classes in () if installed() else stand_in.items():
        module = types.ModuleType(name)
        vars(module).update({kind.__name__: kind for kind in classes})
        monkeypatch.setitem(sys.modules, name, module)
    described = runpy.run_path(str(FILE))['generate_launch_description']()

    def execute(**given):
        context, processes = importlib.import_module('launch').LaunchContext(), []
        context.launch_configurations.update(given)
        for entity in described.entities:
            processes += entity.execute(context) or ()
        (process,) = processes
        assert [type(entity).__name__ for entity in process.get_sub_entities()] == ['Shutdown']
        return [''.join(part.perform(context) for part in word) for word in process.cmd]

    return execute


def parsed(words):
    """Return the command line as bringup takes it, and the scene that it starts."""
    assert words[:3] == [sys.executable, '-m', 'eol_ros.bringup']
    parser = argparse.ArgumentParser()
    bringup.add_arguments(parser)
    args = parser.parse_args(words[3:])
    return args, ros_args.read(scenes.load(args.scene), args.ros_args or ()).scene


def test_without_arguments_it_is_the_rehearsal(command):
    args, scene = parsed(command())
    assert (scene.name, scene.namespace) == ('rehearsal', 'eol')
    assert args.bag is args.only is None


def test_arguments_are_those_of_bringup(command):
    words = command(scene='lights', bag='/data/my bags', only='camera,tracker', namespace='north')
    args, scene = parsed(words)
    assert (scene.name, scene.namespace) == ('lights', 'north')
    assert (args.bag, args.only) == ('/data/my bags', 'camera,tracker')


def test_a_namespace_that_was_pushed_counts(command):
    assert parsed(command(ros_namespace='/museum/north'))[1].namespace == 'museum/north'
    both = command(ros_namespace='/museum', namespace='south')
    assert parsed(both)[1].namespace == 'south'
