# SPDX-License-Identifier: Apache-2.0
"""Calibrating on printed covers: three path-traced images a camera, straight and leaning.

Between images the blocks are stirred and the rim is pushed and turned. What is found at first
sight, what `eol calibrate blocks` makes of the three, and what a running tracker makes of one of
them when it is asked to calibrate, against the camera that drew them.
"""

from dataclasses import replace

import cv2
import numpy as np

from benchmarks.relief import films
from benchmarks.vision_relief import RATE_HZ, SKIRT_M, calibration, covers, misplaced
from eol_ros.core.geometry import BLOCK_SIDE_M, N_BLOCKS, PLATFORM_SIDE_M
from eol_ros.core.vision.calibration.calibrate import all_blocks, from_images, nominal
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.calibration.self_calibration import nominal as of_side
from eol_ros.core.vision.requests import CALIBRATE
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

_ASKED_S = 0.5
_PATIENCE_IMAGES = 180
SOFTER_PX = 1.0  # makes the blur of 1.23 px, with which images are drawn, one of 1.59


def measure() -> dict[str, dict]:
    """Return what is found and how far off calibrations are, of each camera."""
    turned = {film.name: film for film in films.load(films.TURNED)}
    stirred = {film.name: film for film in films.load(films.STIRRED)}
    shown = {film.name: film for film in films.load()}
    groups = {
        'straight': [stirred[f'straight-{k}'] for k in (1, 2, 3)],
        '4 degrees': [shown[name] for name in ('tilted', 'tilted-stirred-2', 'tilted-stirred-3')],
        '4 degrees, rim turned': [turned[f'tilted-0-{k}'] for k in range(3)],
        '4 degrees, lens': [stirred[f'lens-{k}'] for k in (1, 2, 3)],
        '10 degrees': [stirred[f'steep-{k}'] for k in (1, 2, 3)],
    }
    groups |= {
        f'{name}, out of focus': [
            replace(f, light=cv2.GaussianBlur(f.light, (0, 0), SOFTER_PX)) for f in groups[name]
        ]
        for name in ('straight', '10 degrees')
    }
    return {name: _camera(group) for name, group in groups.items()}


def _camera(group: list[films.Film]) -> dict:
    film = group[0]
    height, width = film.light.shape
    images = [films.sensed(one.light, 100 + k) for k, one in enumerate(group)]
    start = nominal(width, height)
    result: dict = {
        'found': [_found(image, start, film) for image in images],
        'k1': float(film.calibration.distortion_coefficients[0]),
    }
    try:
        solution = from_images(images, start, SKIRT_M, covers(film))
    except ConfigError as error:
        result['blocks'] = {'refused': str(error)}
    else:
        result['blocks'] = {
            'refused': solution.refusal(),
            'note': solution.note,
            'k1': float(solution.calibration.distortion_coefficients[0]),
            'sigma_mm': float(np.nanmax(solution.corner_mm)),
            'known_mm': solution.platform_mm,
            **errors(solution.calibration, film),
        }
    result['self'] = asked(film)
    return result


def _found(image: np.ndarray, start: Calibration, film: films.Film) -> int:
    """Return how many blocks `eol calibrate blocks` finds where they are."""
    camera = calibration(film, True)
    start = replace(start, cover_height_m=SKIRT_M, covers=camera.covers)
    try:
        return len(all_blocks(image, start, False))
    except ConfigError:
        return 0


def errors(found: Calibration, film: films.Film) -> dict[str, float]:
    """Return the error in mm over the middle 1 m and over the whole platform, RMS and worst.

    Where the frame lies and how it is turned is left out: the rim gives that.
    """
    result = {}
    for name, side_m in (('middle', 1.0), ('platform', PLATFORM_SIDE_M)):
        off = np.hypot(*misplaced(found, calibration(film, True), side_m, 15).T)
        result[f'{name}_mm_rms'] = 1e3 * float(np.sqrt((off**2).mean()))
        result[f'{name}_mm_worst'] = 1e3 * float(off.max())
    return result


def asked(film: films.Film) -> dict:
    """Return what a running tracker with a camera that hangs straight makes of one image."""
    camera = calibration(film, True)
    side = float(np.median(camera.side_px(camera.to_pixels(film.shot.poses[:, :2]), BLOCK_SIDE_M)))
    start = of_side(film.light.shape, side, False)
    start = replace(start, cover_height_m=SKIRT_M, covers=camera.covers)
    tracker = Tracker(TrackerSettings(), start)
    tracker.requests.add(round(_ASKED_S * 1e9), CALIBRATE)
    seen = 0
    for k in range(_PATIENCE_IMAGES):
        answer = tracker.update(k / RATE_HZ, films.sensed(film.light, k))
        seen = max(seen, int(answer.seen.sum()))
        outcome = tracker.outcome
        if outcome is not None and outcome.kind == CALIBRATE:
            found = tracker.calibration
            assert found is not None
            said = {'refused': outcome.text if outcome.refused else '', 'seen': seen}
            return said | ({} if outcome.refused else errors(found, film))
    return {'refused': 'no answer', 'seen': seen}


def table(result: dict[str, dict]) -> str:
    """Return the figures as lines of text."""
    lines = []
    for camera, f in result.items():
        found = ', '.join(map(str, f['found']))
        lines.append(f'{camera}: {found} of {N_BLOCKS} covers found; true k1 {f["k1"]:g}')
        for way in ('blocks', 'self'):
            one = f[way]
            if one['refused']:
                lines.append(f'  {way:8s} refused: {one["refused"]}')
                continue
            lines.append(
                f'  {way:8s} middle 1 m {one["middle_mm_rms"]:.2f} mm RMS,'
                f' worst {one["middle_mm_worst"]:.2f};'
                f' platform {one["platform_mm_rms"]:.2f}, {one["platform_mm_worst"]:.2f}'
            )
            if way == 'blocks':
                lines[-1] += f'; known to {one["known_mm"]:.2f}, k1 {one["k1"]:.3f} {one["note"]}'
    return '\n'.join(lines)
