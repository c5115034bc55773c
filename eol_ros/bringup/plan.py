# SPDX-License-Identifier: Apache-2.0
"""Scene to processes: which run, in which order, with which environment. Pure."""

import hashlib
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eol_ros import compiled
from eol_ros.bringup.ros_args import RosArgs
from eol_ros.errors import ConfigError, UsageError, nearest
from eol_ros.ros import network, wireguard
from eol_ros.scene import Scene, machine_node
from eol_ros.streams.graph import NAMESPACE, NODES

# One thread for each library: the graph has its own processes, two cores are shared by all of them.
_ENVIRONMENT = {
    'OMP_NUM_THREADS': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'NUMBA_NUM_THREADS': '1',
    'OPENCV_FOR_THREADS_NUM': '1',
    'MALLOC_ARENA_MAX': '2',
    # Images stay on the heap: given back to the system, each new one would be faulted in again,
    # page by page, which tripled the time from a camera to its reader.
    'MALLOC_MMAP_THRESHOLD_': '8388608',
    'MALLOC_TRIM_THRESHOLD_': '8388608',
    'PYTHONFAULTHANDLER': '1',
}


@dataclass(frozen=True)
class Process:
    """One process to start: its nodes, its command and what it adds to the environment."""

    nodes: tuple[str, ...]
    command: tuple[str, ...]
    environment: dict[str, str]
    nice: int = 0
    real_time: int = 0  # priority; 0: none
    files: tuple[int, ...] = ()  # descriptors that it inherits
    own: bool = False  # a program of `programs`, which tells nothing of itself
    folder: Path | None = None  # in which it runs

    @property
    def name(self) -> str:
        return '+'.join(self.nodes)


def only(scene: Scene, names: Sequence[str]) -> Scene:
    """Return the part of `scene` that consists of `names`; raise UsageError for others.

    The rest is taken to run elsewhere.
    """
    for name in names:
        if name not in scene.nodes:
            hint = nearest(name, scene.nodes)
            raise UsageError(f'--only {name}: scene {scene.name} has no such node. {hint}')
    groups = tuple(tuple(n for n in group if n in names) for group in scene.together)
    return replace(
        scene,
        nodes={name: scene.nodes[name] for name in scene.nodes if name in names},
        together=tuple(group for group in groups if len(group) > 1),
        programs={},
        elsewhere=(*scene.elsewhere, *(name for name in scene.nodes if name not in names)),
    )


def on_machine(scene: Scene, name: str | None) -> Scene:
    """Return `scene` as the machine `name` runs it; None: the machine that has its address here.

    Its node `machine` knows the name, and a digest of the file. Raises UsageError, and ConfigError
    where its keys lack another machine.
    """
    machines = scene.machines
    if not machines:
        raise UsageError(f'--machine {name}: scene {scene.name} names no machines')
    if name is None:
        here = network.addresses()
        name = next((one for one in machines if machines[one].address in here), '')
    if name not in machines:
        known = ', '.join(f'{one} ({machine.address})' for one, machine in machines.items())
        what = f'--machine {name}: no such machine' if name else 'no address of this machine is'
        raise UsageError(f'{what} in scene {scene.name}: {known}; choose one with --machine')
    if scene.network == 'secure':
        _check_keys(scene, name)
    digest = hashlib.sha256(scene.text.encode()).hexdigest()
    mine = replace(scene.nodes['machine'], name=name, digest=digest)
    return replace(scene, nodes={**scene.nodes, 'machine': mine})


def _check_keys(scene: Scene, name: str) -> None:
    """Raise ConfigError unless the tunnel of this machine leads to all others of the scene."""
    keys = wireguard.read()
    known = {keys.address, *(peer.address for peer in keys.peers)}
    for other, machine in scene.machines.items():
        if other == name and machine.address != keys.address:
            raise ConfigError(
                f'{keys.path}: the address is {keys.address}, that of machine {name} in scene '
                f'{scene.name} is {machine.address}'
            )
        if machine.address not in known:
            raise ConfigError(
                f'{keys.path}: no peer has the address {machine.address} of machine {other}; '
                'add it as a [Peer]'
            )


def own_part(told: Scene) -> Scene:
    """Return the part of a scene of `on_machine` that this machine runs.

    Own programs run on the main one.
    """
    name = told.nodes['machine'].name
    part = only(told, (*told.machines[name].nodes, 'machine'))
    return replace(part, programs=told.programs if name == told.main else {})


def processes(
    scene: Scene,
    file: Path,
    sim_time: bool = False,
    inherit: Sequence[int] = (),
    ros_args: RosArgs | None = None,
) -> list[Process]:
    """Return the processes of `scene`; the nodes read their settings from `file`.

    They inherit the descriptors `inherit`, of which `file` may be one.

    `ros_args`: what was given to bringup besides settings.

    With `sim_time` their time is what a replay tells on /clock.

    They stand in data order, but for the recorder: it begins before there is anything to miss.
    """
    grouped = {name: group for group in scene.together for name in group}
    domain_id = {} if scene.domain is None else {'ROS_DOMAIN_ID': str(scene.domain)}
    done: set[str] = set()
    found = []
    for name in sorted(scene.nodes, key=lambda name: name != 'recorder'):
        if name in done:
            continue
        nodes = grouped.get(name, (name,))
        done.update(nodes)
        images = any(NODES[node].images for node in nodes)
        environment = {
            **_ENVIRONMENT,
            **network.environment(scene.network, images, network.asks(scene, nodes)),
            **domain_id,
        }
        command = (sys.executable, '-m', 'eol_ros.nodes', *nodes, '--scene', str(file))
        command += tuple(_ros_args(scene, sim_time, nodes, ros_args))
        nice = min(NODES[node].nice for node in nodes)
        real_time = max(NODES[node].real_time for node in nodes) if scene.real_time else 0
        found.append(Process(tuple(nodes), command, environment, nice, real_time, tuple(inherit)))
    environment = network.environment(scene.network, False) | domain_id
    for name, words in scene.programs.items():
        folder = scene.folder_of(name)
        command = (found_program(words[0], folder) or words[0], *words[1:])
        found.append(Process((name,), command, environment, own=True, folder=folder))
    return found


def found_program(word: str, folder: Path | None) -> str | None:
    """Return where the program `word` is, if it is there: `python` is that of eol_ros.

    folder: where one named with a slash lies.
    """
    if word in ('python', 'python3'):
        return sys.executable
    return shutil.which(str((folder or Path()) / word) if '/' in word else word)


def _ros_args(
    scene: Scene, sim_time: bool, nodes: Sequence[str], given: RosArgs | None
) -> list[str]:
    """Return what a process is given, and told of time: two replays must not mix theirs."""
    found = given.of(nodes) if given else []
    if 'machine' in nodes:  # one runs on each machine
        found += ['-r', f'machine:__node:={machine_node(scene.nodes["machine"].name)}']
    found += ['-p', 'use_sim_time:=true'] if sim_time and 'replay' not in nodes else []
    if sim_time and scene.namespace != NAMESPACE:
        found += ['-r', f'/clock:=/{scene.namespace}/clock']
    return ['--ros-args', *found] if found else []


def compiler(scene: Scene) -> Process | None:
    """Return what compiles the loops that the nodes of `scene` need; None if all are in the cache.

    It is no node, and has no name of one.
    """
    parts = compiled.cold(scene.nodes)
    if not parts:
        return None
    command = (sys.executable, '-m', 'eol_ros', 'compile', '--parts', ','.join(parts))
    return Process(('compiler',), command, {})


def domain(scene: Scene) -> int:
    """Return the DDS domain that the scene runs on."""
    return network.domain() if scene.domain is None else scene.domain
