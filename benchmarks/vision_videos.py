# SPDX-License-Identifier: Apache-2.0
"""What compression of a video costs: error of `eol track` against the size of its file."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.vision_peers import timed
from benchmarks.vision_scenes import RATE_HZ, Film
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.camera.image_sequence import open_source
from eol_ros.errors import DeviceMissing, pip_install
from eol_ros.settings import TrackerSettings
from eol_ros.verbs.progress import track

JPEG_SCALES = (2, 3, 5, 8, 13, 20, 31)  # ffmpeg's -q:v: 2 is the best
H264_FACTORS = (5, 12, 18, 23, 28, 34, 40)  # its -crf: 23 is the encoder's default
SETTLING = 10  # images until the lattice is found
SEED, NOISE, CLUTTER = 11, 'L2', 'clean'
Writer = Callable[[Path, list[np.ndarray]], None]


def measure(seconds: float) -> dict:
    """Return the figures of each codec at each setting, over the same images.

    H.264 in the way of cameras and phones: 4:2:0, 16 to 235, a key image every 4 s at most.
    """
    film = Film(CLUTTER, NOISE, SEED)
    drawn = [film.image(k) for k in range(round(seconds * RATE_HZ))]
    images = [image.copy() for image, _, _ in drawn]
    poses = np.array([pose for _, pose, _ in drawn])
    ways: list[tuple[str, int | None, Path, Writer]] = [
        ('FFV1, lossless', None, Path('film.mkv'), _writer('ffv1', 'gray')),
        *(
            ('MJPEG', q, Path('film.avi'), _writer('mjpeg', 'yuvj420p', qmin=f'{q}', qmax=f'{q}'))
            for q in JPEG_SCALES
        ),
        *(
            ('H.264', f, Path('film.mp4'), _writer('libx264', 'yuv420p', crf=f'{f}', g='240'))
            for f in H264_FACTORS
        ),
    ]
    rows = []
    with tempfile.TemporaryDirectory(prefix='eol-videos-') as folder:
        for codec, setting, name, write in track(ways, 'videos'):
            path = Path(folder) / name
            write(path, images)
            rows.append({'codec': codec, 'setting': setting, **_figures(path, film, poses)})
            path.unlink()
    return {'seconds': seconds, 'noise': NOISE, 'images': len(images), 'videos': rows}


def _writer(codec: str, pixels: str, **options: str) -> Writer:
    def write(path: Path, images: list[np.ndarray]) -> None:
        try:
            import av
        except ModuleNotFoundError:
            raise DeviceMissing(f'the videos are made by PyAV: {pip_install("av")}') from None
        with av.open(str(path), 'w') as container:
            stream = container.add_stream(codec, rate=round(RATE_HZ), options=options)
            stream.pix_fmt = pixels
            stream.height, stream.width = images[0].shape
            for image in images:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format='gray')))
            container.mux(stream.encode())

    return write


def _figures(path: Path, film: Film, poses: np.ndarray) -> dict:
    """Track a video as `eol track` does, and compare with the truth."""
    source = open_source(str(path), RATE_HZ)
    tracker = Tracker(TrackerSettings(), film.calibration)
    tracker.warm_up()
    scale, left, ms = film.calibration.px_per_m(), [], []
    for k, (stamp_s, image) in enumerate(source.read()):
        tracked, spent_ms = timed(tracker.update, stamp_s, image)
        error = (tracked.world[:, :2] - poses[k, :, :2]) * scale
        error[~tracked.seen] = np.nan
        if k >= SETTLING:
            left.append(error)
            ms.append(spent_ms)
    errors = np.array(left)
    seen = np.isfinite(errors[..., 0])
    moved = np.hypot(*np.diff(poses[:, :, :2], axis=0)[SETTLING - 1 :].transpose(2, 0, 1)) * scale
    moving = seen & (moved[: len(seen)] > 0.05)
    still = seen & (moved[: len(seen)] < 0.001)

    def rms(which: np.ndarray) -> float | None:
        return float(np.sqrt(np.mean(errors[which] ** 2))) if which.any() else None

    return {
        'mb_per_s': path.stat().st_size / (len(poses) / RATE_HZ) / 1e6,
        'rms_px': rms(seen),
        'rms_moving_px': rms(moving),
        'rms_still_px': rms(still),
        'worst_px': float(np.nanmax(np.hypot(errors[..., 0], errors[..., 1]))),
        'coverage': float(seen.mean()),
        'images': len(errors) + SETTLING,
        'ms_median': float(np.median(ms)),
    }


def table(result: dict) -> str:
    """Return the figures as lines."""
    lines = [f'{result["images"]} images of {result["noise"]}, error in px of whole blocks']
    for row in result['videos']:
        setting = '' if row['setting'] is None else f'{row["setting"]}'
        numbers = [
            '-' if row[key] is None else f'{row[key]:.4f}'
            for key in ('rms_px', 'rms_moving_px', 'rms_still_px', 'worst_px')
        ]
        lines.append(
            f'{row["codec"]:15s} {setting:>3s} {row["mb_per_s"]:8.3f} MB/s'
            f'  all {numbers[0]}  moving {numbers[1]}  still {numbers[2]}  worst {numbers[3]}'
            f'  coverage {row["coverage"]:.4f}  {row["ms_median"]:.2f} ms'
        )
    return '\n'.join(lines)


def draw(result: dict, folder: Path) -> Path:
    """Write vision_videos.png into `folder`: error against bytes a second."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.2), constrained_layout=True)
    lossless = result['videos'][0]
    axes.axhline(lossless['rms_px'], color='#4d4d4d', lw=1, ls=':')
    axes.annotate(
        f'lossless, {lossless["mb_per_s"]:.0f} MB/s', (0.02, lossless['rms_px']),
        (0, 4), xycoords=('axes fraction', 'data'), textcoords='offset points', color='#4d4d4d',
    )  # fmt: skip
    for codec, mark, colour, word in (
        ('MJPEG', 'o', '#2b6ca3', '-q:v'), ('H.264', 's', '#c1272d', '-crf'),
    ):  # fmt: skip
        rows = [row for row in result['videos'] if row['codec'] == codec]
        size = [row['mb_per_s'] for row in rows]
        axes.plot(
            size, [row['rms_moving_px'] for row in rows], f'-{mark}', color=colour,
            label=f'{codec}, moving; numbers: {word}',
        )  # fmt: skip
        axes.plot(
            size, [row['rms_still_px'] for row in rows], f'--{mark}', color=colour, mfc='white',
            label=f'{codec}, at rest',
        )  # fmt: skip
        for row in rows:
            axes.annotate(
                str(row['setting']), (row['mb_per_s'], row['rms_moving_px']), (3, 5),
                textcoords='offset points', fontsize=8, color=colour,
            )  # fmt: skip
    axes.set(
        xscale='log', yscale='log', xlabel='file, MB for each second at 60 images/s',
        ylabel='error of a block, px RMS per axis',
    )  # fmt: skip
    axes.spines[['top', 'right']].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / 'vision_videos.png'
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
