# SPDX-License-Identifier: Apache-2.0
"""Films of any renderer, with their truth.

A folder holds `frames.npy` (n, h, w) uint8, `calibration.yaml`, and `truth.npz` with `t` (n,) s,
`world` (n, 25, 3) x, y in m and yaw in rad by block id, and `visible` (n, 25), the share in sight.
"""

from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from benchmarks.vision_peers import timed
from benchmarks.vision_scenes import number
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.files import calibration_file
from eol_ros.errors import UsageError
from eol_ros.settings import TrackerSettings
from eol_ros.verbs.progress import track

NEAR_PX = 15.0  # farther from a block's place an answer is wrong, or another block's


def load(folder: Path) -> tuple[np.ndarray, dict, Any]:
    """Return images, truth and calibration of a folder; raises UsageError for another kind."""
    for name in ('frames.npy', 'truth.npz', 'calibration.yaml'):
        if not (folder / name).is_file():
            raise UsageError(f'{folder}: no {name} in it')
    try:
        frames = np.load(folder / 'frames.npy', mmap_mode='r')
    except (ValueError, OSError) as error:
        raise UsageError(f'{folder}/frames.npy: {error}') from None
    try:
        with np.load(folder / 'truth.npz') as file:
            truth = {name: file[name] for name in ('t', 'world', 'visible')}
    except (KeyError, TypeError, ValueError, OSError, BadZipFile) as error:
        raise UsageError(f'{folder}/truth.npz: {error}') from None
    camera = calibration_file.load(str(folder / 'calibration.yaml'), False)
    size = (camera.image_height, camera.image_width)
    if frames.ndim != 3 or frames.dtype != np.uint8 or frames.shape[1:] != size or not len(frames):
        raise UsageError(
            f'{folder}/frames.npy: {frames.shape} {frames.dtype}, '
            f'not (n, {size[0]}, {size[1]}) uint8 as calibration.yaml says'
        )
    shapes = {'t': (len(frames),), 'world': (len(frames), 25, 3), 'visible': (len(frames), 25)}
    for name, shape in shapes.items():
        if truth[name].shape != shape:
            raise UsageError(f'{folder}/truth.npz: {name} is {truth[name].shape}, not {shape}')
        if not np.isfinite(truth[name].astype(float)).all():
            raise UsageError(f'{folder}/truth.npz: {name} has values that are not finite')
    return frames, truth, camera


def score(seen: np.ndarray, px: np.ndarray, at: np.ndarray, visible: np.ndarray) -> dict:
    """Return the figures of one film: answers seen, px (n, 25), (n, 25, 2), and the truth."""
    seen, px = seen.copy(), px.copy()
    far = np.hypot(*(px - at).transpose(2, 0, 1))
    near = np.full(seen.shape, -1)  # the block at whose place an answer lies
    for k in range(len(px)):
        away = np.hypot(*(px[k][:, None] - at[k][None]).transpose(2, 0, 1))
        near[k] = np.where(seen[k] & (away.min(axis=1) < NEAR_PX), away.argmin(axis=1), -1)
    switches, last = 0, np.full(25, -1)
    for row in near:  # which answer each block has
        named = np.full(25, -1)
        named[row[row >= 0]] = np.flatnonzero(row >= 0)
        switches += int(((named >= 0) & (last >= 0) & (named != last)).sum())
        last = np.where(named >= 0, named, last)
    whole, partly = visible > 0.98, (visible > 0.5) & (visible <= 0.98)
    hidden, right = visible < 0.2, seen & (far < NEAR_PX)

    def rms(which):
        return float(np.sqrt((far[which] ** 2).mean() / 2)) if which.any() else None

    def share(which):
        return float((seen & which).sum() / which.sum()) if which.any() else None

    return {
        'whole': share(whole),
        'rms_px': rms(whole & right),
        'partly': share(partly),
        'rms_partly_px': rms(partly & right),
        'hidden_reported': int((hidden & seen).sum()),
        'hidden': int(hidden.sum()),
        'wrong_place': int((seen & (far >= NEAR_PX) & (visible > 0.5)).sum()),
        'switches': switches,
    }


def measure(folders: list[str]) -> dict:
    """Return figures by folder."""
    result: dict[str, dict] = {}
    for folder in folders:
        frames, truth, camera = load(Path(folder))
        at = np.stack([camera.to_pixels(pose[:, :2]) for pose in truth['world']])
        tracker, spent, seen, px = Tracker(TrackerSettings(), camera), [], [], []
        tracker.warm_up()
        images = zip(truth['t'] - truth['t'][0], frames, strict=True)
        for stamp_s, image in track(images, folder, total=len(frames)):
            tracked, ms = timed(tracker.update, float(stamp_s), np.ascontiguousarray(image))
            spent.append(ms)
            seen.append(tracked.seen)
            px.append(np.nan_to_num(tracked.px, nan=-1e6))
        result[folder] = score(np.array(seen), np.array(px), at, truth['visible']) | {
            'ms_median': float(np.median(spent)),
            'ms_p99': float(np.quantile(spent, 0.99)),
        }
    return {'truth': result}


def table(result: dict) -> str:
    """Return the figures as lines of text."""
    lines = []
    for folder, f in result['truth'].items():
        lines.append(
            f'{folder} whole {number(f["whole"], 5)} {number(f["rms_px"], 4)} px'
            f'  partly {number(f["partly"], 3)} {number(f["rms_partly_px"], 3)} px'
            f'  hidden {f["hidden_reported"]} of {f["hidden"]}  wrong {f["wrong_place"]}'
            f'  switches {f["switches"]}  {f["ms_median"]:.2f} ms (99 %: {f["ms_p99"]:.2f})'
        )
    return '\n'.join(lines)
