# SPDX-License-Identifier: Apache-2.0
"""The camera's calibration: pixels to metres on the plane of the blocks' covers, and back.

Lens model: pinhole with the plumb_bob distortion (k1, k2, p1, p2, k3) of ROS camera_info and OpenCV
(Brown, *Decentering distortion of lenses*, 1966). The homography maps table metres to undistorted
pixels of the camera matrix. Only points are undistorted, never images.

A camera that sees the table in a mirror has a homography of the other handedness. Its pixels are
left as they are: the camera matrix and the lens are those of the camera itself, and everything in
metres comes out as on the table.
"""

import hashlib
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core import algebra, elementary
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.errors import ConfigError

IDEAL_PX_PER_M = 545.0
IDEAL_FOCAL_PX = 1000.0  # with 545 px/m: the camera hangs 1.835 m above the covers


@dataclass(frozen=True)
class Calibration:
    """One camera above one table.

    Pixels: u right, v down, centres at integers. Table: metres, x right, y away. The lens is that
    of Brown (1966) as OpenCV has it; the plane a homography (Zhang 2000).

    Parameters
    ----------
    image_width, image_height : int
        Pixels of the images it is for.
    camera_matrix : ndarray
        (3, 3).
    distortion_coefficients : ndarray
        (5,) k1, k2, p1, p2, k3.
    homography : ndarray
        (3, 3), table metres (at cover height) to undistorted pixels.
    cover_height_m : float
        Height of the block covers above the platform.
    date : str
        ISO date of the calibration.
    residual_px, residual_mm : float
        RMS of what the calibration could not explain, per axis.
    covers : CoverOutlines, optional
        Heights of the blocks' covers over the platform; None for flat ones.
    table : Table
        The table that it sees.

    Raises
    ------
    ConfigError
        A matrix of the wrong shape, not finite, or without inverse.

    References
    ----------
    Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22 (2000) 1330.

    Examples
    --------
    >>> camera = Calibration.ideal(1280, 800)
    >>> round(camera.px_per_m(), 6)
    545.0
    """

    image_width: int
    image_height: int
    camera_matrix: np.ndarray
    distortion_coefficients: np.ndarray
    homography: np.ndarray
    cover_height_m: float = 0.0
    date: str = ''
    residual_px: float = 0.0
    residual_mm: float = 0.0
    covers: CoverOutlines | None = None
    table: Table = field(default_factory=Table)
    _inverse: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, shape in (
            ('camera_matrix', (3, 3)),
            ('homography', (3, 3)),
            ('distortion_coefficients', (5,)),
        ):
            value = np.asarray(getattr(self, name), float)
            if value.shape != shape or not np.isfinite(value).all():
                raise ConfigError(
                    f'calibration: {name} has shape {value.shape} or values that are '
                    f'not finite; it must be {shape}'
                )
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if self.image_width < 8 or self.image_height < 8:
            raise ConfigError(
                f'calibration: image size {self.image_width} x {self.image_height} '
                'is not the size of an image'
            )
        if min(self.camera_matrix[0, 0], self.camera_matrix[1, 1]) <= 0:
            raise ConfigError('calibration: the focal length in camera_matrix must be positive')
        centre = self.homography[:, 2]
        if abs(self._determinant()) < 1e-9 or abs(centre[2]) < 1e-9:
            raise ConfigError('calibration: homography has no inverse')
        object.__setattr__(self, '_inverse', algebra.inverse(self.homography))

    @classmethod
    def ideal(
        cls,
        width: int = 1280,
        height: int = 800,
        px_per_m: float | None = None,
        mirror: bool = False,
        table: Table | None = None,
    ) -> 'Calibration':
        """Return a camera straight above the table, without distortion, the table in the middle.

        1280 x 800 gives 545 px/m: a platform of 140 cm nearly fills the 800 rows. With `mirror` it
        sees the table in a mirror: the far edge on top, left and right exchanged.
        """
        table = table or Table()
        wide, deep = table.platform_m
        shown = max(deep / 1.4, wide / 2.24)  # 1280 x 800 as well
        scale = px_per_m or IDEAL_PX_PER_M * min(width / 1280, height / 800) / shown
        focal = IDEAL_FOCAL_PX * scale / IDEAL_PX_PER_M
        u0, v0 = (width - 1) / 2, (height - 1) / 2
        camera = np.array([[focal, 0, u0], [0, focal, v0], [0, 0, 1.0]])
        homography = np.array([[scale, 0, u0], [0, -scale, v0], [0, 0, 1.0]])
        direct = cls(width, height, camera, np.zeros(5), homography, table=table)
        return direct.in_mirror() if mirror else direct

    @property
    def digest(self) -> str:
        """SHA-256 of all that maps pixels to metres, in hex: equal ones give equal metres."""
        numbers = [self.image_width, self.image_height, self.cover_height_m]
        arrays: tuple[np.ndarray, ...] = (
            self.camera_matrix,
            self.distortion_coefficients,
            self.homography,
        )
        if self.covers is not None:
            arrays += (np.array([self.covers.lower_mm]), self.covers.land_mm)
        if self.table != Table():
            arrays += (self.table.rest, self.table.ids, np.array([self.table.block_side_m]))
        parts = [np.array(numbers, float), *(array.ravel() for array in arrays)]
        return hashlib.sha256(np.concatenate(parts).astype('<f8').tobytes()).hexdigest()

    @property
    def mirrored(self) -> bool:
        """Whether the image is a mirror image of the table.

        The Jacobian determinant of a homography H at the table's centre is det(H) / H[2, 2]^3. As v
        runs down and y away, it is negative for a camera without a mirror.
        """
        return bool(self._determinant() * self.homography[2, 2] > 0)

    def _determinant(self) -> float:
        h = self.homography
        return float((np.cross(h[0], h[1]) * h[2]).sum())

    def in_mirror(self) -> 'Calibration':
        """Return the same camera above the table's mirror image, left and right exchanged."""
        return replace(self, homography=self.homography * [-1.0, 1.0, 1.0])

    def check_image(self, image: np.ndarray) -> None:
        """Raise ConfigError unless `image` is 8-bit grey of this calibration's size."""
        size = (self.image_height, self.image_width)
        if image.ndim != 2 or image.dtype != np.uint8 or image.shape != size:
            raise ConfigError(
                f'image is {"x".join(map(str, image.shape[1::-1]))} {image.dtype} with '
                f'{image.ndim} axes; the calibration is for {size[1]}x{size[0]} uint8 grey: use '
                'the calibration of this camera, or set the camera to that size'
            )

    def undistort(self, px: ArrayLike) -> np.ndarray:
        """Return undistorted pixels, (n, 2), of distorted pixels (n, 2)."""
        px = np.asarray(px, float).reshape(-1, 2)
        if not self.distortion_coefficients.any() or not len(px):
            return px.copy()
        import cv2  # the twin's ideal camera needs none of its memory

        rounds = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9
        return cv2.undistortPoints(
            px[:, None],
            self.camera_matrix,
            self.distortion_coefficients,
            R=np.eye(3),
            P=self.camera_matrix,
            criteria=rounds,
        )[:, 0]

    def distort(self, px: ArrayLike) -> np.ndarray:
        """Return distorted pixels, (n, 2), of undistorted pixels (n, 2)."""
        px = np.asarray(px, float).reshape(-1, 2)
        k1, k2, p1, p2, k3 = self.distortion_coefficients
        if not self.distortion_coefficients.any():
            return px.copy()
        camera = self.camera_matrix
        y = (px[:, 1] - camera[1, 2]) / camera[1, 1]
        x = (px[:, 0] - camera[0, 2] - camera[0, 1] * y) / camera[0, 0]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack(
            [
                camera[0, 0] * xd + camera[0, 1] * yd + camera[0, 2],
                camera[1, 1] * yd + camera[1, 2],
            ],
            axis=1,
        )

    def lens_difference_px(self, matrix: ArrayLike, distortion: ArrayLike) -> float:
        """Return the largest distance (px) between images of one ray by this lens and another.

        matrix: (3, 3); distortion: (5,), plumb_bob. Compared on a grid over the image.
        """
        u, v = np.linspace(0, self.image_width - 1, 9), np.linspace(0, self.image_height - 1, 9)
        grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        other = replace(
            self,
            camera_matrix=np.reshape(matrix, (3, 3)),
            distortion_coefficients=np.asarray(distortion, float),
        )
        rays = project(algebra.inverse(self.camera_matrix), self.undistort(grid))
        there = other.distort(project(other.camera_matrix, rays))
        return float(np.abs(there - grid).max())

    def to_table(self, px: ArrayLike) -> np.ndarray:
        """Map pixels to the table.

        Parameters
        ----------
        px : array_like
            (n, 2) u, v; NaN stays NaN.

        Returns
        -------
        ndarray
            (n, 2) x, y in metres.

        Examples
        --------
        >>> Calibration.ideal().to_table([[694.0, 345.0]]).round(6).tolist()
        [[0.1, 0.1]]
        """
        return project(self._inverse, self.undistort(px))

    def to_pixels(self, xy: ArrayLike) -> np.ndarray:
        """Map places on the table to pixels.

        Parameters
        ----------
        xy : array_like
            (n, 2) in metres.

        Returns
        -------
        ndarray
            (n, 2) u, v.

        Examples
        --------
        >>> Calibration.ideal().to_pixels([[0.1, 0.0]]).round(6).tolist()
        [[694.0, 399.5]]
        """
        return self.distort(project(self.homography, np.asarray(xy, float).reshape(-1, 2)))

    def yaw_to_image(self, px: ArrayLike, yaw: ArrayLike) -> np.ndarray:
        """Return the image angle (n,) of squares at `px` (n, 2) with `yaw` (n,) on the table.

        With table vectors and image vectors (v up) as complex numbers the image of w is
        a w + b conj(w); the angle of a square is that of `a`. In a mirror w is the vector's mirror
        image.
        """
        across, along = self._axes(px, 0.02)
        one, other = across[:, 0] - 1j * across[:, 1], along[:, 0] - 1j * along[:, 1]
        kept = one + 1j * other if self.mirrored else one - 1j * other
        yaw = np.asarray(yaw, float)
        return elementary.arctan2(kept.imag, kept.real) + (-yaw if self.mirrored else yaw)

    def side_px(self, px: ArrayLike, side_m: float) -> np.ndarray:
        """Return the image side (n,) of a square of `side_m` centred at `px` (n, 2)."""
        across, along = self._axes(px, side_m / 2)
        return np.sqrt(np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]))

    def _axes(self, px: ArrayLike, half_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what lengths of 2 half_m along x and y are at `px` (n, 2) in the image."""
        centre = self.to_table(px)
        ends = [self.to_pixels(centre + sign * s) for s in np.eye(2) * half_m for sign in (1, -1)]
        return ends[0] - ends[1], ends[2] - ends[3]

    def packed(self) -> np.ndarray:
        """Return all numbers of it in one row (32,), as mapping takes them."""
        camera = self.camera_matrix
        lens = [camera[0, 0], camera[0, 1], camera[0, 2], camera[1, 1], camera[1, 2]]
        return np.concatenate(
            [
                self.homography.ravel(),
                self._inverse.ravel(),
                lens,
                self.distortion_coefficients,
                [-1.0 if self.mirrored else 1.0],
                self.upward(),
            ]
        )

    def camera_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Return where the camera is: its axes as columns (3, 3), and its place (3,) in metres.

        In the frame `table`; the camera's x is right in the image, y down, z into the scene
        (REP 103). The homography K [r1 r2 t] has the pose of the plane of the covers (Zhang 2000).
        Not for a camera that sees the table in a mirror, which has no such pose.
        """
        pose, scale = self._pose()
        pose = pose / scale
        right = pose[:, 0] / algebra.norm(pose[:, 0])
        ahead = pose[:, 1] - (pose[:, 1] * right).sum() * right
        table = np.stack([right, ahead / algebra.norm(ahead), np.zeros(3)], axis=1)
        table[:, 2] = np.cross(table[:, 0], table[:, 1])
        position = -algebra.matmul(table.T, pose[:, 2:])[:, 0]
        return table.T, position + [0.0, 0.0, self.cover_height_m]

    def upward(self) -> np.ndarray:
        """Return what a metre of height adds to the homogeneous image of a point, (3,).

        The homography K [r1 r2 t] gives the pose of the plane (Zhang 2000); r3 = r1 x r2 points up,
        to the camera. A mirror turns r1 x r2 away from the camera, while what stands on the plane
        still stands on the camera's side of it.
        """
        pose, scale = self._pose()
        up = np.cross(pose[:, 0], pose[:, 1]) * (-1 if self.mirrored else 1)
        return algebra.matmul(self.camera_matrix, up) * scale / algebra.norm(up)

    def _pose(self) -> tuple[np.ndarray, float]:
        """Return [r1 r2 t] times a scale, and that scale, by which the plane lies ahead."""
        pose = algebra.solve(self.camera_matrix, self.homography)
        scale = np.sqrt(algebra.norm(pose[:, 0]) * algebra.norm(pose[:, 1]))
        return pose, float(scale if pose[2, 2] > 0 else -scale)

    def px_per_m(self) -> float:
        """Return the scale at the table's centre in pixels per metre."""
        side_m = self.table.block_side_m
        return float(self.side_px(self.to_pixels([[0.0, 0.0]]), side_m)[0] / side_m)


def project(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return `points` (n, 2) mapped by a (3, 3) homography."""
    x, y = points[:, 0, None], points[:, 1, None]
    image = x * homography[:, 0] + y * homography[:, 1] + homography[:, 2]
    return image[:, :2] / image[:, 2:]
