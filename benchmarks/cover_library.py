# SPDX-License-Identifier: Apache-2.0
"""Patterns of covers as images show them, for simulated detections that have no image."""

import numpy as np
from support.relief import films, scene

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import cover_light
from eol_ros.core.vision.render.clutter import clutter_calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions

KINDS = ('relief', 'textured', 'alike')
EXPOSURES = 8  # of each path-traced image


def patterns(kind: str) -> np.ndarray:
    """Return patterns (m, 25, SIZE) of 25 covers, each as m images show it.

    kind: `relief`, path-traced, the camera tilted by 4 degrees, the rim in all quarters; `textured`
    as the flat renderer's `hard` clutter has it; `alike`, flat squares without any texture.
    """
    found = []
    if kind == 'relief':
        shown = [f for f in films.load(films.TURNED) if f.name.startswith('tilted')]
        for film in shown:
            camera = films.calibration(film, False)
            for k in range(EXPOSURES):
                found.append(sampled(camera, films.sensed(film.light, k), film.shot.poses))
        return np.array(found)
    level = 'hard' if kind == 'textured' else 'clean'
    camera, rng = clutter_calibration(level), np.random.default_rng(17)
    renderer = Renderer(RenderOptions(clutter=level), camera, 3)
    for k in range(EXPOSURES * 12):
        poses = np.column_stack(
            [
                scene.stirred(k)[:, :2] + rng.uniform(-0.06, 0.06, 2),
                rng.uniform(-0.3, 0.3, N_BLOCKS),
            ]
        )
        image = renderer.render(*poses.T, k, flash=np.zeros(N_BLOCKS))
        if renderer.visible_share(*poses.T, k).min() == 1.0:
            found.append(sampled(camera, image, poses))
    return np.array(found)


def sampled(camera: Calibration, image: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return the patterns (25, SIZE) of blocks at `poses` (25, 3) in `image`, NaN: saturated."""
    found = np.empty((len(poses), cover_light.SIZE))
    packed = camera.packed()
    image = image.copy()
    image.flags.writeable = False
    for pose, pattern in zip(poses, found, strict=True):
        if not cover_light.sample(packed, image, *pose, pattern):
            pattern[:] = np.nan
    return found
