# SPDX-License-Identifier: Apache-2.0
"""MIDI ports by python-rtmidi: over ALSA or JACK, CoreMIDI elsewhere.

The library has a thread of its own that fills a queue; a node looks there from a timer.
"""

import contextlib
import ctypes
from typing import Any

from eol_ros.errors import DeviceMissing, pip_install

try:
    import rtmidi
except ImportError:
    raise DeviceMissing(f'MIDI needs python-rtmidi: {pip_install("python-rtmidi")}') from None

CLIENT = 'eol_ros'
VIRTUAL = 'virtual'
_NOTHING = ctypes.CFUNCTYPE(None)(lambda: None)  # ALSA keeps its address: it lives as long as we


def _silence_alsa() -> None:
    """Keep ALSA from printing what it raises as well; the wheel brings a library of its own."""
    alsa = ctypes.CDLL(rtmidi._rtmidi.__file__)
    with contextlib.suppress(AttributeError):  # made without ALSA
        alsa.snd_lib_error_set_handler(_NOTHING)


def _client(api: int, kind: str = 'MidiIn') -> Any:
    _silence_alsa()
    try:
        return getattr(rtmidi, kind)(api, CLIENT)
    except rtmidi.SystemError as error:
        system, instead = 'JACK', 'start its server'
        if api != rtmidi.API_UNIX_JACK:
            system, instead = 'MIDI', 'sudo modprobe snd-seq, or ask JACK: jack:NAME'
        raise DeviceMissing(f'no {system} here ({error}); {instead}') from None


def inputs(jack: bool = False) -> list[str]:
    """Return the names of the inputs that there are."""
    client = _client(rtmidi.API_UNIX_JACK if jack else rtmidi.API_UNSPECIFIED)
    try:
        return list(client.get_ports())
    finally:
        client.delete()


class _Port:
    """The port `wanted` of others.

    Its name or a part of it, `auto` for the first, `virtual` for a port of ours that others connect
    to; `jack:` before it asks JACK. Raises DeviceMissing where there is none.
    """

    KIND = SIDE = ''

    def __init__(self, wanted: str):
        jack = wanted.startswith('jack:')
        name = wanted.removeprefix('jack:')
        self._client = _client(rtmidi.API_UNIX_JACK if jack else rtmidi.API_UNSPECIFIED, self.KIND)
        try:
            self.name = self._open(name)
        except (rtmidi.SystemError, rtmidi.InvalidPortError, DeviceMissing) as error:
            self._client.delete()
            raise DeviceMissing(f'{wanted}: {error}') from None

    def _open(self, name: str) -> str:
        if name == VIRTUAL:
            self._client.open_virtual_port(self.SIDE)
            return f'{CLIENT}:{self.SIDE}'
        ports = self._client.get_ports()
        found = [i for i, port in enumerate(ports) if name == 'auto' or name in port]
        if not found:
            there = f'there are {", ".join(ports)}' if ports else 'there is none'
            raise DeviceMissing(f'no such {self.SIDE}put; {there}')
        self._client.open_port(found[0], self.SIDE)
        return str(ports[found[0]])

    @property
    def there(self) -> bool:
        """Whether the port has not gone."""
        return self.name == f'{CLIENT}:{self.SIDE}' or self.name in self._client.get_ports()

    def close(self) -> None:
        """Give the port back."""
        self._client.close_port()
        self._client.delete()


class MidiIn(_Port):
    """Listens to an input."""

    KIND, SIDE = 'MidiIn', 'in'

    def __init__(self, wanted: str):
        super().__init__(wanted)
        self._client.ignore_types(sysex=True, timing=True, active_sense=True)

    def take(self, most: int = 1024) -> list[list[int]]:
        """Return the bytes of each message that has come."""
        found: list[list[int]] = []
        while len(found) < most and (message := self._client.get_message()):
            found.append(message[0])
        return found


class MidiOut(_Port):
    """Plays an output."""

    KIND, SIDE = 'MidiOut', 'out'

    def send(self, message: tuple[int, ...]) -> None:
        """Send the bytes of one message."""
        self._client.send_message(message)
