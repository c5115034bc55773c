# SPDX-License-Identifier: Apache-2.0
"""Plays a MIDI instrument by slips (channel 1) and cascades (channel 2)."""

import time

from eol_msgs.msg import Cascade, Slip

from eol_ros.core.sound.midi_notes import Message, Notes
from eol_ros.devices.audio.midi import MidiOut
from eol_ros.errors import DeviceMissing
from eol_ros.ros.node import EolNode
from eol_ros.said import said
from eol_ros.streams import slips

LOOK_S = 0.05
RETRY_S = 5.0  # an instrument that is not plugged in, or was pulled out


class MidiNode(EolNode):
    NAME = 'midi'
    READS_ONLY = True

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s = self.settings
        self.notes = Notes(s.lowest_note, s.fastest_mps, self.table.count)
        self.out: MidiOut | None = None
        self.subscribe('slips', self.on_slip)
        self.subscribe('cascades', self.on_cascade)
        self.create_timer(LOOK_S, self.look)
        self.create_timer(RETRY_S, self.find)
        self.find()

    def find(self) -> None:
        """Open the output if it is there, and give it back if it has gone."""
        if self.out and not self.out.there:
            self.out.close()
            self.out = None
        try:
            if not self.out:
                self.out = MidiOut(self.settings.output)
        except DeviceMissing as error:
            self.health.warn(said('midi_missing', why=str(error)))
        else:
            self.health.ok(said('midi_to', name=self.out.name))

    def on_slip(self, slip: Slip) -> None:
        starts = slip.kind == slips.START
        note = self.notes.starts(slip.block, slip.speed) if starts else self.notes.stops(slip.block)
        self.play(note)

    def on_cascade(self, cascade: Cascade) -> None:
        self.play(self.notes.cascade(cascade.nucleus, cascade.area, time.monotonic()))

    def look(self) -> None:
        for message in self.notes.over(time.monotonic()):
            self.play(message)

    def play(self, message: Message) -> None:
        if self.out:
            self.out.send(message)
            self.health.tick()

    def restart(self) -> None:
        for message in self.notes.silence():
            self.play(message)

    def close(self) -> None:
        self.restart()
        if self.out:
            self.out.close()
