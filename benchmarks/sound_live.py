# SPDX-License-Identifier: Apache-2.0
"""The mixer on a real PortAudio stream over JACK's dummy driver, with Python's lock held all along.

Run as a process of its own for each case: `python -m benchmarks.sound_live '{"block": 256}'`.
"""

import json
import os
import subprocess
import sys
import threading
import time

import numpy as np
from support.jack import FS, Jack

from benchmarks.stalls import Stalls, overlap
from eol_ros import parent_death
from eol_ros.errors import DeviceMissing, EolError

NOTICE_S = 0.05  # from an underrun to its count: JACK tells of it in a thread of its own
CASES = (
    {'block': 256, 'busy': True, 'overlap': 400},
    {'block': 128, 'busy': True, 'overlap': 400},
    {'block': 256, 'busy': False, 'overlap': 0},
    {'block': 128, 'busy': False, 'overlap': 0},
)


def measure(case: dict, seconds: float) -> dict:
    """Run one case in its own process against a card of its own; `skipped` where there is none.

    `unexplained_underruns` came while the machine did not stand still; all of them where we may not
    watch for that.
    """
    jack = Jack(f'eol-bench-{os.getpid()}-{case["block"]}', case['block'])
    stalls = Stalls()
    try:
        jack.start()
        stalls.start()
        child = subprocess.run(
            [sys.executable, '-m', __name__, json.dumps({**case, 'seconds': seconds})],
            env={**os.environ, **jack.environment},
            capture_output=True, text=True, timeout=seconds + 60,
            preexec_fn=parent_death.following(),
        )  # fmt: skip
        lines = [line for line in child.stdout.splitlines() if line.startswith('{')]
        if not lines or child.returncode:
            said = child.stderr.strip()[-300:]
            raise EolError(f'the process that plays ended with {child.returncode}: {said}')
        figures = json.loads(lines[-1])
        stood = stalls.stop() or []
        moments = figures.pop('underrun_moments', [])
        return {
            **figures, 'machine_stalls': len(stood),
            'machine_stall_worst_ms': 1e3 * max((end - begin for begin, end in stood), default=0.0),
            'unexplained_underruns': len(moments) - overlap(moments, stood),
        }  # fmt: skip
    except DeviceMissing as error:
        return {'skipped': str(error)}
    finally:
        stalls.stop()
        jack.stop()


def _run(block: int, busy: bool, overlap: int, seconds: float) -> dict:
    from benchmarks.sound_engine import bank_of, make_score, source
    from eol_ros.core.sound.bank import voice_rows
    from eol_ros.core.sound.mixer import Mixer
    from eol_ros.devices.audio.soundcard import Card

    epoch = int(time.time())
    mixer = Mixer(FS, max_voices=1000, epoch_s=epoch)
    s = make_score(max(overlap, 1), 2.0, False)
    bank = bank_of(source(), s)
    rows = voice_rows(s.triggers, bank, 2) if overlap else voice_rows(s.triggers[:0], bank, 2)
    card = Card(mixer, 'system', block)
    card.play()
    stop = threading.Event()

    def hold_the_lock():
        x = 0
        while not stop.is_set():
            x += 1

    worker = threading.Thread(target=hold_the_lock, daemon=True)
    time.sleep(1.0)  # the card has begun
    state = mixer.state
    if busy:
        worker.start()
    underruns, frame, begun = int(state['underruns'][0]), int(state['frame'][0]), time.monotonic()
    marks, next_s = [], time.time() - epoch + 0.5
    voices, counted, looked_s, moments = 0, underruns, begun, []
    while time.monotonic() - begun < seconds:
        if len(rows) and time.time() - epoch > next_s - 0.5:  # the next round, half a second ahead
            again = rows.copy()
            again['time_s'] += next_s
            for part in np.array_split(again, 4):
                mixer.push(part)
                time.sleep(0.02)
            next_s += s.span_s
        time.sleep(0.05)
        voices = max(voices, int(state['voices'][0]))
        now_s, now = time.monotonic(), int(state['underruns'][0])
        moments += [(looked_s - NOTICE_S, now_s)] * (now - counted)
        looked_s, counted = now_s, now
        before = int(state['callbacks'][0])
        mark = (float(state['clock_frame'][0]), float(state['clock_time'][0]))
        if before == int(state['callbacks'][0]):
            marks.append(mark)
    frames, taken = int(state['frame'][0]) - frame, time.monotonic() - begun
    stop.set()
    card.close()
    at = np.array(marks[len(marks) // 4 :])
    line = np.polyfit(at[:, 0] - at[0, 0], at[:, 1] - at[0, 1], 1)
    off = (at[:, 1] - at[0, 1] - np.polyval(line, at[:, 0] - at[0, 0])) * FS
    used = min(int(state['callbacks'][0]), mixer.memory.loads.size)
    return {
        'block': block, 'busy_thread': busy, 'overlap': overlap,
        'seconds': taken, 'underruns': counted - underruns, 'underrun_moments': moments,
        'frames_per_second': frames / taken, 'voices_most': voices,
        'dropped': int(state['dropped'][0]), 'late': int(state['late'][0]),
        'load_p99': float(np.percentile(mixer.memory.loads[:used], 99)),
        'load_worst': float(mixer.memory.loads[:used].max()),
        'stamp_to_sample_sd': float(off.std()), 'stamp_to_sample_worst': float(np.abs(off).max()),
    }  # fmt: skip


if __name__ == '__main__':
    try:
        print(json.dumps(_run(**json.loads(sys.argv[1]))), flush=True)
    except DeviceMissing as missing:
        print(json.dumps({'skipped': str(missing)}), flush=True)
    os._exit(0)  # the stream dies with the process; nothing waits for the driver
