# SPDX-License-Identifier: Apache-2.0
"""The sound cards of this machine, as PortAudio has them."""

import os
from typing import Any

from eol_ros.errors import DeviceMissing, pip_install
from eol_ros.said import said

INSTALL = 'sudo apt install libportaudio2'


def portaudio() -> Any:
    """Return the module sounddevice; raises DeviceMissing where it, or PortAudio, is missing."""
    os.environ.setdefault('JACK_NO_START_SERVER', '1')  # who wants JACK has started it
    try:
        import sounddevice
    except OSError as error:
        raise DeviceMissing(f'PortAudio is not installed ({error}); {INSTALL}') from None
    except ImportError:
        raise DeviceMissing(f'sounddevice is not installed: {pip_install("sounddevice")}') from None
    return sounddevice


def reason(error: Exception) -> str:
    """Return what PortAudio says of an error."""
    return str(error.args[0]).removeprefix('Error opening OutputStream: ')


def cards() -> list[dict[str, Any]]:
    """Return the outputs that there are: name, host API, channels, default sample rate."""
    sd = portaudio()
    apis = sd.query_hostapis()
    return [
        {
            'index': d['index'],
            'name': d['name'],
            'api': apis[d['hostapi']]['name'],
            'channels': d['max_output_channels'],
            'sample_rate': d['default_samplerate'],
        }
        for d in sd.query_devices()
        if d['max_output_channels'] > 0
    ]


def rescan() -> None:
    """Look for sound cards again: PortAudio does so only when it starts. No stream may be open."""
    sd = portaudio()
    sd._terminate()
    try:
        sd._initialize()
    except sd.PortAudioError as error:
        raise DeviceMissing(f'PortAudio does not start ({reason(error)})') from None


def find(device: str, channels: int = 1) -> int:
    """Return the number of the output `device`: its name, a part of it, or auto for the default.

    Raises DeviceMissing with the names that there are.
    """
    outputs = cards()
    if not outputs:
        raise DeviceMissing(said('no_card'))
    if device == 'auto':
        default = portaudio().default.device[1]
        numbers = [c['index'] for c in outputs]
        default = default if default in numbers else numbers[0]
        found = [c for c in outputs if c['index'] == default]
    else:
        found = [c for c in outputs if c['name'] == device]
        found = found or [c for c in outputs if device.lower() in c['name'].lower()]
    if not found:
        names = ', '.join(c['name'] for c in outputs)
        raise DeviceMissing(said('card_not_there', name=device, names=names))
    enough = [c for c in found if c['channels'] >= channels]
    if not enough:
        raise DeviceMissing(
            said('card_channels', name=found[0]['name'], count=found[0]['channels'], asked=channels)
        )
    return enough[0]['index']
