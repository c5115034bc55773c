# SPDX-License-Identifier: Apache-2.0
"""MIDI outputs by python-rtmidi: over ALSA or JACK, CoreMIDI elsewhere."""

import contextlib
import ctypes

from eol_ros.errors import DeviceMissing, pip_install

try:
    import rtmidi
except ImportError:
    raise DeviceMissing(f'MIDI needs python-rtmidi: {pip_install("python-rtmidi")}') from None

CLIENT, SIDE = 'eol_ros', 'out'
OURS = f'{CLIENT}:{SIDE}'
VIRTUAL = 'virtual'
_NOTHING = ctypes.CFUNCTYPE(None)(lambda: None)  # ALSA keeps its address: it lives as long as we


def _silence_alsa() -> None:
    """Keep ALSA from printing what it raises as well; the wheel brings a library of its own."""
    alsa = ctypes.CDLL(rtmidi._rtmidi.__file__)
    with contextlib.suppress(AttributeError):  # made without ALSA
        alsa.snd_lib_error_set_handler(_NOTHING)


class MidiOut:
    """The output `wanted` of others.

    Its name or a part of it, `auto` for the first, `virtual` for a port of ours that others connect
    to; `jack:` before it asks JACK. Raises DeviceMissing where there is none.
    """

    def __init__(self, wanted: str):
        jack = wanted.startswith('jack:')
        _silence_alsa()
        try:
            api = rtmidi.API_UNIX_JACK if jack else rtmidi.API_UNSPECIFIED
            self._client = rtmidi.MidiOut(api, CLIENT)
        except rtmidi.SystemError as error:
            system, instead = 'MIDI', 'sudo modprobe snd-seq, or ask JACK: jack:NAME'
            if jack:
                system, instead = 'JACK', 'start its server'
            raise DeviceMissing(f'no {system} here ({error}); {instead}') from None
        try:
            self.name = self._open(wanted.removeprefix('jack:'))
        except (rtmidi.SystemError, rtmidi.InvalidPortError, DeviceMissing) as error:
            self._client.delete()
            raise DeviceMissing(f'{wanted}: {error}') from None

    def _open(self, name: str) -> str:
        if name == VIRTUAL:
            self._client.open_virtual_port(SIDE)
            return OURS
        ports = self._client.get_ports()
        found = [i for i, port in enumerate(ports) if name == 'auto' or name in port]
        if not found:
            there = f'there are {", ".join(ports)}' if ports else 'there is none'
            raise DeviceMissing(f'no such output; {there}')
        self._client.open_port(found[0], SIDE)
        return str(ports[found[0]])

    @property
    def there(self) -> bool:
        """Whether the port has not gone."""
        return self.name == OURS or self.name in self._client.get_ports()

    def send(self, message: tuple[int, ...]) -> None:
        """Send the bytes of one message."""
        self._client.send_message(message)

    def close(self) -> None:
        """Give the port back."""
        self._client.close_port()
        self._client.delete()
