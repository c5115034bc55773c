# SPDX-License-Identifier: Apache-2.0
"""Presets of the live settings of grains and sound: saved, recalled, and mixed.

A setting of this node is set at once, one of the other node by a request. A bag records both.
"""

import functools
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from eol_ros.core.sound.presets import STEP_S, Glide, between
from eol_ros.devices.corpus.corpus_file import REMAKING
from eol_ros.errors import ConfigError
from eol_ros.ros import presets
from eol_ros.ros.parameters import checked_live
from eol_ros.ros.requests import parameters
from eol_ros.said import said
from eol_ros.settings import live_fields
from eol_ros.streams.graph import INSTRUMENT, NODES
from eol_ros.streams.requests import SET, Asked

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode


class Instrument:
    """Plays the settings of `node`, one of INSTRUMENT, and of the other."""

    def __init__(self, node: 'EolNode'):
        self._node = node
        self._clients: dict[str, AsyncParameterClient] = {}
        self._glide: Any = None
        self._pair: tuple[str, str] | None = None
        self._told: dict[str, dict[str, Any]] = {}  # of the morph between this pair

    def set(self, target: str, values: Mapping[str, Any]) -> None:
        """Set live settings of a node; raises ConfigError; what only the other knows it refuses."""
        values = checked_live(NODES[target].settings, target, values)
        if target != self._node.NAME:
            self._node.requests.ask(Asked(SET, target, values))
            return
        done = self._node.set_parameters_atomically(parameters(values))
        if not done.successful:
            raise ConfigError(done.reason)

    def save(self, name: str, answer: Callable[[bool, str], None]) -> None:
        """Save all live settings as a preset; call `answer` with success and a message."""
        path = presets.path_of(name, presets.folder())

        def write(now: presets.Preset) -> None:
            try:
                presets.save(path, now)
            except ConfigError as error:
                answer(False, str(error))
            else:
                answer(True, said('kept_in', name=path.name))

        self._now(write)

    def recall(self, name: str, over_s: float = 0.0) -> None:
        """Bring a preset back, or glide there; raises EolError where it cannot be."""
        goal = self._preset(name)
        self._stop()
        if over_s:
            self._now(lambda start: self._begin(start, goal, over_s))
        else:
            for target, values in goal.items():
                self.set(target, values)

    def morph(self, start: str, end: str, share: float) -> None:
        """Be `share` (0..1) of the way from one preset to another; raises EolError."""
        begin, goal = self._preset(start), self._preset(end)
        self._stop()
        if self._pair != (start, end):
            self._pair, self._told = (start, end), {}
        for target in [node for node in INSTRUMENT if node in {**begin, **goal}]:
            a, b = begin.get(target, {}), goal.get(target, {})
            now = a | b | between(NODES[target].settings, a, b, share, REMAKING)
            told = self._told.get(target, {})
            changed = {k: v for k, v in now.items() if k not in told or told[k] != v}
            if changed:
                self.set(target, changed)
            self._told[target] = now

    def _preset(self, name: str) -> presets.Preset:
        path = presets.path_of(name, presets.folder())
        return _loaded(path, path.stat().st_mtime_ns if path.is_file() else 0)

    def _stop(self) -> None:
        if self._glide is not None:
            self._node.destroy_timer(self._glide)  # cancelled ones stay with the node
            self._glide = None

    def _begin(self, start: presets.Preset, goal: presets.Preset, over_s: float) -> None:
        begun_s = time.monotonic()
        kinds = {name: NODES[name].settings for name in INSTRUMENT}
        glide = Glide(kinds, start, goal, over_s, REMAKING)

        def step() -> None:
            for target, changed in glide.step(time.monotonic() - begun_s).items():
                self.set(target, changed)
            if glide.over:
                self._stop()

        self._glide = self._node.create_timer(STEP_S, step)

    def _now(self, then: Callable[[presets.Preset], None]) -> None:
        """Call `then` with the live settings of both nodes, or of this one if the other is off."""
        node = self._node
        mine = {n: getattr(node.settings, n) for n in sorted(live_fields(type(node.settings)))}
        (other,) = (name for name in INSTRUMENT if name != node.NAME)
        names = sorted(live_fields(NODES[other].settings))
        if other not in self._clients:
            full = node.resolve_service_name(other)
            self._clients[other] = AsyncParameterClient(node, full)
        client = self._clients[other]
        if not client.services_are_ready():
            then({node.NAME: mine})
            return

        def found(future: Any) -> None:
            values = [parameter_value_to_python(value) for value in future.result().values]
            single = (str, bool, int, float)
            told = {
                name: value if isinstance(value, single) else tuple(value or ())
                for name, value in zip(names, values, strict=True)
            }
            then({other: told, node.NAME: mine})

        client.get_parameters(names, found)


@functools.lru_cache(16)  # a morph loads the same two repeatedly
def _loaded(path: Path, mtime_ns: int) -> presets.Preset:
    return presets.load(path)
