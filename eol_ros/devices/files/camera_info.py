# SPDX-License-Identifier: Apache-2.0
"""The lens in camera_info, in the forms in which programs write it.

The YAML of ROS's camera_calibration, that of OpenCV's FileStorage, and `ros2 topic echo` of a
sensor_msgs/CameraInfo. Lenses: plumb_bob (k1 k2 p1 p2, and k3) and rational_polynomial (8), which
is fitted by plumb_bob. https://docs.ros.org/en/jazzy/p/image_pipeline/camera_info.html
"""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from eol_ros import yaml_text
from eol_ros.errors import ConfigError

LARGEST_PX = 20000
FOCAL = 0.05, 100.0  # plausible focal lengths, in widths of the image
MOST_K = 1e4  # plausible size of a coefficient of distortion
MISFIT_PX = 0.1  # of a rational lens by plumb_bob, anywhere in the image
_NAMES = {  # ours, and those of other programs
    'image_width': ('width', 'imageWidth'),
    'image_height': ('height', 'imageHeight'),
    'camera_matrix': ('k', 'K', 'cameraMatrix', 'Camera_Matrix'),
    'distortion_coefficients': (
        'd', 'D', 'dist_coeffs', 'distCoeffs', 'distortionCoefficients', 'Distortion_Coefficients',
    ),
}  # fmt: skip
_OPENCV = '%YAML:1.0'  # its first line, which is no YAML
_OCTAL = re.compile(r'[-+]?0[0-9]+\Z')


# PyYAML has no types
class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """YAML 1.1 without its octal numbers, and with the tag of OpenCV."""


def _number(loader: Any, node: Any) -> Any:
    if _OCTAL.fullmatch(node.value):
        raise yaml.MarkedYAMLError(
            problem=f'{node.value} is an octal number: write it without the leading 0',
            problem_mark=node.start_mark,
        )
    return loader.construct_yaml_int(node)


_Loader.add_constructor('tag:yaml.org,2002:int', _number)
_Loader.add_implicit_resolver('tag:yaml.org,2002:int', _OCTAL, list('+-0'))  # 08, too
_Loader.add_constructor(
    'tag:yaml.org,2002:opencv-matrix', lambda loader, node: loader.construct_mapping(node, True)
)


def read(text: str | bytes, path: str | Path) -> dict[str, Any]:
    """Return the mapping in a YAML text, with our names; raises ConfigError with line and column.

    Of several documents, as `ros2 topic echo` prints them, the first.
    """
    if isinstance(text, bytes) and text.startswith(_OPENCV.encode()):
        text = text[len(_OPENCV) :]
    elif isinstance(text, str):
        text = text.removeprefix(_OPENCV)
    try:
        content = yaml_text.load(text, _Loader)
    except yaml.YAMLError as error:
        where = getattr(error, 'problem_mark', None)
        place = f':{where.line + 1}:{where.column + 1}' if where else ''
        why = (getattr(error, 'problem', None) or str(error)).splitlines()[0]
        raise ConfigError(f'{path}{place}: not a YAML file: {why}') from None
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: holds {type(content).__name__}, not a calibration')
    for ours, names in _NAMES.items():
        for name in names:
            if ours not in content and name in content:
                content[ours] = content[name]
    return content


def size(content: dict[str, Any], wrong: list[str]) -> tuple[int, int]:
    """Return width and height in pixels, or note what is wrong."""
    found = []
    for name in ('image_width', 'image_height'):
        value: Any = content.get(name)
        whole = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (whole and 8 <= value <= LARGEST_PX and value == int(value)):
            wrong.append(f'{name} is {value!r}, not a number of pixels')
            value = 0
        found.append(int(value))
    return found[0], found[1]


def matrix(
    content: dict[str, Any], name: str, shape: tuple[int, int], wrong: list[str], hint: str = ''
) -> np.ndarray | None:
    """Return the matrix `name`, or note what is wrong with it."""
    values = _values(content, name, wrong, hint)
    if values is None:
        return None
    value = content[name]
    rows, cols = (value.get('rows'), value.get('cols')) if isinstance(value, dict) else shape
    if (rows, cols) != shape or len(values) != shape[0] * shape[1]:
        wrong.append(
            f'{name} has {rows} rows, {cols} cols and {len(values)} values, not '
            f'{shape[0]} x {shape[1]}'
        )
        return None
    return values.reshape(shape)


def lens(
    content: dict[str, Any], size_px: tuple[int, int], wrong: list[str]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return camera matrix (3, 3) and distortion (5,) of plumb_bob, or note what is wrong."""
    camera = matrix(content, 'camera_matrix', (3, 3), wrong)
    values = _values(content, 'distortion_coefficients', wrong, '')
    if camera is not None and all(size_px):
        focal = camera[[0, 1], [0, 1]] / size_px[0]
        middle = camera[:2, 2] / size_px
        plain = np.diag([*camera[[0, 1], [0, 1]], 1.0])
        plain[:2, 2] = camera[:2, 2]
        if not ((FOCAL[0] <= focal) & (focal <= FOCAL[1])).all():
            wrong.append(
                f'camera_matrix: focal lengths of {camera[0, 0]:g} and {camera[1, 1]:g} px are not '
                f'those of a lens with images of {size_px[0]} px'
            )
        elif not ((middle >= -0.5) & (middle <= 1.5)).all():
            wrong.append(
                f'camera_matrix: its middle ({camera[0, 2]:g}, {camera[1, 2]:g}) lies far outside '
                'the image'
            )
        elif np.abs(camera - plain).max() > MISFIT_PX:
            wrong.append('camera_matrix is not fx 0 cx, 0 fy cy, 0 0 1: skew or another scale')
    model = content.get('distortion_model') or ('plumb_bob' if values is None or len(values) < 8
                                                else 'rational_polynomial')  # fmt: skip
    counts = {'plumb_bob': (0, 4, 5), 'rational_polynomial': (8,)}.get(model)
    if counts is None:
        wrong.append(
            f'distortion_model is {model!r}; only plumb_bob and rational_polynomial are known'
        )
        return camera, None
    if values is None:
        return camera, None
    if len(values) not in counts or not (np.abs(values) <= MOST_K).all():
        wrong.append(
            f'distortion_coefficients has {len(values)} values'
            + (f' up to {np.abs(values).max():g}' if len(values) else '')
            + f'; {model} has {" or ".join(map(str, counts[-2:]))}, of some units at most'
        )
        return camera, None
    if len(values) == 8 and camera is not None and not wrong:
        return camera, _fitted(values, camera, size_px, wrong)
    return camera, np.concatenate([values, np.zeros(8)])[:5]


def _fitted(
    rational: np.ndarray, camera: np.ndarray, size_px: tuple[int, int], wrong: list[str]
) -> np.ndarray | None:
    """Return k1, k2, p1, p2, k3 that distort as k1 k2 p1 p2 k3 k4 k5 k6 do within the image."""
    if not rational[5:].any():
        return rational[:5]
    import cv2

    focal, middle = camera[[0, 1], [0, 1]], camera[:2, 2]
    share = np.linspace(-0.3, 1.3, 65)
    px = np.stack(np.meshgrid(share, share), axis=2).reshape(-1, 2) * size_px
    rays = np.column_stack([(px - middle) / focal, np.ones(len(px))])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera, rational)[0][:, 0]
    inside = ((seen > -1) & (seen < size_px)).all(axis=1)
    x, y = rays[inside, :2].T
    away_x, away_y = ((seen[inside] - middle) / focal).T
    r2 = x * x + y * y
    terms = np.concatenate([
        np.stack([x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3], 1),
        np.stack([y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3], 1),
    ])  # fmt: skip
    target = np.concatenate([away_x - x, away_y - y])
    found = np.linalg.lstsq(terms, target, rcond=None)[0]
    misfit = float(np.abs(terms @ found - target).max(initial=math.inf if not len(x) else 0.0))
    if not misfit * camera[0, 0] <= MISFIT_PX:
        wrong.append(
            f'distortion_coefficients of rational_polynomial differ by {misfit * camera[0, 0]:.2g} '
            'px from any plumb_bob; calibrate the lens as plumb_bob'
        )
        return None
    return found


def _values(content: dict[str, Any], name: str, wrong: list[str], hint: str) -> np.ndarray | None:
    value = content.get(name)
    if value is None:
        wrong.append(f'{name} is absent{hint}')
        return None
    data = value.get('data') if isinstance(value, dict) else value
    if not isinstance(data, list):
        wrong.append(f'{name} must have rows, cols and data')
        return None
    try:
        rows = [row if isinstance(row, list) else [row] for row in data]
        found = np.array([float(value) for row in rows for value in row])
    except (TypeError, ValueError):
        wrong.append(f'{name} holds something that is not a number')
        return None
    if not np.isfinite(found).all():
        wrong.append(f'{name} holds a number that is not finite')
        return None
    return found
