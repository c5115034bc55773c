# SPDX-License-Identifier: Apache-2.0
"""The node midi plays an instrument, over JACK's dummy server."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from eol_msgs.msg import Cascade, RequestResult, Slip
from support import needs
from support.jack import served
from support.waiting import wait_until

from eol_ros.core.vision.states import TRACKING
from eol_ros.nodes import midi
from eol_ros.nodes.midi import MidiNode
from eol_ros.ros.requests import parameter_messages
from eol_ros.settings import MidiSettings
from eol_ros.streams.blocks import BLOCK, Blocks
from eol_ros.streams.slips import START, STOP


@pytest.fixture
def server(monkeypatch):
    yield from served('eolmidiout', monkeypatch)


@pytest.fixture
def node(ros):
    made = []

    def make(output, **settings):
        made.append(MidiNode(MidiSettings(output, **settings)))
        return made[-1]

    yield make
    for one in made:
        one.destroy_node()


@pytest.mark.slow
@needs.marker('jackd2')
def test_an_instrument_is_played_and_silenced_at_the_end(server, node):
    rtmidi = pytest.importorskip('rtmidi')
    one = node('jack:virtual')
    instrument = rtmidi.MidiIn(rtmidi.API_UNIX_JACK, 'instrument')
    wait_until(lambda: any('eol_ros' in port for port in instrument.get_ports()))
    instrument.open_port(
        next(i for i, port in enumerate(instrument.get_ports()) if 'eol_ros' in port)
    )
    heard = []

    def until(count):
        def more():
            while message := instrument.get_message():
                heard.append(tuple(message[0]))
            return len(heard) >= count

        wait_until(more, turn=lambda: (one.look(), time.sleep(0.01)))

    one.on_slip(Slip(block=3, kind=START, speed=0.25))
    one.on_slip(Slip(block=3, kind=STOP))
    one.on_cascade(Cascade(nucleus=3, area=25))
    until(4)
    assert heard == [(0x90, 39, 64), (0x80, 39, 0), (0x91, 39, 127), (0x81, 39, 0)]
    assert (one.health.level, one.health.text) == (0, 'plays eol_ros:out')
    one.restart()
    until(6)
    assert heard[4:] == [(0xB0, 123, 0), (0xB1, 123, 0)]
    one.close()
    instrument.close_port()
    instrument.delete()


def test_clock_and_pressure(node, monkeypatch):
    """24 clocks a beat, in phase with its multiples, whatever the timer does; one start before."""
    one = node('nowhere', pressure=True, clock=True)
    sent, now = [], [1000.0]
    monkeypatch.setattr(one, 'play', sent.append)
    monkeypatch.setattr(midi.time, 'time', lambda: now[0])
    for step_s in [0.003] * 500 + [0.05, 0.02] * 10 + [-500.0]:  # beats of 0.5 s; time is set
        one.on_clock()
        now[0] += step_s
    ticks = int((1000.0 + 1.5 + 0.7) / (0.5 / 24)) - int(1000.0 / (0.5 / 24))
    assert sent.count((0xFA,)) == 1 and sent.count((0xF8,)) == ticks
    assert sent.index((0xFA,)) == 23  # the clock of the beat comes next
    result = RequestResult(node='grains', accepted=True)
    result.values = parameter_messages({'beat_period_s': 0.25})
    one.on_result(result)
    for _ in range(2):  # another time, another tempo: from now on
        del sent[:]
        one.on_clock()
        now[0] += 0.25 / 24
    assert sent == [(0xF8,)]
    del sent[:]
    rows = np.zeros(25, BLOCK)
    rows['x'], rows['y'] = one.table.rest.T
    for _ in range(2):  # within 50 ms, once
        one.on_blocks(Blocks(1, TRACKING, False, 1, rows))
    assert sent == [(0xA0, 36 + block, 0) for block in range(25)]
    monkeypatch.setattr(midi, 'MidiOut', lambda name: SimpleNamespace(name=name, there=True))
    one.find()  # the instrument is plugged in: it hears all pressures and a start
    del sent[:]
    one.stress_s = 0.0
    one.on_blocks(Blocks(2, TRACKING, False, 1, rows))
    assert len(sent) == 25
    for _ in range(25):
        one.on_clock()
        now[0] += 0.25 / 24
    assert sent.count((0xFA,)) == 1
    one.out = None


@pytest.mark.slow
@needs.marker('jackd2')
def test_an_output_that_is_not_there_is_looked_for_again(server, node):
    rtmidi = pytest.importorskip('rtmidi')
    one = node('jack:synth')
    one.on_slip(Slip(block=3, kind=START, speed=0.25))
    assert one.health.level == 1
    assert one.health.text == 'no MIDI output: jack:synth: no such output; there is none'
    synth = rtmidi.MidiIn(rtmidi.API_UNIX_JACK, 'synth')
    synth.open_virtual_port('keys')
    wait_until(lambda: one.find() or one.out)
    assert one.health.level == 0 and 'synth' in one.health.text
    synth.close_port()
    synth.delete()
    wait_until(lambda: one.find() or one.health.level == 1)
    one.close()
