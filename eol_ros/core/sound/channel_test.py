# SPDX-License-Identifier: Apache-2.0
"""A burst of noise from each loudspeaker in turn, and how loud it came out of the mixer."""

from collections.abc import Sequence

import numpy as np

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.meter import FLOOR_DB, decibels
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.said import said

BURST_S = 0.35
EVERY_S = 0.55
EDGE_S = 0.01
PEAK = 0.25  # of the noise, before the master
PATIENCE_S = 4.0  # where no channel is measured for so long, the output stands still


def pink_noise(sample_rate: float) -> np.ndarray:
    """Return noise (n,) f4 as loud in each octave, which shows what a loudspeaker lacks."""
    n = round(BURST_S * sample_rate)
    spectrum = np.fft.rfft(np.random.default_rng(1).standard_normal(n))
    hz = np.fft.rfftfreq(n, 1 / sample_rate)
    spectrum *= (hz > 60) / np.sqrt(np.maximum(hz, 60))
    noise = np.fft.irfft(spectrum, n)
    return (PEAK * noise / np.abs(noise).max()).astype(np.float32)


class ChannelTest:
    """Plays the bursts, from `start_s` on the time axis of the engine, and measures each.

    `names`: the name of each output.

    `levels_db` has a level for each channel that was measured: the peak of its samples while its
    burst sounded; NaN if they were not read in time.
    """

    def __init__(self, mixer: Mixer, start_s: float, names: Sequence[str]):
        self._mixer, self._names = mixer, names
        self.levels_db: list[float] = []
        rate, channels = mixer.sample_rate, mixer.channels
        bank = Bank([pink_noise(rate)], [0], [0.0], [BURST_S], rate)
        rows = np.zeros(channels, TRIGGER)
        rows['time_s'] = start_s + EVERY_S * np.arange(channels)
        rows['gain'] = rows['rate'] = 1.0
        rows['pan'] = np.linspace(-1.0, 1.0, channels) if channels > 1 else 0.0
        rows['attack_s'] = rows['release_s'] = EDGE_S
        self._next = 0
        self._measured_s: float | None = None  # when a channel was measured last
        self._rows, self._bank = rows, bank

    def look(self) -> bool:
        """Play what is due and measure what has sounded; return whether all is done."""
        mixer, state = self._mixer, self._mixer.state[0]
        frame = int(state['frame'])
        now_s = mixer.time_of(frame)
        due = self._rows['time_s'][self._next :] < now_s + 10 * EVERY_S
        if due.any():  # those far ahead would be taken for ones of another clock
            count = int(due.sum())
            mixer.play(self._rows[self._next : self._next + count], self._bank)
            self._next += count
        frames = round(BURST_S * mixer.sample_rate)
        while len(self.levels_db) < mixer.channels:
            channel = len(self.levels_db)
            past_s = now_s - self._rows['time_s'][channel] - BURST_S
            if past_s < 0:
                return False
            if past_s > 0.5:  # its samples are no longer remembered
                self.levels_db.append(float('nan'))
                continue
            heard = mixer.recent(frames, frame - round(past_s * mixer.sample_rate))[:, channel]
            self.levels_db.append(decibels(float(np.abs(heard).max())))
        return True

    def outcome(self, now_s: float, output: str) -> tuple[bool, str] | None:
        """Look; return whether noise came from every channel, in words too, once that is known.

        `now_s` is of a steady clock: that of the engine stands still with the output, which the
        words name as `output`.
        """
        measured, done = len(self.levels_db), self.look()
        if self._measured_s is None or len(self.levels_db) > measured:
            self._measured_s = now_s
        if not done and now_s - self._measured_s <= PATIENCE_S:
            return None
        silent = self.silent() if done else ['all but ' + (self.words() or 'none')]
        if silent:
            return False, said('test_silent', why=output, speakers=', '.join(silent))
        return True, said('test_heard', why=output, levels=self.words())

    def silent(self) -> list[str]:
        """Return the names of the channels from which nothing came."""
        return [
            name
            for name, level_db in zip(self._names, self.levels_db, strict=False)
            if level_db <= FLOOR_DB
        ]

    def words(self) -> str:
        """Return the levels as text: `left -16 dBFS, right -16 dBFS`."""
        return ', '.join(
            f'{name} ' + (f'{level_db:.0f} dBFS' if level_db == level_db else 'not measured')
            for name, level_db in zip(self._names, self.levels_db, strict=False)
        )
