# SPDX-License-Identifier: Apache-2.0
"""`eol run [SCENE]`, also `python -m eol_ros.bringup [SCENE]`: bring the installation to life."""

import argparse
import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import yaml

from eol_ros import folders, thread_faults
from eol_ros import scene as scenes
from eol_ros.bringup import plan, ros_args, status
from eol_ros.bringup.event_log import EventLog
from eol_ros.bringup.memory import Memory
from eol_ros.bringup.service_manager import ServiceManager
from eol_ros.bringup.supervisor import Around, Supervisor
from eol_ros.bringup.terminal import Terminal
from eol_ros.cli import within
from eol_ros.errors import UsageError
from eol_ros.ros import installed, network
from eol_ros.streams.graph import IMAGE_SOURCES

if TYPE_CHECKING:
    from eol_ros.bringup.notify import Notifier

HELP = 'Start a scene, watch its nodes and restart those that die. Ctrl-C stops it.'
EXAMPLES = [
    'eol run',
    'eol run museum',
    'eol run my/scene.yaml --for 60 --bag /data/bags',
    'eol run museum --only camera,tracker',
    'eol run museum --machine audio',
    'eol run rehearsal --ros-args -r __ns:=/north',
    'eol run rehearsal --ros-args -p grains:radius:=0.06 --params-file my.yaml',
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'scene', nargs='?', default='rehearsal', help='scene file, or name of a shipped scene'
    )
    parser.add_argument(
        '--for',
        dest='seconds',
        type=within(1e-3, 1e9),
        metavar='SECONDS',
        help='stop SECONDS (0.001 or more) after all nodes are OK, or after a fault of SECONDS, at '
        'least 5 (exit code 1)',
    )
    parser.add_argument(
        '--bag', metavar='DIR', help='record into this folder, even if the scene says recorder: off'
    )
    parser.add_argument(
        '--only',
        metavar='NODES',
        help='start only these nodes, separated by commas; the recorder only if it is named',
    )
    parser.add_argument(
        '--machine',
        metavar='NAME',
        help='name of this machine under the scene key `machines`, which lists the nodes that it '
        'runs (default: the machine that has an address of this one)',
    )
    parser.add_argument(
        '--ros-args',
        nargs=argparse.REMAINDER,
        metavar='ARGS',
        help='-r __ns:=/NAME replaces the namespace of the scene; other remappings, -p '
        '[NODE:]NAME:=VALUE and --params-file FILE apply to the nodes',
    )


def run(args: argparse.Namespace) -> int:
    """Run the scene; return the exit code."""
    given = ros_args.read(scenes.load(args.scene), args.ros_args or ())
    scene = given.scene
    sim_time = 'replay' in scene.nodes
    notes: list[str] = []
    if sim_time:
        from eol_ros.bringup import playback

        scene, notes = playback.settle(scene)
    if args.bag:
        bag = str(Path(args.bag).expanduser().resolve())
        recorder = dataclasses.replace(scene.settings('recorder'), folder=bag)
        scene = dataclasses.replace(scene, nodes={**scene.nodes, 'recorder': recorder})
    unrecorded = '' if 'recorder' in scene.nodes else 'recorder is off in this scene'
    told = scene  # to the nodes, which count on those of the other machines
    if scene.machines or args.machine:
        if args.only:
            raise UsageError(f'--only {args.only}: `machines` of the scene say what runs where')
        told = plan.on_machine(scene, args.machine)
        scene, name = plan.own_part(told), told.nodes['machine'].name
        notes += [f'this is machine {name} ({told.machines[name].address})']
        if args.bag and 'recorder' not in scene.nodes:
            raise UsageError(f'--bag {args.bag}: no recorder runs on machine {name}')
    elif args.only:
        told = scene = plan.only(scene, [name for name in args.only.split(',') if name])
        if 'recorder' not in scene.nodes:
            if args.bag:
                raise UsageError(f'--bag {args.bag}: --only leaves the recorder out; name it there')
            unrecorded = unrecorded or '--only does not name the recorder'
    if 'tracker' in scene.nodes and not set(IMAGE_SOURCES) & set(scene.nodes):
        notes += filter(None, [network.of_driver(scene.network)])
    installed.require()
    thread_faults.install()
    server = status.listen(plan.domain(scene), scene.namespace)
    with (
        _scene_file(told) as file,
        server,
        Terminal() as terminal,
        EventLog(folders.state_path(), terminal.say) as events,
        ServiceManager() as manager,
    ):
        say = terminal.say
        say(f'{scene.name}: {", ".join(scene.nodes)}')
        if events.trouble:
            say(f'WARN {events.trouble}')
        events.entry(f'{scene.name}: start of {", ".join(scene.nodes)}')
        notes += [f'not recorded: {unrecorded}'] if unrecorded else []
        for note in (*scene.warnings, *network.warnings(scene.network), *notes):
            say(note)
            events.entry(f'{scene.name}: {note}')
        supervisor = Supervisor(
            scene.name,
            plan.processes(
                scene,
                scenes.inherited(file.fileno()),
                sim_time,
                inherit=(file.fileno(),),
                ros_args=given,
            ),
            server,
            events,
            say,
            Around(
                plan.compiler(scene),
                scene.namespace,
                manager,
                memory=None
                if 'replay' in scene.nodes  # which plays what was asked in its run
                else Memory(scene, plan.domain(scene), always=manager.there),
                notifier=_notifier(scene),
                changed=network.changes(scene.network),
            ),
        )
        return supervisor.run(args.seconds)


def _notifier(scene: scenes.Scene) -> 'Notifier | None':
    """Return what tells people; mail and webhooks are loaded for scenes that name somebody."""
    if scene.notify is None:
        return None
    from eol_ros.bringup.notify import Notifier

    return Notifier(scene)


def _scene_file(scene: scenes.Scene) -> TextIO:
    """Return the scene, written out, as an open file in memory for the nodes to inherit.

    It has no place on a disk: no cleaner can take it before a node is started again, no end of a
    session, and nothing is left of it.
    """
    file = os.fdopen(os.memfd_create(f'{scene.name[:60]}.yaml'), 'w', encoding='utf-8')
    yaml.safe_dump(scenes.plain(scene), file, sort_keys=False)
    file.flush()
    return file
