# SPDX-License-Identifier: Apache-2.0
"""From the true onset of a slip to the first sample of its sound, in a running scene.

The twin is led by its seed and the stamps of its images alone, so it is simulated a second time
from what `truth` says, which must agree to the last bit, and gives the instants at which blocks
broke loose. A sound begins `latency_s` after the stamp of its image, where it was felt
`tap_latency_s` after that of the knock, or, if its trigger came too late for that, at the latest
with the block of samples after its arrival. Where the output was silent before, the samples
themselves say when it began; that is held against the reckoning. Slips that their block felt are
told apart from those that only the camera saw, and among them those that come so soon after the
block's last sound that its grains may not sound again yet (`refractory_s`): an image's are heard.
"""

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from support.jack import FS, Jack
from support.running import Graph

from eol_ros import scene as scenes
from eol_ros.core.sound.senses import FirstSense
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.ros.stamps import NS, to_ns
from eol_ros.streams.felt import PROVISIONAL

AFTER_S = 0.25  # a slip that has not sounded by then does not sound
LOOK_AHEAD_S = 0.003  # of the mixer: it wants triggers that much earlier
SILENT = 480  # samples of silence, after which an onset is plain to see
FELT_NS = 10_000_000  # from an onset to the moment of its knock, at most: eol bench taps
TRIGGERS = ('grain_triggers', 'felt_triggers')
KNOCK = ('block_taps', 'felt_slips', 'felt_triggers')  # where a knock is told, one after another
TOPICS = ('sound_samples', 'truth', 'block_taps', 'felt_slips', 'grain_triggers', 'felt_triggers')


def measure(seconds: float, device: str, name: str = 'rehearsal') -> dict[str, Any]:
    """Run the shipped scene `name` with `device` wav or jack; return latencies in ms."""
    block = scenes.load(name).settings('sound').block_size
    jack = Jack(f'eol-rehearsal-{os.getpid()}', block) if device == 'jack' else None
    kept = dict(os.environ)
    try:
        with tempfile.TemporaryDirectory(prefix='eol-bench-') as place:
            if jack:
                jack.start()
                os.environ.update(jack.environment)
            folder = Path(place)
            scene = _scene(name, folder, 'system' if jack else 'wav')
            with Graph(scene, folder / 'bags', watched=TOPICS, keep=TOPICS) as graph:
                graph.wait_until_ok()
                time.sleep(2.0)
                graph.mark()
                late_before = graph.node('sound')['values']['late']
                time.sleep(seconds)
                sound, watch = graph.node('sound'), graph.watch
                settings = scenes.load(scene)
                found = figures(watch, graph.begin_ns, settings)
                del found['ms']
                return {
                    'device': device, 'seconds': seconds, 'output_ms': sound['values']['output_ms'],
                    'load_p99': sound['values']['load'], 'underruns': sound['values']['underruns'],
                    'late': sound['values']['late'], 'taken': sound['values']['triggers'],
                    'late_before': late_before,  # of these, while the graph was starting
                    'motion': graph.node('motion')['values'], 'restarts': graph.restarts(),
                    **graph.machine(), **found,
                }  # fmt: skip
    except DeviceMissing as error:
        return {'device': device, 'skipped': str(error)}
    finally:
        os.environ.clear()
        os.environ.update(kept)
        if jack:
            jack.stop()


def figures(watch, begin_ns: int, scene) -> dict[str, Any]:
    """Return what `watch` has seen of the onsets and their sounds after `begin_ns`."""
    begun = onsets(watch.messages('truth'), scene.settings('twin'))
    played, late = _played(watch, scene.settings('sound'))
    taps = [(m.block, to_ns(m.header.stamp)) for m in watch.messages('block_taps')]
    refractory_ns = round(scene.settings('grains').refractory_s * NS)
    stamps = [
        (message.block, stamp) for topic in TRIGGERS
        for message, (stamp, _) in zip(watch.messages(topic), watch.seen[topic], strict=False)
    ]  # fmt: skip
    sounded: dict[str, list[float]] = {'felt': [], 'seen': []}
    by_knock = []
    waits, slips = [], 0
    for time_ns, block in begun:
        if time_ns < begin_ns or time_ns > begun[-1][0] - NS:
            continue
        slips += 1
        own = any(b == block and abs(t - time_ns) < FELT_NS for b, t in taps)
        after = [
            (at - time_ns, stamp - time_ns) for at, stamp, b, felt in played
            if b == block and -FELT_NS * felt <= stamp - time_ns < AFTER_S * NS
        ]  # fmt: skip
        if after:
            sound_ns, stamp_ns = min(after)
            # frame 0 of an envelope is zero
            sounded['felt' if own else 'seen'].append((sound_ns + NS // FS) * 1e-6)
            waits.append(stamp_ns * 1e-6)
            barred = stamp_ns > FELT_NS and any(
                b == block and 0 < time_ns - stamp <= refractory_ns for b, stamp in stamps
            )
            if own and not barred:
                by_knock.append(sounded['felt'][-1])
    both = sounded['felt'] + sounded['seen']
    if not both:
        raise EolError('no slip has sounded; measure for longer')
    seen = _seen(watch, [at for at, *_ in played if at > begin_ns])
    delays = {
        topic: [
            (at - stamp) * 1e-6
            for message, (stamp, at) in zip(watch.messages(topic), watch.seen[topic], strict=False)
            if stamp > begin_ns and getattr(message, 'kind', PROVISIONAL) == PROVISIONAL
        ]
        for topic in ('grain_triggers', *KNOCK)
    }  # fmt: skip
    return {
        'slips': slips, 'sounded': len(both) / slips, 'triggers': len(delays['grain_triggers']),
        'late_at_most': late, 'latency_ms': _summary(both), 'onset_to_stamp_ms': _summary(waits),
        **{f'{sense}_ms': _summary(ms) for sense, ms in sounded.items() if ms},
        'felt_not_barred_ms': _summary(by_knock) if by_knock else None,
        'stamp_to_trigger_ms': _summary(delays['grain_triggers']), 'ms': sounded,
        'knock_to_ms': {topic: _summary(delays[topic]) for topic in KNOCK if delays[topic]},
        'seen_alone': len(seen), 'seen_after_reckoning_ms': _summary(seen) if seen else None,
    }  # fmt: skip


def _played(watch, sound) -> tuple[list[tuple[int, int, int, bool]], int]:
    """Return frame 0 in ns at the latest, stamp, block and whether it was felt of each grain that
    sounds, and how many may have been late.
    """
    came = []
    for topic, latency_s in (
        ('grain_triggers', sound.latency_s),
        ('felt_triggers', sound.tap_latency_s),
    ):
        came += [
            (arrival, stamp, stamp + round(latency_s * NS), message, topic == 'felt_triggers')
            for message, (stamp, arrival) in zip(
                watch.messages(topic), watch.seen[topic],
                strict=False,  # one may have come meanwhile
            )
        ]  # fmt: skip
    played, late, first = [], 0, FirstSense()
    for arrival, stamp, due, message, felt in sorted(came, key=lambda one: one[0]):
        if first.plays(stamp / NS, message.block, message.grain, felt):
            ready = arrival + round((LOOK_AHEAD_S + sound.block_size / FS) * NS)
            late += ready > due
            played.append((max(due, ready), stamp, message.block, felt))
    return played, late


class Twin:
    """The table of a rehearsal, simulated here; tells when blocks broke loose."""

    def __init__(self, seed: int):
        from eol_ros.core.physics.twin.play import Play

        self.play = Play(seed)
        self.table = self.play.table
        self.step(1e-4)  # the twin's own first image, which nobody sees

    def step(self, span_s: float) -> list[tuple[float, int]]:
        """Move on by `span_s`; return (seconds, block) of every slip that began."""
        log = self.table._ledger.log
        log.start[:] = -1
        begin_s = self.play.advance(span_s)
        return [
            (begin_s + float(log.t[i]), int(log.block[i])) for i in np.flatnonzero(log.start == 1)
        ]


def onsets(truths: list, settings) -> list[tuple[int, int]]:
    """Return (time in ns, block) of each slip's beginning, in order; raise if the twins differ."""
    from support.exposures import moved_to

    from eol_ros.nodes.twin import LONGEST_STEP_S

    twin, found, before_ns = Twin(settings.seed), [], 0
    stamps = [to_ns(truth.header.stamp) for truth in truths]
    for k, (truth, stamp_ns) in enumerate(zip(truths, stamps, strict=True), 1):
        moves = moved_to(stamps[0], before_ns, stamp_ns, settings.fps) if k > 1 else [stamp_ns]
        for move_ns in moves:
            span_s = (move_ns - before_ns) / NS if before_ns else 1 / settings.fps
            begun = twin.step(min(max(span_s, 1e-4), LONGEST_STEP_S))
            end_s, before_ns = twin.play.time_s, move_ns
            found += [(move_ns - round((end_s - at_s) * NS), block) for at_s, block in begun]
        if not (np.array_equal(twin.table.x, truth.x) and np.array_equal(twin.table.y, truth.y)):
            raise EolError(
                f'image {k}: the twin is not where it should be; a message was missed, so '
                'measure again with less beside it'
            )
    return sorted(found)


def _seen(watch, due: list[int]) -> list[float]:
    """Return, ms, by how much later than reckoned the sound came where it was silent before."""
    found = []
    due = np.sort(due)
    silent = 0
    end = -1
    for message in watch.messages('sound_samples'):
        frames = np.asarray(message.samples).reshape(-1, message.channels)
        if message.first != end:
            silent = 0
        end = message.first + len(frames)
        loud = np.flatnonzero(frames.any(axis=1))
        if not len(loud):
            silent += len(frames)
            continue
        if silent + loud[0] >= SILENT:
            at = to_ns(message.header.stamp) + round(int(loud[0]) * NS / FS)
            near = due[np.searchsorted(due, at - NS // 50) :]
            if len(near) and abs(int(near[0]) - at) < NS // 50:
                found.append((at - int(near[0])) * 1e-6)
        silent = len(frames) - 1 - int(loud[-1])
    return found


def _scene(name: str, folder: Path, device: str) -> Path:
    """Write the shipped scene, on the twin in place of a camera and a board."""
    values = scenes.plain(scenes.load(name))
    nodes = values['nodes']
    if nodes.pop('camera', None) is not None:
        nodes['twin'], nodes['leds']['port'] = {}, 'twin'
    nodes['sound'].update(device=device, wav=str(folder / 'sound.wav'))
    if 'panel' in nodes:
        nodes['panel']['port'] = 0
    path = folder / f'{name}.yaml'
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path


def _summary(ms: list[float]) -> dict[str, float]:
    p50, p90, p99 = np.percentile(ms, [50, 90, 99])
    return {
        'p50': round(float(p50), 2), 'p90': round(float(p90), 2), 'p99': round(float(p99), 2),
        'least': round(min(ms), 2), 'most': round(max(ms), 2), 'count': len(ms),
    }  # fmt: skip
