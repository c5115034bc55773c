# SPDX-License-Identifier: Apache-2.0
"""What goes over the WebSocket: small little-endian packets for streams, JSON for events.

Every packet begins with one byte of kind, 7 bytes of its own, and the stamp (f8, s since the
epoch); `static/link.js` reads them, `docs/reference/web.md` lists them.
"""

import json
import math
import struct
from typing import Any

import numpy as np

BLOCKS, TRUTH, IMAGE, METER, SOUND, LEDS = range(1, 7)
LARGEST = 2**53  # largest integer up to which all are exact in a browser
_HEAD = struct.Struct('<B7sd')


def head(kind: int, stamp_s: float, own: bytes = b'') -> bytes:
    """Return the 16 bytes that a packet begins with."""
    return _HEAD.pack(kind, own, stamp_s)


def blocks(stamp_s: float, state: int, ambiguous: bool, rows: np.ndarray) -> bytes:
    """Pack the blocks; `rows`, (cells,), has the fields x y yaw u v sigma visibility seen."""
    body = np.empty((len(rows), 8), '<f4')
    for i, name in enumerate(('x', 'y', 'yaw', 'u', 'v', 'sigma', 'visibility', 'seen')):
        body[:, i] = rows[name]
    return head(BLOCKS, stamp_s, bytes([state, ambiguous])) + body.tobytes()


def truth(stamp_s: float, rim: tuple[float, float, float], pose: np.ndarray, moving: Any) -> bytes:
    """Pack the twin's rim pose (x, y, yaw), block poses (3, cells) and who moves (cells,)."""
    body = np.concatenate([np.asarray(rim), np.asarray(pose).ravel()]).astype('<f4')
    return head(TRUTH, stamp_s) + body.tobytes() + bytes(bytearray(moving))


def image(stamp_s: float, jpeg: bytes) -> bytes:
    """Pack one JPEG image."""
    return head(IMAGE, stamp_s) + bytes(jpeg)


def meter(stamp_s: float, low: Any, high: Any, spectrum_db: Any, values: dict[str, Any]) -> bytes:
    """Pack waveform minima and maxima (-1..1) and spectrum (dB) in one byte each, and figures."""
    low, high, bands = (np.asarray(a, float) for a in (low, high, spectrum_db))
    own = struct.pack('<HHH', len(low), len(bands), 0) + b'\0'
    body = [
        np.clip(np.round(np.nan_to_num(low) * 127), -127, 127).astype('i1').tobytes(),
        np.clip(np.round(np.nan_to_num(high) * 127), -127, 127).astype('i1').tobytes(),
        np.clip(np.round(np.nan_to_num(bands, nan=-127)), -127, 127).astype('i1').tobytes(),
    ]
    return head(METER, stamp_s, own) + b''.join(body) + text(values).encode()


def sound(stamp_s: float, rate_hz: int, channels: int, first: int, samples: Any) -> bytes:
    """Pack interleaved float32 samples as 16-bit ones; the stamp is when the first one sounds."""
    wave = np.asarray(samples, np.float32)
    pcm = np.clip(np.nan_to_num(wave) * 32767, -32768, 32767).astype('<i2')
    own = struct.pack('<BHI', channels, 0, rate_hz)
    return head(SOUND, stamp_s, own) + struct.pack('<Q', first) + pcm.tobytes()


def leds(stamp_s: float, white: Any, infrared: bool) -> bytes:
    """Pack the light of each place, 0..255."""
    return head(LEDS, stamp_s, bytes([infrared])) + bytes(bytearray(white))


def frame(payload: bytes | str | dict[str, Any]) -> bytes:
    """Return a payload as one whole unmasked WebSocket frame (RFC 6455, 5.2), ready to be sent."""
    if isinstance(payload, dict):
        payload = text(payload)
    data = payload.encode() if isinstance(payload, str) else payload
    first = 0x81 if isinstance(payload, str) else 0x82
    if len(data) < 126:
        return bytes((first, len(data))) + data
    if len(data) < 65536:
        return struct.pack('!BBH', first, 126, len(data)) + data
    return struct.pack('!BBQ', first, 127, len(data)) + data


def text(event: dict[str, Any]) -> str:
    """Return an event as JSON that every browser reads: no NaN, no infinity."""
    return json.dumps(_finite(event), separators=(',', ':'), ensure_ascii=False)


def loads(data: bytes | str) -> Any:
    """Parse external JSON; the result can always be written as JSON again.

    Raises ValueError, in one line, for text that is not JSON in UTF-8, for numbers that are not
    finite, integers beyond 2^53, lone surrogates and too deep nesting.
    """
    text = data.decode() if isinstance(data, bytes) else data
    try:
        value = json.loads(text, parse_int=_whole, parse_float=_real, parse_constant=_real)
        json.dumps(value, ensure_ascii=False).encode()  # raises for surrogates
    except RecursionError:
        raise ValueError('nested too deeply') from None
    except UnicodeEncodeError:
        raise ValueError('half of a surrogate pair') from None
    return value


def _whole(digits: str) -> int:
    if len(digits) > len(str(-LARGEST)) or abs(int(digits)) > LARGEST:
        raise ValueError('a whole number beyond 2^53')
    return int(digits)


def _real(digits: str) -> float:
    if not math.isfinite(float(digits)):
        raise ValueError('a number that is not finite')
    return float(digits)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return value
