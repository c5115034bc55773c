# SPDX-License-Identifier: Apache-2.0
"""The twin's virtual camera: lit squares on sandpaper, as an 8-bit grey sensor would see them.

Every image is a pure function of the poses, the seed and the image index. Covers are anti-aliased
analytically (see renderer_kernels), so the true centre of a drawn block is known to 1e-3 px.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core import elementary
from eol_ros.core.vision import outline
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render import kernels
from eol_ros.errors import ConfigError

NOISE_LEVELS = {  # (read noise, gain): variance = read^2 + gain * signal, plus 1/12 of rounding
    'none': (0.0, 0.0),
    'L0': (0.5, 0.01),
    'L1': (1.0, 0.03),
    'L2': (2.0, 0.10),
    'L3': (4.0, 0.25),
    'L4': (8.0, 0.60),
}
_DEVIATES = 1 << 21  # stored normal deviates; rows of an image start anywhere in them
_NOISE_STEP = 1 / 32
_FLASH_LEVEL = 60.0
_FLASH_HALO = 12.0
_BLUR_STEP_PX = 0.7  # an exposure is cut into positions no further apart than this
_BLUR_STEPS = 15


class Sensor:
    """The noise of an 8-bit sensor: variance read^2 + gain * signal, plus 1/12 of rounding.

    key: of the stored deviates; with its first number and an image's index, where in them the
    image's rows begin.
    """

    def __init__(self, read: float, gain: float, key: tuple[int, int]):
        self._read, self._gain, self._seed = read, gain, key[0]
        deviates = np.random.default_rng(key).standard_normal(_DEVIATES)
        self._noise = np.clip(np.rint(deviates / _NOISE_STEP), -127, 127).astype(np.int8)

    def sense(self, light: np.ndarray, index: int, out: np.ndarray) -> None:
        """Write what it makes of `light` (h, w) f4, in grey levels, to `out` (h, w) uint8."""
        kernels.sense(
            light, self._noise, _NOISE_STEP, self._read, self._gain, self._seed, index, out
        )


@dataclass(frozen=True)
class RenderOptions:
    """What the virtual camera is like.

    Args:
        noise: a key of NOISE_LEVELS.
        psf_px: standard deviation of the lens blur.
        background, block_level: grey levels of the platform and of a lit cover.
        exposure_s: shutter time; moving blocks blur over it.
    """

    noise: str = 'L2'
    psf_px: float = 1.2
    background: float = 14.0
    block_level: float = 184.0
    exposure_s: float = 0.003


class Renderer:
    """Draws the table as the camera sees it.

    Parameters
    ----------
    options : RenderOptions, optional
        Or anything with its fields.
    calibration : Calibration, optional
        Where metres fall in the image, distortion and tilt included.
    seed : int
        Seed of the noise.
    n_blocks : int, optional
        Number of blocks to draw; by default those of the table of `calibration`.

    Raises
    ------
    ConfigError
        Unknown noise level.

    Examples
    --------
    >>> image = Renderer(seed=1, n_blocks=1).render([0.0], [0.0], [0.0], 0)
    >>> image.shape, image.dtype, bool(image[400, 640] > 100)
    ((800, 1280), dtype('uint8'), True)
    """

    def __init__(
        self,
        options: RenderOptions | None = None,
        calibration: Calibration | None = None,
        seed: int = 0,
        n_blocks: int | None = None,
    ):
        self.options = options = options or RenderOptions()
        self.calibration = calibration or Calibration.ideal()
        if options.noise not in NOISE_LEVELS:
            raise ConfigError(f'noise {options.noise!r} is not one of {", ".join(NOISE_LEVELS)}')
        self.table = table = self.calibration.table
        self._present = table.present if n_blocks is None else np.ones(n_blocks, bool)
        self.n_blocks = n_blocks = len(self._present)
        self._land = _land_lines(self.calibration)
        self._sensor = Sensor(*NOISE_LEVELS[options.noise], (int(seed), 0))
        side_px = self.calibration.px_per_m() * table.block_side_m
        self._halo_px = 40.0 * (side_px / 45.8)
        self._static = self._platform()
        self._work = self._static.copy()
        self._windows = np.zeros((n_blocks * (_BLUR_STEPS + 1), 4), np.int64)
        self._dirty = 0

    def _platform(self) -> np.ndarray:
        """Return the light (h, w) f4 of an image without blocks."""
        shape = self.calibration.image_height, self.calibration.image_width
        return np.full(shape, self.options.background, np.float32)

    def render(
        self,
        x: ArrayLike,
        y: ArrayLike,
        yaw: ArrayLike,
        image_index: int,
        out: np.ndarray | None = None,
        *,
        velocity: ArrayLike | None = None,
        flash: ArrayLike | None = None,
        ir: ArrayLike | None = None,
    ) -> np.ndarray:
        """Draw the blocks of one image.

        Parameters
        ----------
        x, y, yaw : array_like
            (n,) metres and radians.
        image_index : int
            Chooses the noise.
        out : ndarray, optional
            (h, w) uint8 to write into.
        velocity : array_like, optional
            (n, 3) m/s, m/s, rad/s: blurs over the exposure, centred on the pose.
        flash : array_like, optional
            (n,) white light of each block in 0..1 (0 when None).
        ir : array_like, optional
            (n,) infrared light of each block in 0..1 (1 when None).

        Returns
        -------
        ndarray
            (h, w) uint8.

        Examples
        --------
        >>> renderer = Renderer(n_blocks=1)
        >>> dark = renderer.render([0.0], [0.0], [0.0], 0, ir=[0.0])
        >>> bool(dark[400, 640] < 60)
        True
        """
        work = self._work
        kernels.restore(work, self._static, self._windows, self._dirty)
        poses = np.column_stack([np.asarray(c, float) for c in (x, y, yaw)])
        white = np.zeros(len(poses)) if flash is None else np.asarray(flash, float)
        on = np.ones(len(poses)) if ir is None else np.asarray(ir, float)
        n = self._draw_blocks(poses, velocity, white, on)
        n = self._cover(int(image_index), n)
        self._dirty = n
        if out is None:
            out = np.empty(work.shape, np.uint8)
        self._sensor.sense(work, int(image_index), out)
        return out

    def _cover(self, image_index: int, n: int) -> int:
        """Draw what occludes blocks (here nothing); return the number of windows, `n` so far."""
        return n

    def _draw_blocks(
        self, poses: np.ndarray, velocity: ArrayLike | None, white: np.ndarray, on: np.ndarray
    ) -> int:
        """Draw the blocks and the halos of their flashes; return how many windows they take."""
        placed, owner, weight = self._positions(poses, velocity)
        n = self._covers(self.corners_px(placed, owner), white, on, owner, weight)
        halo = _FLASH_HALO * (white * self._present[: len(poses)])
        if halo.any():
            centres = self.corners_px(poses).mean(axis=1)
            n = kernels.draw_halos(self._work, centres, halo, self._halo_px, self._windows, n)
        return n

    def _covers(
        self, corners: np.ndarray, white: np.ndarray, on: np.ndarray, *given: np.ndarray
    ) -> int:
        level, psf_px = self._levels(white, on), self.options.psf_px
        return kernels.draw_blocks(self._work, corners, level, psf_px, *given, self._windows)

    def _levels(self, white: np.ndarray, on: np.ndarray) -> np.ndarray:
        """Return the light (n,) that covers add, from their white and infrared LEDs."""
        glow = self.options.block_level - self.options.background
        return glow * on + _FLASH_LEVEL * white

    @property
    def light(self) -> np.ndarray:
        """The light (h, w) f4 of the last image, before the sensor; the next one overwrites it."""
        return self._work

    def corners_px(self, poses: np.ndarray, blocks: np.ndarray | None = None) -> np.ndarray:
        """Return image corners (n, 4, 2) of covers at `poses` (n, 3).

        Where the calibration knows their heights, each side is the line that its lower rim or its
        land makes in the image, whichever is further out, and the rim of a wall in sight stands as
        far out as its light on the sandpaper moves it (outline.SHINE_PX); blocks (n,) then says
        whose they are.
        """
        unit = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * self.table.block_side_m / 2
        c, s = elementary.cos(poses[:, 2]), elementary.sin(poses[:, 2])
        xy = np.stack(
            [
                poses[:, :1] + np.outer(c, unit[:, 0]) - np.outer(s, unit[:, 1]),
                poses[:, 1:2] + np.outer(s, unit[:, 0]) + np.outer(c, unit[:, 1]),
            ],
            axis=-1,
        )
        if self._land is None:
            return self.calibration.to_pixels(xy.reshape(-1, 2)).reshape(-1, 4, 2)
        lower, land = self._land
        land = land[np.arange(len(poses)) if blocks is None else blocks]
        ends = np.stack([xy, np.roll(xy, -1, axis=1)], axis=2)  # (n, side, end, 2)
        low, high = self._lifted(ends, np.full(land.shape, lower)), self._lifted(ends, land)
        along = low[:, :, 1] - low[:, :, 0]
        outwards = np.stack([along[..., 1], -along[..., 0]], axis=-1)
        middle = low.mean(axis=(1, 2))[:, None]
        outwards *= np.sign(((low.mean(axis=2) - middle) * outwards).sum(-1, keepdims=True))
        outwards /= elementary.hypot(outwards[..., :1], outwards[..., 1:])
        wall = -((high - low).mean(axis=2) * outwards).sum(-1, keepdims=True)  # px of it in sight
        lit = low + (outline.SHINE_PX * np.clip(wall, 0, 1) * outwards)[:, :, None]
        side = np.where(wall[..., None] < 0, high, lit)
        # a corner is where a side meets the one before it
        one, other = side, np.roll(side, 1, axis=1)
        u, v = one[:, :, 1] - one[:, :, 0], other[:, :, 1] - other[:, :, 0]
        gap = other[:, :, 0] - one[:, :, 0]
        t = (gap[..., 0] * v[..., 1] - gap[..., 1] * v[..., 0]) / (
            u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        )
        return one[:, :, 0] + t[..., None] * u

    def _lifted(self, xy: np.ndarray, height_m: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of places `xy` (..., 2), `height_m` (...) over the plane."""
        camera = self.calibration
        x, y = xy[..., :1], xy[..., 1:]
        h = camera.homography
        image = x * h[:, 0] + y * h[:, 1] + h[:, 2]
        image += height_m[..., None] * camera.upward()
        px = image[..., :2] / image[..., 2:]
        return camera.distort(px.reshape(-1, 2)).reshape(px.shape)

    def _positions(
        self, poses: np.ndarray, velocity: ArrayLike | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return poses (p, 3) at equal steps through the exposure, their block and share (p,).

        A place without a block has none.
        """
        there = self._present[: len(poses)]
        steps = there.astype(np.int64)
        if velocity is not None:
            velocity = np.asarray(velocity, float).reshape(-1, 3)
            speed = (
                elementary.hypot(velocity[:, 0], velocity[:, 1])
                + np.abs(velocity[:, 2]) * self.table.block_side_m * 0.71
            )
            path_px = speed * self.options.exposure_s * self.calibration.px_per_m()
            steps *= np.clip(np.ceil(path_px / _BLUR_STEP_PX), 1, _BLUR_STEPS).astype(np.int64)
        owner = np.repeat(np.arange(len(poses)), steps)
        if velocity is None:
            return poses[there], owner, np.ones(len(owner))
        step = np.arange(len(owner)) - np.repeat(np.cumsum(steps) - steps, steps)
        moment = ((step + 0.5) / steps[owner] - 0.5) * self.options.exposure_s
        return poses[owner] + velocity[owner] * moment[:, None], owner, 1.0 / steps[owner]


def _land_lines(calibration: Calibration) -> tuple[float, np.ndarray] | None:
    """Return heights over the plane, m: of the lower rims, and of the land (n, 4, 2).

    The land along a side is drawn as the straight line nearest to it, from end to end.
    """
    covers = calibration.covers
    if covers is None:
        return None
    heights = covers.over(calibration.cover_height_m)[:-1]
    at = np.linspace(-1, 1, heights.shape[2] - 1)
    mean = heights[..., 1:].mean(axis=2)
    slope = (heights[..., 1:] * at).sum(axis=-1) / (at * at).sum()
    return float(heights[0, 0, 0]), np.stack([mean - slope, mean + slope], axis=-1)
