# SPDX-License-Identifier: Apache-2.0
"""A scene with a replay: which bag it is, and which nodes that bag has something for."""

from dataclasses import replace
from typing import Any

import yaml

from eol_ros import yaml_text
from eol_ros.bringup import plan
from eol_ros.devices.bag.player import complete
from eol_ros.devices.bag.reader import BagReader, table_in
from eol_ros.scene import Scene, plain
from eol_ros.settings import by_today
from eol_ros.streams.graph import NODES

DECIDING = ('tracker', 'motion', 'grains', 'leds')  # what they do follows from bag and settings
PASSING = ('preview_hz', 'port', 'board_log')  # settings of theirs that change none of it


def settle(scene: Scene) -> tuple[Scene, list[str]]:
    """Return the scene with its bag by name, and lines about what is left out or will differ.

    A tracker needs all images of a run. Where not all were kept, the recorded blocks are played in
    its place. Raises ConfigError or DeviceMissing when the bag cannot be read.
    """
    replay = scene.nodes['replay']
    if not replay.bag:
        return scene, []  # the node says what is wrong
    bag = BagReader(replay.bag)
    scene = replace(scene, nodes={**scene.nodes, 'replay': replace(replay, bag=str(bag.path))})
    notes, whole, table = [], complete(bag), table_in(bag.about.get('settings', ''))
    if table is not None and table != scene.table:
        scene = replace(scene, table=table)
        notes = [f'the table is that of {bag.path}: {table.rows} x {table.columns} places']
    if not whole and not replay.topics and 'tracker' in scene.nodes:
        scene = plan.only(scene, [name for name in scene.nodes if name != 'tracker'])
        notes += [f'{bag.path} has not all images of its run: its blocks are played, no tracker']
    return scene, notes + differences(bag.about, scene)


def differences(about: dict[str, str], scene: Scene) -> list[str]:
    """Return a line for each setting that differs from the run's and changes what comes of it."""
    try:
        nodes: dict[str, Any] = yaml_text.load(about.get('settings', ''))['nodes']
    except (yaml.YAMLError, KeyError, TypeError):
        return []  # a bag of another program
    nodes = {
        name: by_today(NODES[name].settings, values)
        for name, values in nodes.items()
        if name in NODES and isinstance(values, dict)
    }
    here = plain(scene)['nodes']  # as bags have them, lists for tuples
    return [
        f'{name}.{key} is {value!r} here and was {nodes[name][key]!r} in the run: it will differ'
        for name in DECIDING
        if name in scene.nodes and name in nodes
        for key, value in here[name].items()
        if key in nodes[name] and key not in PASSING and nodes[name][key] != value
    ]
