# SPDX-License-Identifier: Apache-2.0
"""The lens in camera_info, in the forms in which programs write it.

The YAML of ROS's camera_calibration, that of OpenCV's FileStorage, and `ros2 topic echo` of a
sensor_msgs/CameraInfo. Lenses: plumb_bob (k1 k2 p1 p2, and k3), also as rational_polynomial.
https://docs.ros.org/en/jazzy/p/image_pipeline/camera_info.html
"""

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
SKEW_PX = 0.1  # largest skew of a camera matrix
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
        elif np.abs(camera - plain).max() > SKEW_PX:
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
    if values[5:].any():
        wrong.append('distortion_coefficients: k4 to k6 are not 0; calibrate the lens as plumb_bob')
        return camera, None
    return camera, np.concatenate([values, np.zeros(5)])[:5]


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
