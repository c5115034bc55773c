# SPDX-License-Identifier: Apache-2.0
"""eol camera: turn the lens, set the exposure, see how late images come. No graph may run on it."""

import argparse
import dataclasses
import json
import math
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from eol_ros.cli import within
from eol_ros.core.verdict import Verdict, judged, worst
from eol_ros.errors import ConfigError, DeviceMissing, UsageError

HELP = (
    'Print focus, exposure and delay of a V4L2 camera, or of a video. Stop the camera node first. '
    'The panel of a running scene shows the picture.'
)
EXAMPLES = [
    'eol camera focus',
    'eol camera focus --scene museum',
    'eol camera expose --device auto --exposure-us 2000 --gain 6',
    'eol camera latency --seconds 10 --json',
]
SHOWS = ('focus', 'expose', 'latency')
EVERY_S = 0.25  # from number to number
OPEN_S = 20.0  # in which a camera must give its first image
BAR = 30
FAILED = ('lost', 'wrong')
# sound.latency_s (25 ms) less the mixer's 8.3 is for camera, tracker, two nodes: half of it, all
LATE_MS = 8.3, 16.7
LOST = 0.01, 0.1  # share of images: `eol bench vision --hard dropped` loses one in ten


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'show', choices=SHOWS,
        help='focus: blur of the edges, while you turn the lens; expose: brightness and saturated '
            'share; latency: from exposure to arrival, jitter and losses',
    )  # fmt: skip
    parser.add_argument('--scene', help='scene with the settings of the camera')
    parser.add_argument('--device', help='value of camera.device in a scene')
    parser.add_argument('--size', metavar='WxH', help='image size (default: 1280x800)')
    parser.add_argument('--fps', type=within(0, 240), help='images a second')
    parser.add_argument('--exposure-us', type=within(50, 16000, int), help='manual exposure')
    parser.add_argument('--gain', type=within(-1000, 1e6), help="gain, in the camera's own unit")
    parser.add_argument(
        '--seconds', type=within(0.01, 86400), help='stop after SECONDS (latency: 10; else: Ctrl-C)'
    )
    parser.add_argument('--json', action='store_true', help='print one JSON object a line')


def run(args: argparse.Namespace) -> int:
    """Open, measure, print until told to stop."""
    source = _source(args)
    if args.show == 'latency' and not source.live:
        raise UsageError(f'latency: {source.name} is a video; name a camera')
    from eol_ros.devices.camera.camera import Camera

    meter: Any = {'focus': Focus, 'expose': Expose, 'latency': Latency}[args.show](source)
    arrivals, found = Arrivals(), None
    camera = Camera(source, arrivals.take, loop=False)
    end = '\r' if sys.stdout.isatty() and not args.json else '\n'
    try:
        camera.start()
        _wait(camera, arrivals)
        print(camera.state.text, file=sys.stderr)
        endless = args.seconds is None and args.show != 'latency'
        quiet = args.show == 'latency' and args.json
        seconds = math.inf if endless else args.seconds or 10.0
        for found in _measured(camera, arrivals, meter, seconds):
            line = meter.line(found)
            if not quiet:
                print(json.dumps(found) if args.json else f'{line:100}', end=end, flush=True)
        if args.show == 'latency':
            found = meter.summary(camera)
            print(json.dumps(found) if args.json else meter.text(found))
    finally:  # Ctrl-C ends it as well
        if found and 'verdict' in found and not args.json:
            print(f'\n{meter.verdict}' if end == '\r' else meter.verdict)
        camera.close()
    return 0


def _measured(
    camera: Any, arrivals: 'Arrivals', meter: Any, seconds: float
) -> Iterator[dict[str, Any]]:
    """Yield the figures of the received images, every EVERY_S for `seconds`.

    Ends where a video ends; DeviceMissing where the camera is lost. Says what is wrong with images.
    """
    until_s, told = time.monotonic() + seconds, ''
    while time.monotonic() < until_s:
        time.sleep(min(EVERY_S, seconds))
        times, images = arrivals.swap()
        if arrivals.fault != told:
            told = arrivals.fault
            print(told or 'the image is as it should be again', file=sys.stderr)
        if times:
            yield meter.take(times, images)
        elif camera.state.kind == 'ended':
            return
        elif camera.state.kind in FAILED:
            raise DeviceMissing(camera.state.text.rpartition(';')[0])


class Arrivals:
    """Images as they come: the times of all, the last two themselves, what is wrong with them."""

    def __init__(self) -> None:
        from eol_ros.core.vision.image_health import Watch

        self.fault, self.begun = '', False
        self._watch, self._lock = Watch(None), threading.Lock()
        self._times: list[tuple[int, int]] = []
        self._images: deque[np.ndarray] = deque(maxlen=2)

    def take(self, stamp_ns: int, image: np.ndarray) -> None:
        """Take in one image, as `Camera` delivers it."""
        arrived_ns = time.time_ns()
        self.fault = self._watch.fault(stamp_ns * 1e-9, image)
        self._watch.rests(True)
        with self._lock:
            self._times.append((stamp_ns, arrived_ns))
            self._images.append(image)
        self.begun = True

    def swap(self) -> tuple[list[tuple[int, int]], list[np.ndarray]]:
        """Return (stamp, arrival) in ns of the images since the last call, and the last two."""
        with self._lock:
            times, self._times = self._times, []
            return times, list(self._images)


def _wait(camera: Any, arrivals: Arrivals) -> None:
    """Wait for the first image; raise what the camera says where it has none."""
    end_s = time.monotonic() + OPEN_S
    while not arrivals.begun:
        state = camera.state
        if state.kind in FAILED:
            error = ConfigError if state.kind == 'wrong' else DeviceMissing
            raise error(state.text.rpartition(';')[0])
        if state.kind == 'ended' or time.monotonic() > end_s:
            raise DeviceMissing(f'{camera.source.name} gives no image')
        time.sleep(0.01)


class Focus:
    """The blur of edges, and the best of it so far."""

    verdict: Verdict

    def __init__(self, source: Any) -> None:
        self._best = math.inf

    def take(self, times: list, images: list[np.ndarray]) -> dict[str, Any]:
        """Return the figures of two images."""
        from eol_ros.core.vision.lens import edge_blur, focus_verdict

        blur = edge_blur(images[0], images[-1])
        self.verdict = focus_verdict(blur)
        if math.isfinite(blur.px):
            self._best = min(self._best, blur.px)
        best = self._best if math.isfinite(self._best) else math.nan
        return {
            'blur_px': _number(blur.px, 3),
            'best_px': _number(best, 3),
            'tiles_px': [[_number(v, 3) for v in row] for row in blur.tiles],
            'verdict': self.verdict._asdict(),
        }

    def line(self, found: dict[str, Any]) -> str:
        """Return the figures in words."""
        if found['blur_px'] is None:
            return 'no edge at rest in sight: light the blocks, and let the table rest'
        filled = round(BAR * min(found['best_px'] / max(found['blur_px'], 1e-3), 1.0))
        (nw, _, ne), (_, middle, _), (sw, _, se) = [
            ['-' if v is None else f'{v:.2f}' for v in row] for row in found['tiles_px']
        ]
        return (
            f'blur {found["blur_px"]:.2f} px  best {found["best_px"]:.2f}  '
            f'|{"#" * filled:{BAR}}|  middle {middle}  corners {nw} {ne} {sw} {se}  '
            f'{found["verdict"]["grade"]}'
        )


class Expose:
    """Brightness, saturation and what to change."""

    verdict: Verdict

    def __init__(self, source: Any) -> None:
        self._source = source
        self._levels: deque[float] = deque(maxlen=round(8 / EVERY_S))

    def take(self, times: list, images: list[np.ndarray]) -> dict[str, Any]:
        """Return the figures of the last image."""
        from eol_ros.core.vision.lens import exposure_verdict, light

        seen = light(images[-1])
        self._levels.append(seen.level - seen.dark)
        flicker = float(np.std(self._levels)) / max(float(np.mean(self._levels)), 1.0)
        exposure_us = self._source.exposure_us if self._source.live else None
        self.verdict = exposure_verdict(seen, exposure_us, flicker)
        return {
            'block_level': seen.level,
            'ground_level': seen.dark,
            'saturated': round(seen.saturated, 5),
            'flicker': round(flicker, 4),
            'exposure_us': exposure_us,
            'advice': self.verdict.do,
            'verdict': self.verdict._asdict(),
        }

    def line(self, found: dict[str, Any]) -> str:
        """Return the figures in words."""
        return (
            f'blocks {found["block_level"]:.0f} of 255  ground {found["ground_level"]:.0f}  '
            f'saturated {found["saturated"]:.1%}  flicker {found["flicker"]:.1%}  '
            f'{self.verdict.grade}{self.verdict.do and ": "}{self.verdict.do}'
        )


class Latency:
    """From the middle of the exposure to the arrival here, how even, and what is lost."""

    verdict: Verdict

    def __init__(self, source: Any) -> None:
        self._source = source
        self._times: list[tuple[int, int]] = []

    def take(self, times: list[tuple[int, int]], images: list) -> dict[str, Any]:
        """Take in the images since the last call; return the figures of these."""
        self._times += times
        return self._figures(times)

    def _figures(self, times: list[tuple[int, int]]) -> dict[str, Any]:
        stamps, arrivals = np.array(times, np.int64).reshape(-1, 2).T
        late_ms = (arrivals - stamps) / 1e6
        figures: dict[str, Any] = {
            'images': len(late_ms),
            'p50_ms': _number(float(np.median(late_ms)), 3),
            'p99_ms': _number(float(np.quantile(late_ms, 0.99)), 3),
            'worst_ms': _number(late_ms.max(), 3),
        }
        if len(stamps) > 2:
            steps_ms = np.diff(stamps) / 1e6
            period_ms = float(np.median(steps_ms))
            missed = np.maximum(np.rint(steps_ms / period_ms).astype(int) - 1, 0)
            even = steps_ms[missed == 0]
            figures |= {
                'rate_hz': _number(1e3 / period_ms, 3),
                'jitter_ms': _number(float(np.std(even)), 4),
                'not_arrived': int(missed.sum()),
            }
        return figures

    def line(self, found: dict[str, Any]) -> str:
        """Return the figures of a moment in words."""
        return f'{found["images"]} images, {found["p50_ms"]:.2f} ms, worst {found["worst_ms"]:.2f}'

    def summary(self, camera: Any) -> dict[str, Any]:
        """Return the figures of the whole run."""
        if not self._times:
            raise DeviceMissing(f'{self._source.name} gave no image in this time')
        figures = self._figures(self._times)
        lost = figures.get('not_arrived', 0) + camera.dropped
        self.verdict = worst(
            [
                judged(
                    'p99', figures['p99_ms'], 'ms', LATE_MS,
                    'sound.latency_s leaves 16.7 ms for camera, tracker and nodes',
                    'take a faster mode or port of the camera, or raise sound.latency_s',
                ),
                judged(
                    'lost images', 100 * lost / (figures['images'] + lost), '%',
                    (100 * LOST[0], 100 * LOST[1]), 'slips are timed by single images',
                    'give the camera a USB port of its own, and the machine nothing else to do',
                ),
            ]
        )  # fmt: skip
        return {
            'camera': self._source.name,
            **figures,
            'dropped_here': camera.dropped,
            **self._source.values,
            'verdict': self.verdict._asdict(),
        }

    def text(self, found: dict[str, Any]) -> str:
        """Return the summary, a figure a line."""
        return '\n'.join(f'{name:15} {value}' for name, value in found.items() if name != 'verdict')


def _number(value: float, digits: int) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _source(args: argparse.Namespace) -> Any:
    """Return the camera that is meant, with its settings from scene and command line."""
    from eol_ros import scene as scenes
    from eol_ros.devices.camera.sources import source_of
    from eol_ros.settings import CameraSettings

    settings = CameraSettings()
    if args.scene:
        found = scenes.load(args.scene).nodes.get('camera')
        if found is None:
            raise ConfigError(f'{args.scene}: has no camera')
        settings = found
    changes: dict[str, Any] = {
        name: value
        for name in ('device', 'fps', 'exposure_us', 'gain')
        if (value := getattr(args, name)) is not None
    }
    if args.size:
        width, _, height = args.size.partition('x')
        if not (width.isdecimal() and height.isdecimal()):
            raise UsageError(f'--size {args.size}: give width and height, such as 1280x800')
        changes |= {'width': int(width), 'height': int(height)}
    fields = {f.name: f for f in dataclasses.fields(settings)}
    for name, value in changes.items():
        option = 'size' if name in ('width', 'height') else name.replace('_', '-')
        try:
            changes[name] = scenes.check_value(fields[name], value)
        except ConfigError as error:
            raise UsageError(f'--{option}: {error}') from None
    return source_of(dataclasses.replace(settings, **changes))
