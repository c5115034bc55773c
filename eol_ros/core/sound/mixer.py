# SPDX-License-Identifier: Apache-2.0
"""The mixer: one compiled loop over all sounding grains, the same live and offline.

`bank.voice_rows` turns triggers into voices, `Mixer.push` puts them into the ring, `render` makes
the next frames. Nothing in it allocates, waits or calls Python, so a sound card may call it.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.prefetch import CACHE_LINE, prefetch
from eol_ros.core.sound import clock, grain_filter, room
from eol_ros.core.sound.bank import Bank, voice_rows, warm_up
from eol_ros.core.sound.buses import blend, pole
from eol_ros.core.sound.envelope import add_edge, add_flat, fade_out
from eol_ros.core.sound.lanes import WIDTH
from eol_ros.core.sound.limiter import ONE, condition, limit
from eol_ros.core.sound.loudness import k_weighting
from eol_ros.core.sound.mixer_layout import (
    CHUNK,
    FOREVER,
    RING,
    Memory,
    allocate,
    fence,
    memory,
)
from eol_ros.core.sound.room import reverberate
from eol_ros.core.sound.taps import read

if TYPE_CHECKING:
    from eol_ros.core.sound.voicing import Voicing

STEAL_S = 0.002  # a voice that makes room for another fades out in this time
LOOK_AHEAD_S = 0.003
LIMITER_RELEASE_S = 0.08
DC_HZ = 7.0
AHEAD_S = 30.0  # a trigger further in the future comes from another clock
# s, until a pushed voice has begun: 16 calls of at most 1 s empty the ring; the voices before it,
# and then this voice, may be AHEAD_S early.
WAIT_S = 16 + 2 * AHEAD_S


@njit(cache=True)
def _fetch(v, begin, end):
    """Ask for the samples that voice `v` reads in the frames begin..end."""
    at = v.source + 4 * np.int64(v.rate * max(begin - v.start, 0))
    for line in range(at, at + np.int64(4 * v.rate * (end - begin)), CACHE_LINE):
        prefetch(line)


@njit(cache=True, nogil=True)
def _mix(m, begin, end, origin):
    """Add all voices to the mix for the frames begin..end; the mix begins at frame `origin`."""
    s = m.state[0]
    mix, voices, order = m.mix, m.voices, m.order
    steal_frames = s.steal_frames
    scratch = m.scratch.ctypes.data
    for i in range(s.voices):
        if i + 1 < s.voices:  # a grain lies anywhere in memory: fetch it while this one is mixed
            _fetch(voices[order[i + 1]], begin, end)
        v = voices[order[i]]
        last = v.length - 1
        n = max(begin - v.start, 1)  # its first and its last sample are zero by definition
        stop = min(end - v.start, last)
        if v.steal != FOREVER:
            stop = min(stop, v.steal + steal_frames - v.start)
        if n >= stop:
            continue
        if s.buses:  # a room has buses, too
            m.summed[v.channel_a] = m.summed[v.channel_b] = 1
        # A filter works by groups of samples of its grain, and comes to what it had begun again.
        again = (n - 1) % WIDTH if v.tuning != 0.0 else 0
        row = v.source + 4 * (n - again)
        if v.rate != 1.0:
            row = scratch
            read(row, v.source, v.rate, n - again, stop - n + again)
        if v.tuning != 0.0:
            grain_filter.run(scratch, row, stop - n + again, m.tables[order[i]])
            row = scratch + 4 * again
        if stop > v.steal - v.start:
            left = v.steal + steal_frames - v.start - n
            fade_out(scratch, row, stop - n, left, steal_frames)
            row = scratch
        at = 4 * (n + v.start - origin)
        a, b = mix[v.channel_a].ctypes.data + at, mix[v.channel_b].ctypes.data + at
        if n < v.attack:
            k = min(v.attack, stop) - n
            add_edge(a, b, row, k, n, np.float32(1 / v.attack), v.gain_a, v.gain_b)
            a, b, row, n = a + 4 * k, b + 4 * k, row + 4 * k, n + k
        if n < stop and n < last - v.release:
            k = min(last - v.release, stop) - n
            add_flat(a, b, row, k, v.gain_a, v.gain_b)
            a, b, row, n = a + 4 * k, b + 4 * k, row + 4 * k, n + k
        if n < stop:
            scale = np.float32(-1 / v.release)
            add_edge(a, b, row, stop - n, n - last, scale, v.gain_a, v.gain_b)


@njit(cache=True)
def _end(s, v):
    """Return the frame at which voice `v` has ended."""
    return min(v.start + v.length, v.steal + s.steal_frames)


@njit(cache=True)
def _level(v, frame):
    """Return how loud `v` can still become after `frame`: its gain, or less in its release."""
    left = v.start + v.length - 1 - frame
    return (v.gain_a + v.gain_b) * min(1.0, left / v.release)


@njit(cache=True)
def _make_room(m, frame):
    """If all voices are in use at `frame`, fade out the one with the lowest gain."""
    s = m.state[0]
    alive, quietest, least = 0, -1, np.inf
    for i in range(s.voices):
        v = m.voices[m.order[i]]
        if v.steal == FOREVER and _end(s, v) > frame:
            alive += 1
            level = _level(v, frame)
            if level < least:
                least, quietest = level, i
    if alive >= s.max_voices:
        m.voices[m.order[quietest]].steal = frame
        s.stolen += 1


@njit(cache=True)
def _sweep(m, frame):
    """Forget the voices that have ended by `frame`; the others keep their order."""
    s = m.state[0]
    kept = gone = 0
    for i in range(s.voices):
        row = m.order[i]
        if _end(s, m.voices[row]) > frame:
            m.order[kept] = row
            kept += 1
        else:
            m.ended[gone] = row
            gone += 1
    m.order[kept : s.voices] = m.ended[:gone]
    s.voices = kept


@njit(cache=True)
def _ingest(m):
    """Take triggers from the ring and sort them in by start; equal starts keep their order."""
    s = m.state[0]
    head = s.ring_head
    fence()
    for _ in range(s.ingest):
        if s.ring_tail == head or s.pending == RING:
            break
        v = m.ring[s.ring_tail % RING]
        v.start = clock.frame_at(s, v.time_s) - s.look_ahead
        if v.start > s.frame + AHEAD_S * s.sample_rate:
            s.dropped += 1
            s.ring_tail += 1
            continue
        i = s.pending
        while i > 0 and m.pending[i - 1].start > v.start:
            m.pending[i] = m.pending[i - 1]
            i -= 1
        m.pending[i] = v
        s.pending += 1
        s.triggers += 1
        fence()
        s.ring_tail += 1


@njit(cache=True)
def _begin(m, until):
    """Start what is due before frame `until` and mix all voices up to there."""
    s = m.state[0]
    origin = done = s.frame
    used = 0
    while used < s.pending and m.pending[used].start < until:
        v = m.pending[used]
        used += 1
        if v.start < origin:
            v.start = origin
            s.late += 1
        if s.voices == s.capacity:  # room may come free up to here: mix so far, then look
            _mix(m, done, v.start, origin)
            done = v.start
            _sweep(m, done)
            if s.voices == s.capacity:
                s.dropped += 1
                continue
        if s.voices >= s.max_voices:
            _make_room(m, v.start)
        m.voices[m.order[s.voices]] = v
        if v.tuning != 0.0:
            grain_filter.design(m.tables[m.order[s.voices]], v.tuning, v.damping, v.band)
        s.voices += 1
    if used:
        for i in range(s.pending - used):
            m.pending[i] = m.pending[i + used]
        s.pending -= used
    _mix(m, done, until, origin)
    _sweep(m, until)


@njit(cache=True, nogil=True)
def render(address, out):
    """Render the next frames of the mixer at `address` into `out` (frames, channels) f4."""
    m = memory(address)
    s = m.state[0]
    _ingest(m)
    at = 0
    while at < out.shape[0]:
        n = min(CHUNK, out.shape[0] - at)
        m.mix[: max(2, s.channels), :n] = 0
        _begin(m, s.frame + n)
        if s.buses:
            blend(m, n)
        if s.room_tail:
            reverberate(m, n)
        condition(m, n)
        limit(m, out, at, n)
        k = 0
        while k < n:
            i = (s.frame + k) % s.history
            span = min(n - k, s.history - i)
            m.past[i : i + span] = out[at + k : at + k + span]
            k += span
        s.frame += n
        at += n


class Mixer:
    """A mixer with its memory. One thread pushes, one thread renders; neither waits.

    Parameters
    ----------
    sample_rate : float
        Hz.
    channels : int
        Loudspeakers, in a row from left to right.
    max_voices : int
        Polyphony: beyond it a voice is stolen.
    gain_db : float
        Master gain.
    ceiling_db : float
        Ceiling of the limiter, dBFS.
    loudness_lufs, governor_db : float
        Above this loudness the governor turns down, by so much at most.
    epoch_s : float
        The time of frame 0.
    buses : int
        Beside the mix, for grains that are filtered together: rows of `voice_rows(bus=...)`.
    room_s, room_high_s : float
        Decay by 60 dB of the room, at low frequencies and at 4 kHz; 0: there is none. It hears
        the buses, by `set_wets`.

    Examples
    --------
    >>> mixer = Mixer(48000, channels=2)
    >>> mixer.render(512).shape, mixer.look_ahead > 0
    ((512, 2), True)
    """

    def __init__(
        self,
        sample_rate: float = 48000,
        channels: int = 2,
        max_voices: int = 512,
        gain_db: float = -4.0,
        ceiling_db: float = -1.0,
        loudness_lufs: float = -18.0,
        governor_db: float = 6.0,
        epoch_s: float = 0.0,
        buses: int = 0,
        room_s: float = 0.0,
        room_high_s: float = 0.0,
    ):
        look_ahead = int(round(LOOK_AHEAD_S * sample_rate))
        history = 1 << math.ceil(1.3 * sample_rate - 1).bit_length()
        self.memory: Memory
        lines = room.delays(sample_rate)
        line_size = 1 << int(lines.max() + room.SPAN).bit_length() if room_s else 0
        self.memory, self._table = allocate(
            channels, 2 * max_voices, look_ahead, history, buses, line_size,
            round(room_s * room.TAIL_DB / 60 * sample_rate),
        )  # fmt: skip
        self.address = int(self._table.ctypes.data)
        self.sample_rate, self.channels = sample_rate, channels
        s = self.state = self.memory.state
        s['sample_rate'], s['max_voices'], s['ingest'] = sample_rate, max_voices, RING // 16
        s['steal_frames'] = round(STEAL_S * sample_rate)
        s['ceiling'] = elementary.exp10(ceiling_db / 20) * (1 - 1e-6)  # float32 rounds
        s['release'] = 1 - elementary.exp(-1 / (LIMITER_RELEASE_S * sample_rate))
        s['dc_pole'] = 1 - 2 * np.pi * DC_HZ / sample_rate
        if room_s:
            self.memory.room.delays[:] = lines
            self.memory.room.coefficients[:] = room.coefficients(sample_rate, room_s, room_high_s)
        for gain in ('limiter', 'limiter_least', 'held', 'governor', 'fade', 'fade_target'):
            s[gain] = 1
        self.memory.box[:] = ONE
        s['box_sum'] = ONE * self.memory.box.size
        s['clock_period'] = 1 / sample_rate
        s['epoch'] = epoch_s
        self.memory.weights[:] = k_weighting(sample_rate)[:, [0, 1, 2, 4, 5]].ravel()
        self.set(gain_db, loudness_lufs, governor_db)
        s['gain'] = s['gain_target']
        self._lent: dict[int, tuple[Bank, float]] = {}  # by id, with its last frame
        publish(s, 0)  # compiles it now, not at the first trigger
        warm_up()
        render(self.address, np.empty((0, channels), np.float32))

    @property
    def look_ahead(self) -> int:
        """Frames by which the limiter delays; triggers start that much earlier to be in time."""
        return int(self.state['look_ahead'][0])

    def set(self, gain_db: float, loudness_lufs: float, governor_db: float) -> None:
        """Change what may change while it sounds; the gain glides."""
        s = self.state
        s['gain_target'] = elementary.exp10(gain_db / 20)
        s['loudness'], s['governor_range'] = loudness_lufs, governor_db

    def fade(self, to: float, seconds: float, at_once_from: float | None = None) -> None:
        """Fade the master to 0 or 1 in `seconds`; `at_once_from` jumps there first."""
        s = self.state
        s['fade_step'] = 1.0 if seconds <= 0 else 1 / (seconds * self.sample_rate)
        if at_once_from is not None:
            s['fade'] = at_once_from
        s['fade_target'] = to

    def recent(self, frames: int, end: int | None = None) -> np.ndarray:
        """Return `frames` of the output before frame `end` (None: the newest), (frames, channels).

        At most a second or so is remembered; before the first frame there are zeros.
        """
        s = self.state
        past = self.memory.past
        frames = min(frames, len(past) * 3 // 4)  # the rest may be overwritten meanwhile
        end = int(s['frame'][0] if end is None else end) % len(past)
        if frames <= end:
            return past[end - frames : end].copy()
        return np.concatenate([past[end - frames :], past[:end]])

    def time_of(self, frame: int) -> float:
        """Return when `frame` sounds, on the engine's time axis, seconds."""
        s = self.state[0]
        return float(s['clock_time'] + (frame - s['clock_frame']) * s['clock_period'])

    def set_corners(self, corner_hz: np.ndarray) -> None:
        """Set the corner of the low-passes of each bus, (1 + buses,), Hz; the first has none."""
        self.memory.poles[:] = pole(corner_hz, self.sample_rate)

    def set_low_corners(self, corner_hz: np.ndarray) -> None:
        """Set the corner of the high-pass of each bus, (1 + buses,), Hz; the first has none."""
        self.memory.highs[:] = pole(corner_hz, self.sample_rate)

    def set_wets(self, wets: np.ndarray) -> None:
        """Set which share of each bus, (1 + buses,), the room hears; the first is the mix."""
        self.memory.room.wets[:] = wets

    def play(self, triggers: np.ndarray, bank: Bank, voicing: 'Voicing | None' = None) -> None:
        """Push what can be played of `triggers` (n,) TRIGGER; the rest counts as dropped.

        `voicing` makes the voices, if there is one. The bank is kept in memory for as long as its
        voices may read it.
        """
        if voicing is None:
            rows = voice_rows(triggers, bank, self.channels)
            refused = len(triggers) - len(rows)
        else:
            rows, mask = voicing.rows(triggers, bank)
            refused = int(mask.sum())
        self.push(rows)
        s = self.state[0]
        s['dropped'] += refused
        now = int(s['frame'])
        self._lent = {key: kept for key, kept in self._lent.items() if kept[1] >= now}
        if len(rows):
            until = now + WAIT_S * self.sample_rate + int(rows['length'].max())
            self._lent[id(bank)] = bank, max(until, self._lent.get(id(bank), (bank, 0.0))[1])

    def push(self, rows: np.ndarray) -> int:
        """Put voices (n,) VOICE into the ring; return how many fitted. The rest is dropped.

        Raises ValueError if a voice names a channel or bus that this mixer does not have.
        """
        s = self.state
        for channel in (rows['channel_a'], rows['channel_b']):
            if len(rows) and not 0 <= channel.min() <= channel.max() < len(self.memory.mix):
                raise ValueError(
                    f'voice on row {channel.max()} of {len(self.memory.mix)} (channels x buses):'
                    ' make the mixer with new_mixer(settings) of the same settings'
                )
        head = int(s['ring_head'][0])
        n = min(len(rows), RING - (head - int(s['ring_tail'][0])))
        self.memory.ring[(head + np.arange(n)) % RING] = rows[:n]
        publish(s, head + n)
        s['dropped'] += len(rows) - n
        return n

    def render(self, frames: int) -> np.ndarray:
        """Mix the next frames.

        Parameters
        ----------
        frames : int
            How many.

        Returns
        -------
        ndarray
            (frames, channels) float32, full scale 1.

        Examples
        --------
        >>> float(np.abs(Mixer(48000).render(480)).max())
        0.0
        """
        out = np.empty((frames, self.channels), np.float32)
        render(self.address, out)
        return out


@njit(cache=True)
def publish(state, head):
    """Let the reader of the ring see what was written to it before."""
    fence()
    state[0].ring_head = head
