# SPDX-License-Identifier: Apache-2.0
"""eol bench graph: the whole graph as processes, measured from outside.

Images a second and images lost; latency from an image's stamp (mid-exposure) to what each stage
says, bytes of the LED packet on the pty included, and, with the twin, from the true onset of a slip
to its light and to the first sample of its sound; processor and memory of each node; start-up time.
Both are told apart: of slips that the block felt, which then lit itself, and of those that only the
camera saw. The same for every scene that ships shows what each leaves out.
"""

import argparse
import math
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from support.running import Film, Graph, stand_in, summary

from benchmarks.machine import tell
from eol_ros import scene as scenes
from eol_ros.errors import EolError, UsageError
from eol_ros.ros.stamps import NS, to_ns

HELP = 'Measure image rate, latency, CPU, memory and start-up time of the graph of each scene.'
EXAMPLES = [
    'eol bench graph --seconds 30 --json',
    'eol bench graph --scenes rehearsal --seconds 60',
    'eol bench graph --scenes rehearsal --fast 0 --plot docs/img',
]
ONSET_TOPICS = (
    'truth', 'slips', 'felt_slips', 'block_taps', 'led_commands', 'grain_triggers',
    'felt_triggers',
)  # fmt: skip
ALONE: dict[str, dict[str, Any]] = {  # settings with which knocks count for nothing but onsets
    'leds': {'trigger': 'slips'},
    'motion': {'tap_probability': 1.0},
}
NEAR_S = 0.05  # an onset that far from any true one is another's
FELT_S = 0.01  # from the onset to the moment of the knock, at most: eol bench taps
STAGES = ('blocks', 'slips', 'led_commands', 'grain_triggers')
SCENES = ('rehearsal', 'museum', 'lights', 'instrument', 'playback')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=30.0, help='measuring time of each scene')
    parser.add_argument('--scenes', default=','.join(SCENES), help='scenes, separated by commas')
    parser.add_argument(
        '--fast',
        type=float,
        default=120.0,
        metavar='FPS',
        help='rate of the file-fed camera run; 0 leaves it out',
    )
    parser.add_argument(
        '--rate', type=float, default=1.0, help='speed of the replay in the scene playback'
    )
    parser.add_argument(
        '--plot',
        type=Path,
        metavar='FOLDER',
        help='measure the rehearsal again, by the camera alone; write senses.png there',
    )
    parser.add_argument('--real-time', action='store_true', help='ask for real-time priority')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    if args.plot and 'rehearsal' not in args.scenes.split(','):
        raise UsageError('--plot draws the rehearsal: name it in --scenes')
    late_ms: dict[str, dict[str, list[float]]] = {}
    results: dict[str, Any] = {'cores': os.cpu_count(), 'load': os.getloadavg()[0], 'scenes': {}}
    with tempfile.TemporaryDirectory(prefix='eol-bench-') as place:
        folder = Path(place)
        film = Film(folder)
        bag = None
        for name in args.scenes.split(','):
            print(f'{name}: {args.seconds:g} s', file=sys.stderr, flush=True)
            changed = {'replay': {'rate': args.rate}} if name == 'playback' else None
            scene = stand_in(name, folder, film, bag, changed, args.real_time)
            results['scenes'][name] = measure(scene, folder / f'bags-{name}', args.seconds)
            late_ms[name] = results['scenes'][name].pop('late_ms')
            if name == 'rehearsal':
                bag = folder / f'bags-{name}'  # the newest in it
        if args.fast:
            print(f'file-fed camera at {args.fast:g}/s', file=sys.stderr, flush=True)
            scene = film.scene(args.fast)
            results['file_camera'] = measure(scene, None, min(args.seconds, 30.0))
            results['file_camera'].pop('late_ms')
        if args.plot:
            print('rehearsal, by the camera alone', file=sys.stderr, flush=True)
            scene = stand_in('rehearsal', folder, film, None, ALONE, args.real_time)
            alone = measure(scene, folder / 'bags-alone', args.seconds)
            draw(late_ms['rehearsal'], alone.pop('late_ms'), args.plot)
            results['scenes']['rehearsal, camera alone'] = alone
    tell(results, args.json, table)
    return 0


def draw(both: dict[str, list[float]], camera: dict[str, list[float]], folder: Path) -> None:
    """Write senses.png: how many slips have light, and sound, so long after their true onset.

    both, camera: ms of each, with knocks and images, and with images alone.
    """
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout='constrained', sharey=True)
    for axis, what in zip(axes, ('light', 'first sample'), strict=True):
        for late, label in ((both, 'blocks and camera'), (camera, 'camera alone')):
            if ms := late.get(what):
                axis.ecdf(ms, label=label)
        slips = ' and '.join(str(len(late.get(what, ()))) for late in (both, camera))
        axis.set_title(f'{slips} slips', fontsize='medium')
        axis.set(
            xscale='log', xlim=(0.5, 200), xlabel=f'from the true onset of a slip to its {what}, ms'
        )
        axis.grid(alpha=0.3, which='both')
        axis.xaxis.set_major_formatter('{x:g}')
    axes[0].set_ylabel('share of slips')
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside upper center', ncols=2)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / 'senses.png', dpi=110)
    plt.close(figure)


def measure(scene: Path, bags: Path | None, seconds: float) -> dict[str, Any]:
    """Return the figures of one scene."""
    loaded = scenes.load(scene)
    keep = ONSET_TOPICS if 'twin' in loaded.nodes else ()
    with Graph(scene, bags, keep=keep) as graph:
        all_ok_s = graph.wait_until_ok()
        time.sleep(2.0)  # what starting has heaped up is not measured
        graph.mark()
        time.sleep(seconds)
        figures = graph.figures()
        led_bytes = graph.led_latencies()
        from_onset = onset_latencies(graph, loaded) if keep else {}
        if 'sound' in loaded.nodes:
            values = graph.node('sound')['values']
            figures['grains'] = {name: values[name] for name in ('triggers', 'late')}
        lived_s = graph.status()['running_s'] - all_ok_s
    late_ms = from_onset.pop('late_ms', {})
    stages = {topic: graph.latencies(topic) for topic in STAGES}
    stages['led_bytes'] = led_bytes
    if bags is not None and bags.exists():
        size = sum(file.stat().st_size for file in bags.rglob('*.mcap'))
        figures['bag_gb_per_10_h'] = round(size / lived_s * 36000 / 1e9, 2)
    return {
        'all_ok_s': all_ok_s,
        **figures,
        'latency_ms': {stage: row for stage, row in stages.items() if row},
        'onset_latency_ms': from_onset,
        'late_ms': late_ms,
    }


def onset_latencies(graph: Graph, scene: scenes.Scene) -> dict[str, Any]:
    """Return the latency from the true onset of the twin's slips, or `why` there is none.

    To its light and to the first sample of its sound. Light is that of the block itself, where it
    felt the slip, else the LED packet for the first image that shows it. The onsets are those of
    the twin, simulated again from what `truth` says.
    """
    from benchmarks import sound_rehearsal

    try:
        begun = sound_rehearsal.onsets(graph.watch.messages('truth'), scene.settings('twin'))
    except EolError as error:
        return {'why': str(error)}
    begun = [(onset_ns, block) for onset_ns, block in begun if onset_ns >= graph.begin_ns]
    felt_ms, seen_ms = light_latencies(graph, begun)
    found: dict[str, Any] = {
        'late_ms': {'light': felt_ms + seen_ms},
        'light': summary(felt_ms + seen_ms),
        'light, felt': summary(felt_ms),
        'light, camera': summary(seen_ms),
        'errors': onset_errors(graph, begun),
    }
    if 'sound' in scene.nodes:
        try:
            sound = sound_rehearsal.figures(graph.watch, graph.begin_ns, scene)
            ms = sound['ms']
            found['late_ms']['first sample'] = ms['felt'] + ms['seen']
            found['first_sample'] = summary(ms['felt'] + ms['seen'])
            found['first sample, felt'] = summary(ms['felt'])
            found['first sample, camera'] = summary(ms['seen'])
        except EolError as error:
            found['why'] = str(error)
    return {name: row for name, row in found.items() if row}


def light_latencies(graph: Graph, begun: list[tuple[int, int]]) -> tuple[list[float], list[float]]:
    """Return, ms, how late light came for slips that were felt, and for those only seen."""
    from benchmarks.sound_rehearsal import AFTER_S

    packets = graph.first_light()
    shone = {to_ns(m.header.stamp): to_ns(m.sent) for m in graph.watch.messages('led_commands')}
    taps = [(m.block, to_ns(m.header.stamp)) for m in graph.watch.messages('block_taps')]
    starts = [
        (m.block, to_ns(m.header.stamp)) for m in graph.watch.messages('slips')
        if m.kind == m.START
    ]  # fmt: skip
    felt, seen = [], []
    for onset_ns, block in begun:
        own = [shone[t] for b, t in taps
               if b == block and abs(t - onset_ns) < FELT_S * NS and t in shone]  # fmt: skip
        shown = [t for b, t in starts
                 if b == block and 0 <= t - onset_ns < AFTER_S * NS]  # fmt: skip
        packet = packets.get(min(shown) // 1000 % 2**32) if shown else None
        if own:
            felt.append((min(own) - onset_ns) * 1e-6)
        elif packet is not None:
            seen.append((packet.time_ns - onset_ns) * 1e-6)
    return felt, seen


def onset_errors(graph: Graph, begun: list[tuple[int, int]]) -> dict[str, dict[str, float]]:
    """Return how far, ms RMS, onsets are from the true ones, and of how many slips.

    At the knock, where it is told as a slip; at the START, by the camera alone; at the STOP, of
    those that the block's own knock confirmed.
    """
    errors: dict[str, list[float]] = {'knock': [], 'START': [], 'STOP, felt': []}
    told = [('knock', m) for m in graph.watch.messages('felt_slips') if m.kind == m.PROVISIONAL]
    told += [
        ('START' if m.kind == m.START else 'STOP, felt', m)
        for m in graph.watch.messages('slips')
        if m.kind == m.START or m.tapped
    ]
    for kind, slip in told:
        true = [at for at, block in begun if block == slip.block]
        if true:
            error_ns = min((to_ns(slip.onset) - at for at in true), key=abs)
            if abs(error_ns) < NEAR_S * NS:
                errors[kind].append(error_ns * 1e-6)
    return {
        sense: {'rms': round(math.hypot(*found) / math.sqrt(len(found)), 2), 'count': len(found)}
        for sense, found in errors.items()
        if found
    }


def table(results: dict[str, Any]) -> str:
    """Return the figures for people."""
    lines = []
    runs = dict(results['scenes'])
    if 'file_camera' in results:
        runs['file camera'] = results['file_camera']
    for name, row in runs.items():
        lines.append(
            f'\n{name}: all OK after {row["all_ok_s"]:.1f} s, {row["processes"]} processes, '
            f'{row["pss_mb"]:.0f} MB, {row["cpu_percent"]:.0f} % of one core'
        )
        first = 'with' if row['real_time'] else 'without'
        lines.append(
            f'  images {row["images_per_s"]:.2f}/s, lost {row["lost"]}, {first} real-time priority'
        )
        if 'bag_gb_per_10_h' in row:
            lines.append(f'  bag {row["bag_gb_per_10_h"]:.2f} GB in 10 h')
        if 'grains' in row:
            lines.append('  grains {triggers}, late {late}'.format(**row['grains']))
        for stage, ms in row['latency_ms'].items():
            lines.append(
                f'  stamp -> {stage:15} '
                f'p50 {ms["p50"]:6.1f}  p99 {ms["p99"]:6.1f}  '
                f'max {ms["max"]:6.1f} ms  ({ms["count"]})'
            )
        for stage, ms in row['onset_latency_ms'].items():
            if stage == 'why':
                lines.append(f'  true onset: {ms}')
                continue
            if stage == 'errors':
                lines += [
                    f'  onset at {kind:10} {of["rms"]:6.2f} ms RMS ({of["count"]})'
                    for kind, of in ms.items()
                ]
                continue
            lines.append(
                f'  true onset -> {stage:20} '
                f'p50 {ms["p50"]:6.1f}  p99 {ms["p99"]:6.1f}  '
                f'max {ms["max"]:6.1f} ms  ({ms["count"]})'
            )
        for node, use in row['nodes'].items():
            lines.append(
                f'  {node:10} {use["cpu_percent"]:5.1f} %  {use["pss_mb"]:6.1f} MB  {use["text"]}'
            )
    return '\n'.join(lines).strip()
