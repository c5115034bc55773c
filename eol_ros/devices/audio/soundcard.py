# SPDX-License-Identifier: Apache-2.0
"""The sound card, through PortAudio; where there is none, a file takes its place.

`Player` keeps a mixer sounding whatever happens to the card: it notices a card that has stopped
asking for samples, goes on with the file, and takes the card again when it is back.
"""

import atexit
import ctypes
import threading
import time
from pathlib import Path

import numpy as np

from eol_ros.core.sound.mixer import Mixer
from eol_ros.devices.audio.callback import callback, serve
from eol_ros.devices.audio.outputs import find, portaudio, reason, rescan
from eol_ros.devices.audio.wav_sink import WavSink
from eol_ros.devices.backoff import Backoff
from eol_ros.devices.carrier_thread import aside, carrier_thread
from eol_ros.devices.rounds import Rounds
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.said import clauses, said

WATCH_S = 0.1  # between two looks at the card
STILL_S = 0.6  # a card that asks for nothing for so long is gone
RETRY_S = 3.0  # longest wait between two tries to take the card again
GIVE_UP_S = 0.2  # a block takes a few milliseconds at most
CLOSE_S = 2.0  # a driver that needs longer to close hangs
LOST_S = 0.5  # the same where the device is gone: there is nothing left to play to the end


class Card:
    """An open PortAudio stream, silent until `play`; raises DeviceMissing if none opens."""

    def __init__(self, mixer: Mixer, device: str, block_size: int):
        sd = portaudio()
        mixer.state['card'] = 0
        serve(mixer.address, np.zeros((0, mixer.channels), np.float32), 0)  # compile before
        number = find(device, mixer.channels)
        self._mixer, self._held = mixer, False
        self.name = sd.query_devices(number)['name']
        try:
            # Documented for authors of libraries: a C function pointer as the callback.
            self._stream = sd._StreamBase(
                kind='output',
                wrap_callback=None,
                callback=sd._ffi.cast('PaStreamCallback*', callback.address),
                userdata=sd._ffi.cast('void*', mixer.address),
                samplerate=mixer.sample_rate,
                blocksize=block_size,
                device=number,
                channels=mixer.channels,
                dtype='float32',
                latency='low',
            )
            self._hold()
            self._stream.start()
        except sd.PortAudioError as error:
            self.close()
            raise DeviceMissing(
                f'sound card {self.name}: cannot play {mixer.channels} channels at '
                f'{mixer.sample_rate:.0f} Hz ({reason(error)}); `eol devices` lists what there is'
            ) from None
        self.latency_s = float(self._stream.latency)

    def play(self) -> None:
        """Let the card render the mixer from now on; nobody else may."""
        self._mixer.state['clock_steady'] = 0
        self._mixer.state['card'] = 1

    def give_up(self) -> bool:
        """Never touch the mixer again, whatever the driver does; return whether that is so now.

        False if the driver's thread stands still in the middle of a block.
        """
        state = self._mixer.state
        state['card'] = 0
        deadline = time.monotonic() + GIVE_UP_S
        while state['busy'][0] and time.monotonic() < deadline:
            time.sleep(0.001)
        return not state['busy'][0]

    def close(self, timeout_s: float = CLOSE_S) -> bool:
        """Stop; return whether the driver did it in time. One whose device is gone may hang."""
        if not self._held:
            return True
        self.give_up()
        closing = threading.Thread(
            target=self._stream.close, kwargs={'ignore_errors': True}, daemon=True
        )
        closing.start()
        closing.join(timeout_s)
        if closing.is_alive():  # to end PortAudio then, as sounddevice would at exit, aborts
            atexit.unregister(portaudio()._exit_handler)
            return False
        self._held = False
        for kept in (self._mixer, self._stream):
            ctypes.pythonapi.Py_DecRef(ctypes.py_object(kept))
        return True

    def _hold(self) -> None:
        """Let nothing the driver may look at be freed, not even where this card is forgotten."""
        for kept in (self._mixer, self._stream):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))
        self._held = True


class Player:
    """Plays a mixer on `device` (auto, a name, or wav), and on a file while there is no card.

    `level` and `text` say how it is; `stuck` turns true when the driver of a lost card hangs, and
    then only a new process gets the card back.
    """

    def __init__(
        self,
        mixer: Mixer,
        device: str,
        block_size: int,
        wav: str | Path | None,
        wav_limit_s: float = 3600.0,
        fade_in_s: float = 2.0,
        card_needed: bool = True,
        quiet: bool = False,
    ):
        self.mixer, self.device, self.block_size = mixer, device, block_size
        self.quiet = quiet  # asleep or muted: a card that comes back does not change that
        self._card_needed = card_needed
        self.stuck = False
        self.losses = 0
        self._wav, self._wav_limit_s = wav, wav_limit_s
        self._fade_in_s = fade_in_s
        self._backoff = Backoff(1.0, RETRY_S)
        self._why = ''
        self._retry_s = 0.0
        self.output: Card | WavSink = self._first()
        atexit.register(self.close, 0.0)  # no thread may render when the interpreter goes
        self._stop, self.watching = threading.Event(), Rounds()
        # One that is put aside while it has Python's lock holds up those who bring triggers.
        self._watcher = carrier_thread('sound watch', self._watch)
        self._watcher.start()

    @property
    def on_card(self) -> bool:
        """Whether a sound card plays."""
        return isinstance(self.output, Card)

    @property
    def heard(self) -> bool:
        """Whether the sound goes to a card or into a file."""
        output = self.output
        return isinstance(output, Card) or output.writes

    @property
    def card_missing(self) -> bool:
        """Whether the card that the scene asks for is not there."""
        return self.device != 'wav' and not self.on_card

    @property
    def level(self) -> str:
        """Return ok, warn or error."""
        if self.stuck:
            return 'error'
        output = self.output
        if isinstance(output, Card):
            return 'ok'
        wanted = self.device == 'wav' and not self._why
        writes = not self._card_needed and (not self._wav or output.writes)
        return 'ok' if (wanted or writes) and not output.full else 'warn'

    @property
    def text(self) -> str:
        """Return what is being done, for people."""
        output = self.output
        if isinstance(output, Card):
            return said('playing', name=output.name)
        full = said('full') if output.full else ''
        if self.device == 'wav' and not self._why:
            return clauses([said('writing', name=output.name), full])
        instead = said('instead', name=output.name)
        if not self._wav:
            instead = said('no_file')
        return clauses([self._why, instead, full])

    def close(self, fade_out_s: float = 0.5) -> None:
        """Fade out and stop."""
        atexit.unregister(self.close)
        self._stop.set()
        self._watcher.join(2 * CLOSE_S)
        fade_out_s = 0.0 if self.stuck else fade_out_s
        self.mixer.fade(0.0, fade_out_s)
        deadline = time.monotonic() + fade_out_s + 0.5
        while self.mixer.state['fade'][0] > 0 and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(0.05)  # what is on its way through the limiter and the driver
        self.output.close()

    def _rise(self) -> None:
        """Begin in silence, and stay there or fade in."""
        self.mixer.fade(0.0 if self.quiet else 1.0, self._fade_in_s, at_once_from=0.0)

    def _first(self) -> 'Card | WavSink':
        self._rise()
        if self.device == 'wav':
            return self._file(self._wav)
        try:
            card = self._open()
        except DeviceMissing as error:
            self._missing(error)
            return self._file(self._wav)
        card.play()
        return card

    def _missing(self, error: DeviceMissing) -> None:
        self._why = str(error)
        self._retry_s = time.monotonic() + self._backoff.failed()

    def _open(self) -> Card:
        return Card(self.mixer, self.device, self.block_size)

    def _file(self, path) -> WavSink:
        try:
            return WavSink(self.mixer, path or None, self.block_size, self._wav_limit_s)
        except ConfigError as error:
            self._why = clauses([self._why, str(error)])
            return WavSink(self.mixer, None, self.block_size, self._wav_limit_s)

    def _watch(self) -> None:
        seen, moved_s = -1, time.monotonic()
        looked_s = moved_s
        while not self._stop.wait(WATCH_S):
            self.watching.done()
            now_s = time.monotonic()
            frame = int(self.mixer.state['frame'][0])
            if frame != seen or now_s - looked_s > 3 * WATCH_S:  # or nobody ran, not even this
                seen, moved_s = frame, now_s
            looked_s = now_s
            if self.stuck:
                continue
            if self.on_card:
                if now_s - moved_s > STILL_S:
                    aside(self._lost)
            elif self.device != 'wav' and now_s > self._retry_s:
                aside(self._look)
        self.watching.rest()

    def _lost(self) -> None:
        card = self.output
        assert isinstance(card, Card)  # a file is never lost
        self.losses += 1
        self._why = said('card_gone', name=card.name)
        if card.give_up():
            self.output = self._file(self._wav)
        if not card.close(LOST_S):
            self._why += ' and its driver hangs'
            self.stuck = True

    def _look(self) -> None:
        """See whether the card is there; if so, let it take over from the file."""
        try:
            rescan()
            card = self._open()
        except DeviceMissing as error:
            self._missing(error)
            return
        if not self.output.close():
            card.close()
            self._missing(DeviceMissing(f'{self.output.name}: the disk does not answer'))
            return
        self._rise()
        card.play()
        self.output = card
        self._backoff.succeeded()
