# SPDX-License-Identifier: Apache-2.0
"""The sets of path-traced images, and how they are written."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from support.relief import scene
from support.relief.films import STEPS
from support.relief.scene import Shot, View

from eol_ros.errors import ConfigError

STRAIGHT = View()
ASIDE = View(offset_m=(0.3, 0.0))
TILTED = View(offset_m=(0.0, -0.13), tilt_deg=4, heading_deg=90)
STEEP = View(offset_m=(0.3, 0.1), tilt_deg=10, heading_deg=198)
LENS = View(offset_m=(-0.1, 0.1), tilt_deg=4, heading_deg=-30, k1=-0.1)


def small_set() -> list[Shot]:
    """Return the shots that are shipped: cameras, reliefs, and blocks stirred between images."""
    weak = np.random.default_rng(7).uniform(0.8, 1.2, 25)
    shots = [Shot('tilted', TILTED, poses=scene.stirred(1), battery=weak)]
    for k in (2, 3):
        shots.append(replace(shots[0], name=f'tilted-stirred-{k}', poses=scene.stirred(k)))
    away = np.random.default_rng(5).uniform(-1, 1, (25, 3)) * [0.0042, 0.0042, 0.01]
    shots.append(replace(shots[0], name='tilted-moved', poses=shots[0].poses + away))
    flash = np.where(np.arange(25) % 3 == 1, 2.0, 1.0)
    half = np.where(np.arange(25) % 3 == 2, 0.5, 1.0)
    shots.append(replace(shots[0], name='tilted-lit', battery=weak * flash, half=half))
    shots += [
        Shot('straight', STRAIGHT, poses=scene.stirred(4), battery=weak),
        Shot('aside', ASIDE, poses=scene.stirred(5, yaw_rad=0.15), battery=weak),
        Shot('steep', STEEP, poses=scene.stirred(6), battery=weak),
        Shot('lens', LENS, poses=scene.stirred(7, yaw_rad=0.15), battery=weak),
    ]
    for relief in (0.0, 40.0):
        for name, view in (('straight', STRAIGHT), ('tilted', TILTED), ('steep', STEEP)):
            shots.append(
                Shot(f'{name}-{relief:.0f}mm', view, relief, poses=scene.stirred(8), battery=weak)
            )
    return shots


def turned_set() -> list[Shot]:
    """Return the shots by which names are known again: one camera, the rim in all four quarters.

    All of one set of covers; between images the rim is pushed and turned, the blocks are stirred,
    and each shines otherwise.
    """
    shots = []
    for quarters in range(4):
        for stir in range(3):
            rng = np.random.default_rng([quarters, stir, 11])
            poses = scene.stirred(100 + 10 * quarters + stir)
            angle = quarters * np.pi / 2 + rng.uniform(-0.35, 0.35)
            c, s = np.cos(angle), np.sin(angle)
            poses[:, :2] = poses[:, :2] @ [[c, s], [-s, c]] + rng.uniform(-0.06, 0.06, 2)
            poses[:, 2] += angle
            battery = rng.uniform(0.5, 1.3, scene.N_BLOCKS)
            shots.append(Shot(f'tilted-{quarters}-{stir}', TILTED, poses=poses, battery=battery))
    return shots


def stirred_set() -> list[Shot]:
    """Return the shots by which cameras are calibrated: three a camera, as a technician takes them.

    Between two images the blocks are stirred and the rim is put back to the middle by eye.
    """
    shots = []
    for camera, (name, view) in enumerate(
        (('straight', STRAIGHT), ('steep', STEEP), ('lens', LENS))
    ):
        weak = np.random.default_rng([camera, 13]).uniform(0.8, 1.2, scene.N_BLOCKS)
        for stir in range(3):
            rng = np.random.default_rng([camera, stir, 12])
            poses = scene.stirred(200 + 10 * camera + stir)
            angle = rng.normal(0, 0.04)
            c, s = np.cos(angle), np.sin(angle)
            poses[:, :2] = poses[:, :2] @ [[c, s], [-s, c]] + rng.normal(0, 0.015, 2)
            poses[:, 2] += angle
            shots.append(Shot(f'{name}-{stir + 1}', view, poses=poses, battery=weak))
    return shots


def large_set(images: int = 40, seed: int = 1) -> list[Shot]:
    """Return the shots of `make films`: cameras, covers, poses and batteries drawn by seed."""
    rng = np.random.default_rng([seed, 2])
    shots = []
    for k in range(images):
        heading, tilt = rng.uniform(-180, 180), rng.uniform(0, 10)
        # the axis meets the table near its centre, the camera stands at most 0.33 m beside it
        back = scene.CAMERA_HEIGHT_M * np.tan(np.radians(tilt))
        aside = -back * np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading))])
        offset = aside + rng.uniform(-0.03, 0.03, 2)
        view = View((offset[0], offset[1]), tilt, heading, rng.uniform(-0.12, 0.0))
        relief = (0.0, 12.0, 26.0, 40.0)[k % 4]
        poses = scene.stirred(seed * 1000 + k, yaw_rad=0.15)
        battery = rng.uniform(0.5, 1.3, 25)
        shots.append(Shot(f'drawn-{k:03d}', view, relief, 1, poses, battery))
    return shots


def save(folder: Path, shot: Shot, light: np.ndarray, low: tuple[int, int]) -> dict[str, Any]:
    """Write one image, `light` with its corner `low` (u, v); return its truth."""
    name = f'{shot.name}.png'
    kept = np.clip(np.rint(light * STEPS), 0, 65535).astype(np.uint16)
    if not cv2.imwrite(str(folder / name), kept, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise ConfigError(f'{folder / name}: cannot be written')
    view = shot.view
    return {
        'image': name,
        'corner_px': [int(c) for c in low],
        'camera': {
            'offset_m': [float(c) for c in view.offset_m],
            'tilt_deg': float(view.tilt_deg),
            'heading_deg': float(view.heading_deg),
            'k1': float(view.k1),
            'size_px': [view.width, view.height],
        },
        'relief_mm': shot.relief_mm,
        'landscape': shot.landscape,
        'poses': np.round(shot.poses, 9).tolist(),
        'battery': np.round(shot.battery, 6).tolist(),
        'half': shot.half.tolist(),
        'arms': shot.arms.tolist(),
    }


def save_truth(folder: Path, truth: dict[str, Any]) -> None:
    """Write what is true of all images of a folder."""
    (folder / 'films.json').write_text(json.dumps(truth, indent=1) + '\n')
