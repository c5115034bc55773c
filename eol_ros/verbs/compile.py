# SPDX-License-Identifier: Apache-2.0
"""eol compile: compile what a first run would have to wait for."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence

from eol_ros import compiled, parent_death
from eol_ros.bringup.processor import threads
from eol_ros.errors import EolError, UsageError, nearest
from eol_ros.ros.health_pipe import HealthPipe
from eol_ros.verbs.progress import track

HELP = 'Compile the kernels of twin, tracker and sound into the cache; cut the ice recording.'
EXAMPLES = ['eol compile', 'eol compile --parts sound,simulate', 'eol compile --force']
WAITING = 'another process compiles into the same cache; waiting until it is done'
LOOK_S = 0.5
STEP = 5  # percent between lines of progress where there is no terminal


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        '--force', action='store_true', help='discard the cache and compile everything again'
    )
    parser.add_argument(
        '--parts',
        metavar='PARTS',
        default=','.join(compiled.AT_FIRST),
        help=f'comma-separated names, of {", ".join(compiled.PARTS)} '
        f'(default: {",".join(compiled.AT_FIRST)})',
    )
    parser.add_argument(
        '--here',
        action='store_true',
        help='compile in this process, without a bar',
    )


def run(args):
    """Compile what is not in the cache as it should be; two parts at a time."""
    parts = args.parts.split(',')
    for part in parts:
        if part not in compiled.PARTS:
            raise UsageError(f'--parts {part}: no such part. {nearest(part, compiled.PARTS)}')
    if args.here:
        return _here(parts)
    if args.force:
        with compiled.alone(_say_waiting):
            compiled.forget(everything=True)
    ensure(parts)
    return 0


def ensure(parts: Sequence[str]) -> None:
    """Compile what of `parts` is not in the cache as it should be, and show how far that is."""
    if not compiled.cold(parts):
        return
    with compiled.alone(_say_waiting):
        if cold := compiled.cold(parts):  # still, behind whom it waited for
            compiled.forget()
            _compile(cold)


def _say_waiting() -> None:
    print(WAITING, file=sys.stderr, flush=True)


def _compile(cold: Sequence[str]) -> None:
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and the processes end with this one
    print('compiling, once for this version', file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        for _ in track(_percents(cold), 'compiling', total=100):
            pass
        return
    for percent in _percents(cold):
        if percent % STEP == 0:
            print(f'compiling, {percent} %', file=sys.stderr, flush=True)


def _percents(parts: Sequence[str]) -> Iterator[int]:
    """Compile `parts` and yield how far that is: every whole percent."""
    waiting = list(parts)
    running: dict[str, subprocess.Popen] = {}
    done = dict.fromkeys(parts, 0.0)
    total = sum(SECONDS[part] for part in parts)
    shown = 0
    health = HealthPipe.inherited()
    try:
        told = sys.stderr.fileno()  # descriptor 2 is closed to libraries in some verbs
    except (OSError, AttributeError):
        told = None
    try:
        while waiting or running:
            while waiting and len(running) < max(len(os.sched_getaffinity(0)), 1):
                part = waiting.pop(0)
                command = [sys.executable, '-m', 'eol_ros', 'compile', '--here', '--parts', part]
                running[part] = subprocess.Popen(
                    command, stderr=told, preexec_fn=parent_death.following()
                )
            time.sleep(LOOK_S)
            for part, child in list(running.items()):
                done[part] = SECONDS[part] * _share(_used_s(child.pid) / SECONDS[part])
                if child.poll() is None:
                    continue
                del running[part]
                if child.returncode:
                    raise EolError(f'compiling {part} has failed (exit code {child.returncode})')
                done[part] = SECONDS[part]
            percent = int(100 * sum(done.values()) / total)
            if health:
                health.send({'percent': percent})
            while shown < percent:
                shown += 1
                yield shown
    finally:
        for child in running.values():
            child.kill()


def _used_s(pid: int) -> float:
    """Return the processor time of a child that has not been waited for, s."""
    return 1e-9 * sum(thread.ran_ns for thread in threads(pid).values())


def _share(used: float) -> float:
    """Return how much of a part to show as done after `used` of its expected processor time.

    From 0.8 on it slows down, so that it moves for as long as a slower processor needs.
    """
    return used if used < 0.8 else 1.0 - 0.2 * math.exp((0.8 - used) / 0.2)


def _here(parts: Sequence[str]) -> int:
    """Compile in this process."""
    for part in parts:
        WORK[part]()
        compiled.stamp(part)
    return 0


def _twin():
    from eol_ros.core.physics.twin.accelerometer import Accelerometers
    from eol_ros.core.physics.twin.live import SOFT, LiveTable
    from eol_ros.core.physics.twin.play import Play
    from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
    from eol_ros.settings import TwinSettings

    Accelerometers(TwinSettings())
    LiveTable(0, coupling=SOFT)  # blocks that do not rotate have a kernel of their own
    play = Play(0)
    play.advance(1 / 60)  # a hand takes the rim
    table = play.table
    Renderer(RenderOptions(), None, 0).render(table.x, table.y, table.yaw, 0)


def _tracker():
    import numpy as np

    from eol_ros.core.table import Table
    from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
    from eol_ros.core.vision.tracker import Tracker
    from eol_ros.settings import TrackerSettings

    tracker = Tracker(TrackerSettings(), None)
    tracker.warm_up()
    renderer, (x, y) = Renderer(RenderOptions(), None, 0), Table().rest.T
    for k in range(30):  # it calibrates itself
        tracker.update(k / 60, renderer.render(x, y, np.zeros(len(x)), k))


def _sound():
    import numpy as np

    from eol_ros.core.sound.clock import set_clock
    from eol_ros.core.sound.meter import Meter
    from eol_ros.core.sound.voicing import Voicing, new_mixer
    from eol_ros.devices.audio.callback import serve
    from eol_ros.settings import SoundSettings

    Voicing(SoundSettings())
    mixer = new_mixer(SoundSettings())
    mixer.render(256)
    set_clock(mixer.state, 0.0)
    serve(mixer.address, np.zeros((0, mixer.channels), np.float32), 0)
    Meter(mixer).read()


def _ice():
    from eol_ros.devices.corpus.loader import CorpusLoader, corpus_spec
    from eol_ros.settings import GrainsSettings

    loader = CorpusLoader()
    spec = corpus_spec(GrainsSettings())
    if loader.at_once(spec) is None:
        loader.ask(spec)
        while loader.take() is None:
            time.sleep(0.1)
    loader.close()


def _simulate():
    from eol_ros.core.physics import builders
    from eol_ros.core.physics.scene import from_mapping
    from eol_ros.lab import presets
    from eol_ros.lab.choose import simulate

    spinning = {'side': 0.084, 'spin0': [1.0]}
    rotating = builders.single({'kind': 'none'}, 0.1, dim1=False, rotation=spinning)
    one = presets.scene('S1') | {'T': 0.1}
    for scene, path in ((one, 'exact'), (one, 'event'), (rotating, 'event')):
        for ledger in (True, False):
            simulate(from_mapping(scene), path=path, ledger=ledger)


WORK = {
    'tracker': _tracker, 'twin': _twin, 'sound': _sound, 'ice': _ice, 'simulate': _simulate
}  # fmt: skip
# To tell how far it is: processor time of each, cold, s, where it was measured.
SECONDS = {'tracker': 48, 'twin': 38, 'sound': 32, 'ice': 3, 'simulate': 42}
