# SPDX-License-Identifier: Apache-2.0
"""Plays a MIDI instrument by slips and stress (channel 1) and cascades (channel 2); sends clock."""

import time

from eol_msgs.msg import Cascade, RequestResult, Slip

from eol_ros.core.sound.midi_notes import CLOCK, CLOCKS, START, Message, Notes
from eol_ros.core.vision.states import TRACKING
from eol_ros.devices.audio.midi import MidiOut
from eol_ros.errors import DeviceMissing
from eol_ros.ros.node import EolNode
from eol_ros.said import said
from eol_ros.streams import slips
from eol_ros.streams.osc import poses, strains
from eol_ros.streams.requests import values_of

LOOK_S = 0.05
STRESS_S = 0.05  # least time between two looks at stress
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
        grains = self.scene.settings('grains')
        self.beat_s, self.break_m = grains.beat_period_s, grains.ambience_break_m
        self.stress_s = 0.0  # when stress was sent, steady clock
        if s.pressure:
            self.subscribe('blocks', self.on_blocks)
        self.tick_s, self.clocks, self.started = 0.0, 0, False  # clocks: number of the last one
        self.clock = self.create_timer(1.0, self.on_clock, autostart=False)
        if s.clock:
            self.subscribe('request_results', self.on_result)
            self.resume(self.clock)
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
                self.started = False
                self.notes.forget()
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

    def on_blocks(self, message) -> None:
        now_s = time.monotonic()
        if now_s >= self.stress_s + STRESS_S:
            self.stress_s = now_s
            at = poses(message.rows, message.state == TRACKING)
            for note in self.notes.stress(strains(at, self.break_m, self.table).tolist()):
                self.play(note)

    def on_result(self, result: RequestResult) -> None:
        if result.node == 'grains' and result.accepted:
            self.beat_s = values_of(result.values).get('beat_period_s', self.beat_s)

    def on_clock(self) -> None:
        """Send the clocks that are due; beats are at multiples of their period, as in grains."""
        self.clock.cancel()
        tick_s, now_s = self.beat_s / CLOCKS, time.time()
        number = int(now_s // tick_s)
        if tick_s != self.tick_s or not 0 <= number - self.clocks <= CLOCKS:  # time was set
            self.tick_s, self.clocks, self.started = tick_s, number, False
        for clock in range(self.clocks + 1, number + 1):
            if not (self.started or clock % CLOCKS):
                self.started = True
                self.play(START)
            self.play(CLOCK)
        self.clocks = number
        self.resume(self.clock, max((number + 1) * tick_s - now_s, 0.001))

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
