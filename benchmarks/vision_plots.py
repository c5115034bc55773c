# SPDX-License-Identifier: Apache-2.0
"""Plots of `eol bench vision`: error against run time, error against noise, error in clutter."""

from pathlib import Path

import numpy as np

from benchmarks import plots
from eol_ros.core.vision.render.renderer import NOISE_LEVELS

BOUND = 'Cramer-Rao bound'
SIGHT = {'rms_px': 'in full sight', 'rms_partly_px': '2 to 50 % hidden'}


def draw(result: dict, folder: str) -> list[Path]:
    """Write vision_time.png, vision_noise.png and vision_clutter.png; return what was written."""
    time: plots.Curves = {}
    noise: plots.Curves = {}
    for level, entry in result['noise'].items():
        read = NOISE_LEVELS[level][0]
        noise.setdefault(BOUND, []).append((read, entry['bound_px'], 0.0, ''))
        for name, f in entry['methods'].items():
            if f['rms_px'] is None:
                continue
            time.setdefault(name, []).append((f['ms_median'], f['rms_px'], 0.0, level))
            noise.setdefault(name, []).append((read, f['rms_px'], 0.0, ''))
    clutter: dict[str, plots.Curves] = {}
    for level, films in result['clutter'].items():
        for key, seen in SIGHT.items():
            curves = clutter.setdefault(f'{level}, {seen}', {})
            for name in next(iter(films.values())):
                of = [film[name] for film in films.values() if film[name][key] is not None]
                if of:
                    rms = float(np.sqrt(np.mean([f[key] ** 2 for f in of])))
                    ms = float(np.median([f['ms_median'] for f in of]))
                    curves[name] = [(ms, rms, 0.0, '')]
    panels: dict[str, tuple[dict[str, plots.Curves], str]] = {
        'time': ({'clean images': time} if time else {}, 'ms an image'),
        'noise': ({'clean images': noise} if noise else {}, 'read noise, grey levels'),
        'clutter': (clutter, 'ms an image'),
    }
    return [
        plots.draw(Path(folder) / f'vision_{name}.png', drawn, x, 'px RMS per axis')
        for name, (drawn, x) in panels.items()
        if drawn
    ]
