# SPDX-License-Identifier: Apache-2.0
"""Plays grain triggers as sound, and publishes a meter that shows it."""

import functools
import time
from pathlib import Path

import numpy as np
from eol_msgs.msg import GrainTrigger, Slip

from eol_ros.core.sound.arrivals import Arrivals
from eol_ros.core.sound.channel_test import ChannelTest
from eol_ros.core.sound.meter import Meter
from eol_ros.core.sound.mixer import AHEAD_S, LOOK_AHEAD_S
from eol_ros.core.sound.ring import output_names
from eol_ros.core.sound.senses import FirstSense, OnsetToSound
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.sound.voicing import Voicing, new_mixer, set_room
from eol_ros.devices.audio.bank import BankLoader
from eol_ros.devices.audio.soundcard import Player
from eol_ros.errors import EolError
from eol_ros.nodes.sound_files import SoundFiles
from eol_ros.ros.main_clock import MainClock
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import LATER
from eol_ros.ros.sound import SampleStream, meter_message
from eol_ros.ros.stamps import NS, now_ns, to_ns
from eol_ros.said import clauses, said
from eol_ros.streams import corpus, slips, triggers
from eol_ros.streams.requests import Asked

COUNTERS = ('triggers', 'underruns', 'late', 'dropped', 'stolen')
FILTER = ('filter', 'filter_hz', 'filter_q', 'filter_by', 'filter_octaves')
FADES = ('mute', 'unmute', 'sleep', 'wake')
TEST_IN_S = 0.1
REMOTE_METER_HZ = 2.0  # 9 kB each, over a cable
OLD_S = 1.0  # later grains are dropped: after a cable is back, many arrive together
DRIVER_S, DRIVER_HUNG_S = 10.0, 60.0  # time limits for a driver to open a card


class SoundNode(EolNode):
    NAME = 'sound'
    MAPS_TIME = True

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s = self.settings
        self.epoch_ns = now_ns() // NS * NS
        self.mixer = new_mixer(s, self.epoch_ns // NS, self.table)
        self.voicing = Voicing(s, self.table)
        self.on_settings(s)
        self.files = SoundFiles(self)
        self.meter, self.banks = Meter(self.mixer), BankLoader(s.sample_rate, self.files.here)
        folder = Path(self.scene.settings('recorder').folder)
        named = folder / time.strftime('sound-%Y%m%d-%H%M%S.wav') if s.device == 'wav' else ''
        self.meters = self.publisher('sound_meter')
        self.samples = SampleStream(self, self.mixer, self.epoch_ns)
        self.unheard = 0
        self.first = FirstSense()
        self.felt = self.told_twice = 0
        self.arrivals = {'latency_s': Arrivals(), 'tap_latency_s': Arrivals()}
        self.late = ''
        self.testing: tuple[Asked, ChannelTest] | None = None
        self.asleep = bool(self.resumed.get('asleep'))
        self.muted = bool(self.resumed.get('muted'))
        self.trouble: str = said('waiting_corpus')
        self.player = Player(
            self.mixer,
            s.device,
            s.block_size,
            s.wav or named,
            s.wav_limit_s,
            s.fade_in_s,
            card_needed=s.card_needed,
            quiet=self.asleep or self.muted,
        )
        # Latest block of the callback of the card or of the thread of the file.
        self.health.watches('sound output', lambda: int(self.mixer.state['frame'][0]))
        self.health.watches('sound watch', self.player.watching, DRIVER_S, DRIVER_HUNG_S)
        here = self.scene.machine_of('panel') in ('', self.scene.machine_of(self.NAME))
        meter_hz = s.meter_hz if here else min(s.meter_hz, REMOTE_METER_HZ)
        self.create_timer(1 / meter_hz, self.on_timer)
        self.create_timer(1.0, self.tell_instrument)
        self.create_timer(1.0, self.judge_arrivals)
        self.subscribe('corpus', self.on_corpus)
        self.by_hand, self.asked = self.publisher('grain_triggers'), 0  # those that people ask for
        fade = dict.fromkeys(FADES, self.on_fade)
        self.requests.serve(
            play_grain=self.on_play_grain,
            test=self.on_test,
            save_preset=self.on_save_preset,
            recall_preset=self.on_recall_preset,
            morph_presets=self.on_morph_presets,
            **fade,
        )
        self.subscribe('grain_triggers', self.on_trigger)
        self.subscribe('felt_triggers', self.on_felt)
        self.main_clock: MainClock = MainClock(self)
        self.sounding: OnsetToSound | None = None
        if 'motion' in self.scene.nodes and not self.sim_time:
            self.sounding = OnsetToSound()
            self.subscribe('slips', self.on_slip)

    @functools.cached_property
    def instrument(self):
        """What plays the settings of grains and sound; made for the first who does."""
        from eol_ros.nodes.sound_control import Instrument

        return Instrument(self)

    def tell_instrument(self) -> None:
        """Tell the panel which presets there are, the filter of grains and the volume."""
        from eol_ros.ros import presets

        told = {name: getattr(self.settings, name) for name in (*FILTER, 'gain_db')}
        self.health.values.update(told, presets=list(presets.names(presets.folder())))

    def judge_arrivals(self) -> None:
        """Say which latency would do while over 1 % of the grains are late, or change to it.

        Where the sound goes nowhere, no grain is late for anybody.
        """
        s, texts = self.settings, []
        heard = self.player.heard or self.samples.heard
        for name, arrivals in self.arrivals.items() if heard else ():
            enough_s = arrivals.remedy_s(time.monotonic(), getattr(s, name))
            if enough_s is None:
                continue
            if enough_s <= s.latency_max_s:
                self.get_logger().warning(f'grains are late: {name} becomes {enough_s:g} s')
                self.instrument.set(self.NAME, {name: enough_s})
            else:
                texts.append(said('grains_late', name=name, enough=f'{enough_s:g}'))
        self.late = clauses(texts)

    def on_save_preset(self, asked: Asked) -> object:
        answer = functools.partial(self.requests.answer, asked)
        self.instrument.save(asked.values['preset'], answer)
        return LATER

    def on_recall_preset(self, asked: Asked) -> None:
        self.instrument.recall(asked.values['preset'], asked.values['over_s'])

    def on_morph_presets(self, asked: Asked) -> None:
        v = asked.values
        self.instrument.morph(v['from'], v['to'], v['share'])

    def on_settings(self, new) -> None:
        self.voicing.settings = new
        set_room(self.mixer, new, self.table)
        self.mixer.set(new.gain_db, new.loudness_lufs, new.governor_db)
        # Whole frames: the grains then start as far apart as without it, as `eol render` has them.
        self.latency_s = round(new.latency_s * new.sample_rate) / new.sample_rate
        self.tap_latency_s = round(new.tap_latency_s * new.sample_rate) / new.sample_rate

    def on_corpus(self, message) -> None:
        self.files.look(message.files)
        from_ns = to_ns(message.header.stamp)
        grains, places = corpus.to_core(message), corpus.places(message)
        told = corpus.values(message)
        if self.banks.ask(message.digest, from_ns, *grains, places=places, descriptors=told):
            self.trouble = said('loading', name=message.name)

    def on_fade(self, asked: Asked) -> None:
        self.asleep = asked.kind == 'sleep' or (self.asleep and asked.kind != 'wake')
        if asked.kind in ('mute', 'unmute'):
            self.muted = asked.kind == 'mute'
        self.fade()
        self.keep(asleep=self.asleep, muted=self.muted)
        self.health.values.update(muted=self.muted, asleep=self.asleep)
        self.health.report()

    def fade(self) -> None:
        self.player.quiet = quiet = self.asleep or self.muted
        s = self.settings
        self.mixer.fade(0.0 if quiet else 1.0, s.fade_out_s if quiet else s.fade_in_s)

    def on_play_grain(self, asked: Asked) -> None:
        """Publish a trigger that no block caused; it comes back, and is heard, like any other."""
        stamp_ns, grain = self.now_ns(), asked.values['grain']
        bank = self.banks.at(stamp_ns)
        if bank is None:
            raise EolError(self.trouble or said('no_corpus'))
        if grain >= len(bank):
            raise EolError(said('no_grain', grain=grain, last=len(bank) - 1))
        row = triggers.of_person(stamp_ns, self.asked, grain)
        self.by_hand.publish(triggers.RECORD.fill(GrainTrigger(), row, self.frame_prefix))
        self.asked += 1

    def on_test(self, asked: Asked) -> object:
        """Play noise from each loudspeaker in turn; say how loud it came out of the mixer."""
        if self.asleep or self.muted:
            return said('quiet_asleep') if self.asleep else said('quiet_muted')
        if self.testing:
            raise EolError(said('test_sounds'))
        start_s = (now_ns() - self.epoch_ns) * 1e-9 + self.latency_s + TEST_IN_S
        self.testing = asked, ChannelTest(self.mixer, start_s, output_names(self.settings))
        return LATER

    def test(self) -> None:
        if self.testing is None:
            return
        asked, test = self.testing
        outcome = test.outcome(time.monotonic(), self.player.text)
        if outcome is not None:
            self.testing = None
            self.requests.answer(asked, *outcome)

    def restart(self) -> None:
        self.first = FirstSense()
        if self.asleep:  # the run had ended asleep, and begins awake
            self.asleep = False
            self.fade()

    def time_jumped(self, jump_ns: int) -> None:
        """The clock of the engine locks again by itself; who was asleep stays so."""
        self.banks.time_jumped(jump_ns)

    def on_trigger(self, message) -> None:
        self.health.tick()
        stamp_ns = to_ns(message.header.stamp)
        if message.block != triggers.NO_BLOCK:
            self.stamped(stamp_ns)
        self.play(message, stamp_ns, self.latency_s)

    def on_felt(self, message) -> None:
        self.felt += 1
        self.play(message, to_ns(message.header.stamp), self.tap_latency_s, felt=True)

    def on_slip(self, slip: Slip) -> None:
        if self.sounding and slip.kind == slips.START:
            self.took(self.sounding.began(
                slip.block, to_ns(slip.header.stamp) * 1e-9, to_ns(slip.onset) * 1e-9
            ))  # fmt: skip

    def took(self, latency_s: float | None) -> None:
        if latency_s is not None:
            self.health.took('onset_to_sound', latency_s)

    def play(self, message, stamp_ns: int, latency_s: float, felt: bool = False) -> None:
        came_ns = time.time_ns()
        by_hand = message.block == triggers.NO_BLOCK
        if not by_hand and not self.first.plays(
            stamp_ns * 1e-9, message.block, message.grain, felt
        ):
            self.told_twice += 1
            return
        bank = self.banks.at(stamp_ns)
        if bank is None:
            self.unheard += 1
            return
        since_ns = self.wall_ns(stamp_ns) - self.epoch_ns
        if self.sim_time and by_hand:  # of the panel, in a pause
            since_ns = now_ns() - self.epoch_ns
        latency_s = min(latency_s * self.stretch(), AHEAD_S / 2)
        trigger = triggers.to_core(message, since_ns * 1e-9 + latency_s)
        # it is late where the frame at which it begins has been mixed already
        mixed_s = self.mixer.time_of(int(self.mixer.state['frame'][0]))
        spare_s = since_ns * 1e-9 + latency_s - LOOK_AHEAD_S - mixed_s
        live = not (by_hand or self.sim_time)
        if live and spare_s < -OLD_S:
            self.unheard += 1
            return
        self.mixer.play(np.array([trigger], TRIGGER), bank, self.voicing)
        if not live:
            return
        arrivals = self.arrivals['tap_latency_s' if felt else 'latency_s']
        arrivals.add(time.monotonic(), latency_s - spare_s)
        kind = 'stamp_to_tap_trigger' if felt else 'stamp_to_trigger'
        self.health.took(kind, (came_ns - self.epoch_ns - since_ns) * 1e-9)
        if self.sounding and not (self.muted or self.asleep):
            at_s = stamp_ns * 1e-9 + latency_s - min(spare_s, 0.0)
            self.took(self.sounding.sounds(message.block, stamp_ns * 1e-9, at_s))

    def on_timer(self) -> None:
        for error in self.banks.news():
            self.trouble = str(error) if error else ''
        player, state, s = self.player, self.mixer.state[0], self.settings
        reading = self.meter.read()
        self.meters.publish(meter_message(reading, self.epoch_ns, state, player.output.name, s))
        self.samples.look()
        self.test()
        self.health.values.update(
            voices=reading.voices,
            load=round(reading.load, 3),
            unheard=self.unheard,
            felt=self.felt,
            told_twice=self.told_twice,
            muted=self.muted,
            asleep=self.asleep,
            testing=self.testing is not None,
            card_missing=player.card_missing,
            peak_dbfs=round(reading.peak_dbfs, 1),
            losses=player.losses,
            output_ms=round(1e3 * player.output.latency_s, 1),
            relocks=int(state['clock_locks']),
            **{k: int(state[k]) for k in COUNTERS},
        )
        silent = said('muted') if self.muted else ''
        silent = said('asleep') if self.asleep else silent
        late = '' if silent else self.late
        trouble = self.trouble or self.files.trouble or late
        text = clauses([silent, player.text, trouble, self.main_clock.report()])
        level = 'warn' if trouble and player.level == 'ok' else player.level
        getattr(self.health, level)(text)
        if player.stuck:
            raise EolError(f'{text}: only a new process gets it back')

    def close(self) -> None:
        self.banks.close()
        self.player.close(self.settings.fade_out_s)
