# SPDX-License-Identifier: Apache-2.0
"""What the tracker makes of path-traced covers: absolute error, hops, yaw, and whether sigma holds.

One image is light without noise, so a block at rest is the same light with new noise in each image:
what its place then does is the tracker's own.
"""

from pathlib import Path

import numpy as np
from support.paper import N_BLOCKS, PLATFORM_SIDE_M
from support.relief import films
from support.relief.films import SKIRT_M, calibration, covers

from eol_ros.core.vision.calibration.calibrate import from_images
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings
from eol_ros.verbs.progress import track

RATE_HZ = 60.0
SETTLED = 10  # images after which a block has its name
FLAT, KNOWN = 'covers taken to be flat', 'outlines of the covers known'


def measure(folder: Path, images: int) -> dict:
    """Return figures of each image of a set, `images` exposures each, and of calibrating."""
    shown = films.load(folder)
    result: dict = {'images': images}
    for known in (False, True):
        at_rest = {film.name: rest(film, images, known) for film in track(shown, 'films')}
        places = {name: one.pop('places') for name, one in at_rest.items()}
        sigmas = {name: one.pop('sigmas') for name, one in at_rest.items()}
        moved, lit = {}, {}
        for film in shown:
            for first in shown:
                if film.name == f'{first.name}-moved':
                    moved[film.name] = _displacement(first, film, places)
                if film.name == f'{first.name}-lit':
                    lit[film.name] = _differently_lit(first, film, places, sigmas)
        result[KNOWN if known else FLAT] = {
            'rest': at_rest,
            'moved': moved,
            'lit': lit,
            'calibration': _calibrations(shown, known),
        }
    return result


def rest(film: films.Film, images: int, known: bool) -> dict:
    """Return what `images` exposures of blocks at rest give; `known`: the covers' heights are."""
    camera, truth = calibration(film, known), film.shot.poses
    tracker, first_sight = Tracker(TrackerSettings(), camera), 0
    place, yaw = np.full((2, images, N_BLOCKS, 2), np.nan)
    sigma = np.full((images, N_BLOCKS), np.nan)
    for k in range(images + SETTLED):
        got = tracker.update(k / RATE_HZ, films.sensed(film.light, k))
        if k == 0 and got.seen.any():
            apart = camera.to_pixels(truth[:, :2])[:, None] - got.px[got.seen][None]
            first_sight = int((np.hypot(*apart.transpose(2, 0, 1)) < 10).any(axis=1).sum())
        if k >= SETTLED:
            seen = got.seen
            place[k - SETTLED, seen] = got.world[seen]
            yaw[k - SETTLED, seen, 0] = got.yaw[seen]
            sigma[k - SETTLED, seen] = got.sigma_m[seen]
    left = place - truth[:, :2]
    seen = np.isfinite(left[..., 0])
    some = seen.sum(axis=0) > 1  # others have no scatter
    usual = np.nanmedian(place[:, some], axis=0)
    away = np.hypot(*(place[:, some] - usual).transpose(2, 0, 1))
    # the median of the deviations: one hop does not make its own scale
    scatter = np.nanmedian(np.abs(place[:, some] - usual), axis=0).max(axis=1) / 0.6745
    turned = np.angle(np.exp(4j * (yaw[..., 0] - truth[:, 2]))) / 4
    noise = np.sqrt(np.nanmean(np.nanvar(place[:, some], axis=0, ddof=1), axis=1))
    places, sigmas = np.full((N_BLOCKS, 2), np.nan), np.full(N_BLOCKS, np.nan)
    places[some], sigmas[some] = np.nanmean(place[:, some], axis=0), np.nanmedian(sigma[:, some], 0)
    return {
        'noise_um': _rms(noise) * 1e6,
        'first_sight': first_sight,
        'coverage': float(seen.mean()),
        'error_mm_rms': _rms(left[seen]) * 2**0.5 * 1e3,
        'error_mm_worst': float(np.nanmax(np.hypot(*left.transpose(2, 0, 1)))) * 1e3,
        'yaw_deg_rms': float(np.degrees(_rms(turned[seen]))),
        'scatter_um': float(np.median(scatter)) * 1e6,
        'hop_mm': float(np.nanmax(away)) * 1e3,
        'hop_scatters': float(np.nanmax(away / scatter)),
        'sigma_of_scatter': float(np.median(sigmas[some] / scatter)),
        'places': places,
        'sigmas': sigmas,
    }


def _displacement(first: films.Film, second: films.Film, places: dict) -> dict:
    """Return how well the motion of each block from one image to the other is known."""
    true = (second.shot.poses - first.shot.poses)[:, :2]
    off = places[second.name] - places[first.name] - true
    return {
        'longest_mm': float(np.hypot(*true.T).max()) * 1e3,
        'error_um_rms': _rms(off[np.isfinite(off)]) * 1e6,
    }


def _differently_lit(
    first: films.Film, second: films.Film, places: dict, sigmas: dict
) -> dict[str, float]:
    """Return by how many sigmas blocks seem moved that only shine otherwise."""
    changed = (first.shot.battery != second.shot.battery) | (first.shot.half != second.shot.half)
    off = np.abs(places[second.name] - places[first.name]).max(axis=1)[changed]
    sigma = np.hypot(sigmas[first.name], sigmas[second.name])[changed]
    return {
        'blocks': int(changed.sum()),
        'within_2_sigma': int((off < 2 * sigma).sum()),
        'worst_sigmas': float(np.nanmax(off / sigma)),
        'worst_um': float(np.nanmax(off)) * 1e6,
    }


def _calibrations(shown: list[films.Film], known: bool) -> dict:
    """Return what `eol calibrate blocks` makes of images of the same camera and covers."""
    groups: dict = {}
    for film in shown:
        if film.name.endswith('-lit'):  # the same places once more
            continue
        groups.setdefault((film.shot.view, film.shot.relief_mm), []).append(film)
    found = {}
    for group in groups.values():
        found[group[0].name] = {'images': len(group)} | solved(group, known)
    return found


def solved(group: list[films.Film], known: bool) -> dict:
    film = group[0]
    height, width = film.light.shape
    try:
        solution = from_images(
            [films.sensed(one.light, 100 + k) for k, one in enumerate(group)],
            Calibration.ideal(width, height),
            SKIRT_M,
            covers(film) if known else None,
        )
    except ConfigError as error:
        return {'refused': str(error), 'error_mm_rms': None, 'error_mm_worst': None}
    # the platform, as far as blocks come
    off = misplaced(solution.calibration, calibration(film, known), PLATFORM_SIDE_M - 0.4, 11)
    return {
        'refused': solution.refusal(),
        'note': solution.note,
        'residual_px': solution.calibration.residual_px,
        'k1': float(solution.calibration.distortion_coefficients[0]),
        'error_mm_rms': _rms(off) * 2**0.5 * 1e3,
        'error_mm_worst': float(np.hypot(*off.T).max()) * 1e3,
    }


def misplaced(found: Calibration, true: Calibration, side_m: float, points: int) -> np.ndarray:
    """Return how far off `found` puts a grid on the middle `side_m` of the table, (points^2, 2) m.

    The grid is seen by the `true` camera at the height of the lowest land. The lattice gives the
    coordinate frame: how blocks rest together beside it, and turned, is no error of the camera.
    """
    axis = np.linspace(-0.5, 0.5, points) * side_m
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    at = found.to_table(true.to_pixels(grid))
    at = at - at.mean(axis=0)
    turn = np.angle((np.conj(grid @ [1, 1j]) * (at @ [1, 1j])).sum())
    c, s = np.cos(turn), np.sin(turn)
    return at @ [[c, -s], [s, c]] - grid


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float('nan')


def table(result: dict) -> str:
    """Return the figures as lines of text."""
    lines = [f'path-traced covers, {result["images"]} exposures each']
    for how in (FLAT, KNOWN):
        lines.append(f'{how}:')
        lines += _lines(result[how])
    return '\n'.join(lines)


def _lines(result: dict) -> list[str]:
    lines = []
    for name, f in result['rest'].items():
        lines.append(
            f'  {name:18s} first sight {f["first_sight"]:2d}  coverage {f["coverage"]:.4f}'
            f'  error {f["error_mm_rms"]:.3f} mm RMS, worst {f["error_mm_worst"]:.2f}'
            f'  yaw {f["yaw_deg_rms"]:.2f} deg  scatter {f["scatter_um"]:.1f} um'
            f'  hop {f["hop_mm"]:.3f} mm = {f["hop_scatters"]:.1f} scatters'
            f'  sigma/scatter {f["sigma_of_scatter"]:.2f}  noise {f["noise_um"]:.1f} um'
        )
    for name, f in result['moved'].items():
        lines.append(
            f'  {name:18s} moved by up to {f["longest_mm"]:.1f} mm:'
            f' {f["error_um_rms"]:.0f} um RMS per axis'
        )
    for name, f in result['lit'].items():
        lines.append(
            f'  {name:18s} {f["within_2_sigma"]} of {f["blocks"]} blocks that flash or are half'
            f' dark within 2 sigma; worst {f["worst_sigmas"]:.1f} sigma, {f["worst_um"]:.0f} um'
        )
    for name, f in result['calibration'].items():
        rms = f['error_mm_rms']
        said = f['refused'] or ', '.join(filter(None, ['accepted', f.get('note')]))
        off = '' if rms is None else f'{rms:.2f} mm RMS, worst {f["error_mm_worst"]:.2f}; '
        lines.append(f'  calibration, {name}, {f["images"]} images: {off}{said}')
    return lines
