# SPDX-License-Identifier: Apache-2.0
"""A graph whose sound card is pulled out and put in again: how soon that is noticed and mended.

The card is JACK's dummy driver, and pulled out it takes its clients' driver with it: the hardest
case there is, for only a new process gets such a card back.
"""

import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from eol_ros.errors import DeviceMissing, EolError
from support.jack import Jack
from support.running import Graph

PLAYING = 'playing on'
PATIENCE_S = 60.0


def measure(away_s: float) -> dict[str, Any]:
    """Return seconds from the loss to its notice, and from the card's return to sound on it."""
    jack = Jack(f'eol-loss-{os.getpid()}')
    kept = dict(os.environ)
    try:
        with tempfile.TemporaryDirectory(prefix='eol-bench-') as folder:
            jack.start()
            os.environ.update(jack.environment)
            with Graph(_scene(Path(folder)), watched=()) as graph:
                _wait(graph, lambda row: PLAYING in row['text'] and row['level'] == 0)
                before = graph.node('sound')['pid']
                jack.stop()
                lost_s = _wait(graph, lambda row: PLAYING not in row['text'])
                time.sleep(max(0.0, away_s - lost_s))
                jack.start()
                back_s = _wait(graph, lambda row: PLAYING in row['text'])
                time.sleep(2.0)
                row, status = graph.node('sound'), graph.status()
    except DeviceMissing as error:
        return {'away_s': away_s, 'skipped': str(error)}
    finally:
        os.environ.clear()
        os.environ.update(kept)
        jack.stop()
    return {
        'away_s': away_s, 'lost_s': round(lost_s, 2), 'back_s': round(back_s, 2),
        'new_process': row['pid'] != before, 'restarts': status['restarts'], 'says': row['text'],
    }  # fmt: skip


def _scene(folder: Path) -> Path:
    path = folder / 'loss.yaml'
    sound = {'device': 'system', 'wav': str(folder / 'x.wav')}
    nodes = {'twin': {'hands': 'visitors'}, 'tracker': {}, 'grains': {}, 'sound': sound}
    path.write_text(json.dumps({'scene': 'loss', 'nodes': nodes}))
    return path


def _wait(graph: Graph, condition) -> float:
    """Wait until the sound node's row fulfils the condition; return the seconds it took."""
    began_s = time.monotonic()
    while time.monotonic() - began_s < PATIENCE_S:
        try:
            if condition(graph.node('sound')):
                return time.monotonic() - began_s
        except (EolError, StopIteration):
            pass
        time.sleep(0.02)
    raise EolError(f'sound: it did not come about: {graph.log.read_text().strip()}')
