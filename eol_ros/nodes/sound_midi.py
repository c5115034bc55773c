# SPDX-License-Identifier: Apache-2.0
"""The sound node's MIDI input: controllers, keys and programs play its live settings."""

import functools
import time
from typing import TYPE_CHECKING

from eol_ros.core.sound.midi import Change, Cue, Event, Recall, event_of
from eol_ros.devices.audio.midi import MidiIn
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.nodes.sound_control import Instrument
from eol_ros.ros import presets
from eol_ros.ros.requests import Answers, RequestClient, expected_of
from eol_ros.streams.requests import CUE, Asked

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

PERIOD_S = 0.02
RETRY_S = 5.0  # an instrument that is not plugged in, or was pulled out


class Midi:
    """Plays the live settings of grains and sound as the settings `midi` and `midi_map` say."""

    def __init__(self, node: 'EolNode', instrument: Instrument):
        self._node, self._instrument = node, instrument
        self._lines = node.settings.midi_map
        self._mapping = presets.midi_mapping(self._lines)
        self.input: MidiIn | None = None
        self._tried_s: float | None = None
        self._told: str | None = None
        scene = node.scene
        self._there = {*scene.nodes, *scene.elsewhere}
        self._client = RequestClient(node, node.requests.publisher)
        node.requests.on_results(self._client.heard)
        node.create_timer(PERIOD_S, self.look)

    def look(self) -> None:
        """Do what has come; of each controller the last counts."""
        settings = self._node.settings
        if settings.midi_map != self._lines:
            self._lines, self._mapping = settings.midi_map, presets.midi_mapping(settings.midi_map)
        events: dict[tuple, Event] = {}
        for message in self._messages():
            event = event_of(message)
            if event is not None:
                key = (event.words, *(() if event.source == 'cc' else (len(events),)))
                events.pop(key, None)
                events[key] = event
        for event in events.values():
            self._do(event)
        self._client.look()

    def close(self) -> None:
        """Give the input back."""
        if self.input:
            self.input.close()

    def _messages(self) -> list[list[int]]:
        if self.input is None:
            now_s = time.monotonic()
            if self._tried_s is None or now_s - self._tried_s > RETRY_S:
                self._tried_s = now_s
                try:
                    self.input = MidiIn(self._node.settings.midi)
                    self._node.get_logger().info(f'MIDI from {self.input.name}')
                    self._told = None
                except DeviceMissing as error:
                    if str(error) != self._told:
                        self._node.get_logger().warning(f'MIDI: {error}; looking again')
                    self._told = str(error)
        elif time.monotonic() - (self._tried_s or 0.0) > RETRY_S:
            self._tried_s = time.monotonic()
            if not self.input.there:
                self._node.get_logger().warning(f'MIDI: {self.input.name} is gone; looking again')
                self.input.close()
                self.input = None
        return self.input.take() if self.input else []

    def _do(self, event: Event) -> None:
        try:
            found = self._mapping.actions(event)
            if not found and event.source == 'program':  # no line names it: presets by their order
                known = presets.names(presets.folder())
                found = [Recall(name) for name in known[event.number : event.number + 1]]
            for action in found:
                if isinstance(action, Change):
                    value = action.value
                    given = value if isinstance(value, tuple) else (value,)
                    self._instrument.change(action.node, action.name, given)
                elif isinstance(action, Recall):
                    self._instrument.recall(action.preset)
                elif isinstance(action, Cue):
                    asked = Asked(CUE, values={'name': action.name}, source=self._node.NAME)
                    expected = expected_of(CUE, '', self._there.__contains__)
                    done = functools.partial(self._answered, event.words)
                    self._client.ask(asked, expected, done)
                else:
                    self._instrument.morph(action.start, action.end, action.share)
        except EolError as error:
            self._warn(event.words, str(error))

    def _answered(self, words: str, answers: Answers) -> None:
        if answers.refusal or not answers.whole:
            self._warn(words, answers.refusal or answers.silent)

    def _warn(self, words: str, why: str) -> None:
        self._node.get_logger().warning(f'MIDI {words}: {why}')
