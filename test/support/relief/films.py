# SPDX-License-Identifier: Apache-2.0
"""Path-traced images with their truth: how they are kept, and what a sensor sees of them.

An image is kept as light, 16-bit PNG in steps of 1/8 grey level, without sensor noise: that is
added when it is used, so one image stands for hours of rest. What stands beyond the rim is left
out and dark.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from eol_ros.core import terrain
from eol_ros.core.vision.calibration.calibrate import raise_plane
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from support.relief import scene
from support.relief.land import outlines
from support.relief.scene import Shot, View

FOLDER = Path(__file__).parent / 'films'
TURNED = Path(__file__).parent / 'turned'
STIRRED = Path(__file__).parent / 'stirred'
STEPS = 8  # of a grey level
SKIRT_M = 0.012 + scene.GAP_M  # height of the lowest land
PSF_PX = 1.2  # of the lens, as the flat renderer has it
NOISE = (2.0, 0.10)  # read noise and gain of the flat renderer's L2


@dataclass(frozen=True)
class Film:
    """One image with its truth.

    light (h, w) float32 grey levels, without noise and not cut off at 255; the calibration is for
    the plane of the sandpaper, the covers' lower rims lie scene.GAP_M above it.
    """

    shot: Shot
    light: np.ndarray
    calibration: Calibration

    @property
    def name(self) -> str:
        """Its name in the set."""
        return self.shot.name


def calibration(film: Film, known: bool) -> Calibration:
    """Return the camera's own calibration, for the plane of the lowest land."""
    raised = raise_plane(film.calibration, SKIRT_M)
    return replace(raised, cover_height_m=SKIRT_M, covers=covers(film) if known else None)


def covers(film: Film) -> CoverOutlines:
    """Return the outlines of the covers of an image."""
    land = terrain.landscape(film.shot.landscape, cells=scene.CELLS)
    return outlines(land, film.shot.shape(), 1e3 * scene.GAP_M, scene.CELLS)


def load(folder: Path = FOLDER) -> list[Film]:
    """Return all images of a folder; raises ConfigError where there is no set of films."""
    listed = folder / 'films.json'
    if not listed.is_file():
        raise ConfigError(f'{folder}: has no films.json; `make films` draws a set of films')
    return [
        _load(folder, name, one) for name, one in json.loads(listed.read_text())['films'].items()
    ]


def one(name: str, folder: Path = FOLDER) -> Film:
    """Return one image of a folder."""
    listed = json.loads((folder / 'films.json').read_text())
    return _load(folder, name, listed['films'][name])


def _load(folder: Path, name: str, one: dict[str, Any]) -> Film:
    camera = one['camera']
    view = View(
        (camera['offset_m'][0], camera['offset_m'][1]),
        camera['tilt_deg'],
        camera['heading_deg'],
        camera['k1'],
        *camera['size_px'],
    )
    shot = Shot(
        name,
        view,
        one['relief_mm'],
        one['landscape'],
        np.array(one['poses']),
        np.array(one['battery']),
        np.array(one.get('half', np.ones(scene.N_BLOCKS))),
        np.reshape(one['arms'], (-1, 7)),
    )
    kept = cv2.imread(str(folder / one['image']), cv2.IMREAD_UNCHANGED)
    if kept is None or kept.dtype != np.uint16:
        raise ConfigError(f'{folder / one["image"]}: not a 16-bit image')
    u, v = one['corner_px']
    light = np.full((view.height, view.width), 2.0, np.float32)
    light[v : v + kept.shape[0], u : u + kept.shape[1]] = kept / np.float32(STEPS)
    return Film(shot, light, view.calibration())


def sensed(light: np.ndarray, seed: int, noise: tuple[float, float] = NOISE) -> np.ndarray:
    """Return what an 8-bit sensor of variance read^2 + gain * signal makes of `light` (h, w)."""
    read, gain = noise
    rng = np.random.default_rng([seed, 3])
    spread = np.sqrt(np.float32(read**2) + np.float32(gain) * light)
    seen = light + spread * rng.standard_normal(light.shape, np.float32)
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)
