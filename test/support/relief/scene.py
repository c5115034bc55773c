# SPDX-License-Identifier: Apache-2.0
"""What is true of a path-traced image: its camera, its covers, where the blocks stand.

Metres in the frame `table`, z up from the sandpaper.
"""

from dataclasses import dataclass, field

import numpy as np

from assets.covers.mesh import CoverShape
from eol_ros.core.vision.calibration.model import IDEAL_FOCAL_PX, Calibration
from support.paper import N_BLOCKS, rest_lattice

CELLS = 42  # squares along a side of a cover: 2 mm, about a pixel
GAP_M = 0.001  # between the sandpaper and the lower rim
CAMERA_HEIGHT_M = 1.85


@dataclass(frozen=True)
class View:
    """One camera: above `offset_m` from the table's centre, its axis `tilt_deg` off the vertical.

    It leans towards `heading_deg`, counter-clockwise from x.
    """

    offset_m: tuple[float, float] = (0.0, 0.0)
    tilt_deg: float = 0.0
    heading_deg: float = 0.0
    k1: float = 0.0
    width: int = 1280
    height: int = 800

    def calibration(self) -> Calibration:
        """Return its calibration for the plane of the sandpaper."""
        tilt, heading = np.radians(self.tilt_deg), np.radians(self.heading_deg)
        ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
        axis = np.sin(tilt) * ahead - np.cos(tilt) * np.array([0.0, 0.0, 1.0])
        # turned by the least rotation from straight down, so that x stays to the right
        across = np.cross(ahead, [0.0, 0.0, 1.0])
        turn = np.column_stack([across, np.cross(axis, across), axis])
        level = np.column_stack([across, np.cross([0, 0, -1.0], across), [0, 0, -1.0]])
        to_camera = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]]) @ level @ turn.T
        centre = np.array([*self.offset_m, CAMERA_HEIGHT_M])
        ideal = Calibration.ideal(self.width, self.height)
        camera = ideal.camera_matrix.copy()
        camera[0, 0] = camera[1, 1] = IDEAL_FOCAL_PX * min(self.width / 1280, self.height / 800)
        homography = camera @ np.column_stack([to_camera[:, :2], -to_camera @ centre])
        return Calibration(
            self.width,
            self.height,
            camera,
            np.array([self.k1, 0, 0, 0, 0.0]),
            homography / homography[2, 2],
        )


@dataclass(frozen=True)
class Shot:
    """One image: the camera, the covers, where the blocks stand and how bright each is."""

    name: str
    view: View = View()
    relief_mm: float = 26.0
    landscape: int = 1  # seed of the covers
    poses: np.ndarray = field(default_factory=lambda: stirred(0))  # (25, 3) x, y, yaw
    battery: np.ndarray = field(default_factory=lambda: np.ones(N_BLOCKS))
    half: np.ndarray = field(default_factory=lambda: np.ones(N_BLOCKS))  # light of the half at +x
    arms: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))  # two ends and a radius

    def shape(self) -> CoverShape:
        """Return the sizes of its covers."""
        return CoverShape(relief_mm=self.relief_mm)


def stirred(seed: int, scatter_m: float = 0.004, yaw_rad: float = 0.05) -> np.ndarray:
    """Return poses (25, 3) of blocks that rest near the lattice after some pushes."""
    rng = np.random.default_rng([seed, 1])
    xy = rest_lattice() + rng.normal(0, scatter_m, (N_BLOCKS, 2))
    return np.column_stack([xy, rng.normal(0, yaw_rad, N_BLOCKS)])
