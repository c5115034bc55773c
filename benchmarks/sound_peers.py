# SPDX-License-Identifier: Apache-2.0
"""The same scores through scsynth and csound, where they are installed."""

import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import soundfile

from benchmarks.sound_engine import FS, Score
from eol_ros import parent_death


def cpu_of(words: list[str]) -> float:
    """Run a program and return its CPU seconds; raises RuntimeError with what it said."""
    with subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=parent_death.following(),
    ) as child:
        said = child.stdout.read() if child.stdout else ''
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f'{words[0]}: exit code {child.returncode}: {said[-300:]}')
    return usage.ru_utime + usage.ru_stime


# --- scsynth: OSC score and SynthDef files, by their published formats ---------------------------


def _pstring(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


def _synthdef(name: str, parameters: list[str], ugens: list[tuple]) -> bytes:
    """Return a SynthDef file, version 2. A ugen is (class, rate, inputs, outputs[, special]).

    Inputs are numbers, ('p', parameter name), or (ugen, output); parameters are ugen 0.
    """
    constants: list[float] = []

    def place(x) -> tuple[int, int]:
        if isinstance(x, tuple):
            return (0, parameters.index(x[1])) if x[0] == 'p' else (x[0] + 1, x[1])
        if float(x) not in constants:
            constants.append(float(x))
        return -1, constants.index(float(x))

    control = ('Control', 1, [], [1] * len(parameters))
    body = b''
    for ugen in [control, *ugens]:
        kind, rate, inputs, outputs = ugen[:4]
        special = ugen[4] if len(ugen) > 4 else 0
        places = b''.join(struct.pack('>ii', *place(x)) for x in inputs)
        body += _pstring(kind) + struct.pack('>biih', rate, len(inputs), len(outputs), special)
        body += places + bytes(outputs)
    head = _pstring(name) + struct.pack('>i', len(constants))
    head += struct.pack(f'>{len(constants)}f', *constants)
    head += struct.pack('>i', len(parameters)) + struct.pack(
        f'>{len(parameters)}f', *[0.0] * len(parameters)
    )
    head += struct.pack('>i', len(parameters))
    head += b''.join(_pstring(p) + struct.pack('>i', i) for i, p in enumerate(parameters))
    body = head + struct.pack('>i', len(ugens) + 1) + body + struct.pack('>h', 0)
    return b'SCgf' + struct.pack('>ih', 2, 1) + body


def _play_buf() -> bytes:
    """One grain: cubic PlayBuf, raised-cosine envelope, Pan2, sample-accurate OffsetOut."""
    envelope = [1, ('p', 'amp'), 0, ('p', 'dur'), 2, 0, 2, -99, -99, 1, 0.5, 3, 0, 0, 0.5, 3, 0]
    return _synthdef(
        'grain',
        ['buf', 'rate', 'start', 'dur', 'amp', 'pan'],
        [
            ('PlayBuf', 2, [('p', 'buf'), ('p', 'rate'), 1, ('p', 'start'), 0, 0], [2]),
            ('EnvGen', 2, envelope, [2]),
            ('BinaryOpUGen', 2, [(0, 0), (1, 0)], [2], 2),  # times
            ('Pan2', 2, [(2, 0), ('p', 'pan'), 1], [2, 2]),
            ('OffsetOut', 2, [0, (3, 0), (3, 1)], []),
        ],
    )


def _grain_buf(density: float, seconds: float, voices: int) -> bytes:
    """A cloud of grains at random places: GrainBuf, linear reading, its own Hann window."""
    return _synthdef(
        'grain',
        ['buf'],
        [
            ('Impulse', 2, [density, 0], [2]),
            ('TRand', 2, [0, 0.97, (0, 0)], [2]),
            ('TRand', 2, [-1, 1, (0, 0)], [2]),
            (
                'GrainBuf',
                2,
                [(0, 0), seconds, ('p', 'buf'), 1, (1, 0), 2, (2, 0), -1, voices],
                [2, 2],
            ),
            ('Out', 2, [0, (3, 0), (3, 1)], []),
        ],
    )


def _osc(address: str, *arguments) -> bytes:
    def padded(data: bytes) -> bytes:
        return data + b'\0' * (-len(data) % 4)

    tags, data = ',', b''
    for a in arguments:
        if isinstance(a, bytes):
            tags, data = tags + 'b', data + struct.pack('>i', len(a)) + padded(a)
        elif isinstance(a, str):
            tags, data = tags + 's', data + padded(a.encode() + b'\0')
        elif isinstance(a, (int, np.integer)):
            tags, data = tags + 'i', data + struct.pack('>i', a)
        else:
            tags, data = tags + 'f', data + struct.pack('>f', a)
    return padded(address.encode() + b'\0') + padded(tags.encode() + b'\0') + data


def _bundle(time_s: float, *messages: bytes) -> bytes:
    tag = int(time_s * 2**32)
    data = b'#bundle\0' + struct.pack('>Q', tag)
    data += b''.join(struct.pack('>i', len(m)) + m for m in messages)
    return struct.pack('>i', len(data)) + data


def _scsynth(
    folder: Path, definition: bytes, bundles: list[bytes], span_s: float, block: int
) -> float:
    begin = _bundle(
        0.0, _osc('/d_recv', definition), _osc('/b_allocRead', 0, str(folder / 'source.wav'))
    )
    end = _bundle(span_s + 0.4, _osc('/c_set', 0, 0))
    (folder / 'score.osc').write_bytes(begin + b''.join(bundles) + end)
    options = ['-o', '2', '-i', '0', '-z', str(block), '-n', '8192', '-m', '262144', '-w', '256']
    words = ['scsynth', '-N', str(folder / 'score.osc'), '_', str(folder / 'sc.wav'), str(FS)]
    return cpu_of([*words, 'WAV', 'float', *options])


def scsynth_play_buf(folder: Path, s: Score, block: int) -> tuple[float, np.ndarray]:
    """Return CPU seconds and output, one synth a grain; the time of an empty score is taken off."""
    definition = _play_buf()
    bundles = [
        _bundle(
            float(t['time_s']),
            _osc(
                '/s_new', 'grain', -1, 0, 0, 'buf', 0, 'rate', float(t['rate']), 'start', float(f),
                'dur', float(n / t['rate'] / FS), 'amp', float(t['gain']), 'pan', float(t['pan']),
            ),
        )
        for t, f, n in zip(s.triggers, s.first, s.size, strict=True)
    ]  # fmt: skip
    idle = _scsynth(folder, definition, [], s.span_s, block)
    spent = _scsynth(folder, definition, bundles, s.span_s, block) - idle
    return spent, soundfile.read(folder / 'sc.wav')[0]


def scsynth_grain_buf(folder: Path, s: Score, block: int) -> tuple[float, np.ndarray]:
    """Return CPU seconds and output of a cloud of the same density and mean length."""
    mean_s = s.grain_seconds / len(s.first)
    definition = _grain_buf(len(s.first) / s.span_s, mean_s, 2 * s.overlap)
    start = _bundle(0.0, _osc('/s_new', 'grain', -1, 0, 0, 'buf', 0))
    idle = _scsynth(folder, definition, [], s.span_s, block)
    spent = _scsynth(folder, definition, [start], s.span_s, block) - idle
    return spent, soundfile.read(folder / 'sc.wav')[0]


# --- csound ---------------------------------------------------------------------------------------

ORCHESTRA = """
<CsoundSynthesizer>
<CsInstruments>
sr = 48000
ksmps = {block}
nchnls = 2
0dbfs = 1
giSource ftgen 1, 0, 0, 1, "{folder}/source.wav", 0, 0, 1
giWindow ftgen 2, 0, 8193, 20, 2, 1
instr 1
  aPhase line 0, p3, 1
  aWindow tablei aPhase, 2, 1
  aPlace line p5, p3, p5 + p3 * sr * p4
  aSound table3 aPlace, 1
  aGrain = aSound * aWindow * p6
  outs aGrain * p7, aGrain * p8
endin
</CsInstruments>
<CsScore>
{score}
e {end}
</CsScore>
</CsoundSynthesizer>
"""


def csound(folder: Path, s: Score, block: int) -> tuple[float, np.ndarray]:
    """Return CPU seconds and output, one i-statement a grain, cubic table reading."""
    angle = (s.triggers['pan'].astype(float) + 1) * np.pi / 4
    lines = '\n'.join(
        f'i1 {t["time_s"]:.9f} {n / t["rate"] / FS:.9f} {t["rate"]:.7f} {f} {t["gain"]:.7f} '
        f'{a:.7f} {b:.7f}'
        for t, f, n, a, b in zip(
            s.triggers, s.first, s.size, np.cos(angle), np.sin(angle), strict=True
        )
    )
    spent = []
    for name, score in (('idle', ''), ('full', lines)):
        text = ORCHESTRA.format(folder=folder, score=score, end=s.span_s + 0.4, block=block)
        (folder / f'{name}.csd').write_text(text)
        words = ['csound', '-d', '-m0', '-W', '-f', '--sample-accurate', '-o']
        spent.append(cpu_of([*words, str(folder / 'cs.wav'), str(folder / f'{name}.csd')]))
    return spent[1] - spent[0], soundfile.read(folder / 'cs.wav')[0]


# name: (function, whether it plays the very score, whether it reads cubic, installed)
PEERS = {
    'scsynth PlayBuf': (scsynth_play_buf, True, True, lambda: bool(shutil.which('scsynth'))),
    'scsynth GrainBuf': (scsynth_grain_buf, False, False, lambda: bool(shutil.which('scsynth'))),
    'csound table3': (csound, True, True, lambda: bool(shutil.which('csound'))),
}
