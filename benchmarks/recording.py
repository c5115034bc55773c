# SPDX-License-Identifier: Apache-2.0
"""eol bench recording: what it costs that a power cut takes at most a second of a bag.

The recorder's queue, thread and files, fed at the rate of the camera from memory: images of
infrared noise with 25 lights, which compress as recorded ones do, a message of 25 blocks with each,
and two slips a second. Once with `sync_s` and once without, in turn, so that a busy disk hits both.
Processor time is that of the process, so of the writer; what the kernel does later is not in it.
"""

import argparse
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import tell
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.recording import Recording
from eol_ros.devices.bag.recover import repair
from eol_ros.devices.bag.selection import Item, Slipping
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.settings import RecorderSettings

HELP = 'Measure what it costs to have each second of a recording safe on the disk.'
EXAMPLES = [
    'eol bench recording --seconds 30 --json',
    'eol bench recording --repair 3.7',
    'eol bench recording --folder /data/bags --images all,around_slips,none',
]
IMAGE, BLOCKS = '/eol/camera/image_raw', '/eol/blocks'
TOPICS = [
    BagTopic(IMAGE, 'std_msgs/msg/UInt8MultiArray', 'uint8[] data\n'),
    BagTopic(BLOCKS, 'std_msgs/msg/UInt8MultiArray', 'uint8[] data\n'),
]
KEPT = 64  # different messages of each kind


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=20.0, help='of each of the recordings')
    parser.add_argument('--rounds', type=int, default=2, help='of each kind')
    parser.add_argument('--rate', type=float, default=60.0, metavar='HZ', help='images a second')
    parser.add_argument('--images', default='around_slips,none', help='kinds, parted by commas')
    parser.add_argument('--sync', type=float, default=1.0, metavar='S', help='recorder.sync_s')
    parser.add_argument(
        '--repair', type=float, metavar='GB', help='repair a cut bag of so much instead, at one go'
    )
    parser.add_argument('--folder', metavar='DIR', help='on the disk in question (default: here)')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    pictures = list(_pictures())
    if args.repair:
        place = Path(tempfile.mkdtemp(prefix='eol-bench-', dir=args.folder or '.'))
        try:
            tell({'repair': repaired(place, args.repair, pictures)}, args.json, _repair_table)
        finally:
            shutil.rmtree(place)
        return 0
    rows = []
    for _ in range(args.rounds):
        for images in args.images.split(','):
            for sync_s in (0.0, args.sync):
                place = Path(tempfile.mkdtemp(prefix='eol-bench-', dir=args.folder or '.'))
                try:
                    rows.append(measure(place, images, sync_s, args.seconds, args.rate, pictures))
                finally:
                    shutil.rmtree(place)
                os.sync()  # what one leaves behind is not for the next to wait for
    tell({'rate_hz': args.rate, 'recordings': rows}, args.json, _table)
    return 0


def measure(
    root: Path, images: str, sync_s: float, seconds: float, rate_hz: float, pictures: list[bytes]
) -> dict[str, Any]:
    """Return figures of one recording of `seconds`."""
    settings = RecorderSettings(images=images, sync_s=sync_s, min_free_gb=0.0)
    recording = Recording(root, 'bench', TOPICS, {}, settings, images=IMAGE)
    rng = np.random.default_rng(2)
    blocks = [rng.bytes(2000) for _ in range(KEPT)]
    syncs, queued, sent, late_s = [], 0.0, 0, 0.0
    begun, cpu = time.monotonic(), _cpu_s()
    while (due := begun + sent / rate_hz) < begun + seconds:
        time.sleep(max(0.0, due - time.monotonic()))
        late_s = max(late_s, time.monotonic() - due)
        now = time.time_ns()
        if sent % rate_hz < 1 or sent % rate_hz == rate_hz // 2:
            recording.slip(Slipping(sent, True, now))
            recording.slip(Slipping(sent, False, now))
        recording.take(Item(BLOCKS, blocks[sent % KEPT], now, now, sent + 1))
        if images != 'none':
            recording.take(Item(IMAGE, pictures[sent % KEPT], now, now, sent + 1))
        sent += 1
        queued = max(queued, recording.queued_mb)
        if recording.sync_s:
            syncs.append(recording.sync_s)
            recording.sync_s = 0.0
    used, passed = _cpu_s() - cpu, time.monotonic() - begun
    recording.close()
    return {
        'images': images,
        'sync_s': sync_s,
        'cpu_percent': round(100 * used / passed, 2),
        'sent': sent,
        'lost': recording.lost,
        'queue_mb': queued,
        'late_ms': round(1e3 * late_s, 1),
        'mb_per_s': round(_bytes(root) / passed / 1e6, 2),
        'sync_ms_median': round(1e3 * float(np.median(syncs)), 1) if syncs else None,
        'sync_ms_max': round(1e3 * max(syncs), 1) if syncs else None,
    }


def repaired(root: Path, size_gb: float, pictures: list[bytes]) -> dict[str, Any]:
    """Return what it takes to repair a bag of `size_gb` in place, without the rests."""
    bag = BagWriter(root / 'cut', TOPICS, {}, split_bytes=1 << 40)
    path, count = root / 'cut' / 'cut_0.mcap.part', 0
    while count % 100 or path.stat().st_size < size_gb * 1e9:
        now = count * 16_666_667 + 1
        bag.write(IMAGE, pictures[count % KEPT], now, now, count + 1)
        bag.write(BLOCKS, pictures[count % KEPT][:2000], now, now, count + 1)
        count += 1
    bag.flush()
    bag.abandon()
    before, blocks = path.stat().st_size, path.stat().st_blocks
    begun, cpu, memory = time.monotonic(), _cpu_s(), _peak_mb()
    done = repair(path)
    assert done.file is not None and done.message_count == 2 * count
    after = done.file.stat()
    return {
        'gb': round(before / 1e9, 2),
        's': round(time.monotonic() - begun, 2),
        'cpu_s': round(_cpu_s() - cpu, 2),
        'more_memory_mb': round(_peak_mb() - memory, 1),
        'more_disk_mb': round((after.st_blocks - blocks) * 512 / 1e6, 2),
    }


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def _repair_table(result: dict[str, Any]) -> str:
    row = result['repair']
    return (
        f'{row["gb"]} GB repaired in {row["s"]} s ({row["cpu_s"]} s of a core), '
        f'{row["more_memory_mb"]} MB more memory, {row["more_disk_mb"]} MB more disk'
    )


def _pictures() -> Iterator[bytes]:
    """Yield images of the infrared camera: noise of two bits on black, and 25 lights."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:800, :1280]
    lights = np.zeros((800, 1280))
    for k in range(25):
        lights += 200 * np.exp(
            -((x - 240 - 200 * (k % 5)) ** 2 + (y - 100 - 150 * (k // 5)) ** 2) / 18
        )
    for _ in range(KEPT):
        noise = rng.normal(3.0, 1.6, lights.shape)
        yield bytes(12) + np.clip(lights + noise, 0, 255).astype(np.uint8).tobytes()


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _bytes(root: Path) -> int:
    return sum(p.stat().st_size for p in root.rglob('*') if p.is_file())


def _table(result: dict[str, Any]) -> str:
    lines = [
        'images        sync_s  CPU %   MB/s  lost  queue MB  fdatasync ms (median, max)',
    ]
    for row in result['recordings']:
        sync = f'{row["sync_ms_median"]}, {row["sync_ms_max"]}' if row['sync_ms_max'] else '-'
        lines.append(
            f'{row["images"]:13} {row["sync_s"]:6g} {row["cpu_percent"]:6.2f} '
            f'{row["mb_per_s"]:6.1f} {row["lost"]:5} {row["queue_mb"]:9.1f}  {sync}'
        )
    return '\n'.join(lines)
