# SPDX-License-Identifier: Apache-2.0
"""What spoils the virtual camera's image, in levels from clean to brutal."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import exp
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render import kernels
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions

_SLOT_S = 3.0  # one visit of one arm
_FLASH_SLOT_S = 0.5
_ARM_RADIUS_M = 0.040
_MORE_ARMS_LEVEL = 80.0  # grey of arms that are asked for
_HAND_RADIUS_M = 0.055
_COVER_LEVEL = 170.0  # grey levels of a cover, of which specks are a share


@dataclass(frozen=True)
class ClutterLevel:
    """One level of clutter; intensities in grey levels of 255, lengths in px of a 45.8 px block."""

    arms: int = 0  # arms that may reach in at once
    arm_share: float = 0.0  # share of the time that each of them does
    arm_level: tuple[float, float] = (50.0, 110.0)
    reflections: int = 0  # lamps mirrored by the platform
    reflection_level: tuple[float, float] = (40.0, 120.0)
    reflection_px: tuple[float, float] = (5.0, 16.0)
    lights: int = 0  # lamps and their mirrors on the floor, beside the platform
    light_level: tuple[float, float] = (100.0, 230.0)
    light_px: tuple[float, float] = (10.0, 18.0)
    hot_pixels: int = 0
    glints: int = 0  # grains of the platform's sandpaper that mirror the light
    specks: int = 0  # bright and dark points on each cover
    glint_level: tuple[float, float] = (40.0, 250.0)  # of both: many faint ones, few bright ones
    gradient: float = 0.0  # ambient light across the image
    vignette: float = 0.0  # loss of light in the corners
    core: float = 0.0  # the LED seen through the cover; saturates
    core_px: float = 6.0
    texture: float = 0.0  # terrain on the covers, relative
    texture_px: float = 3.0  # how fine it is; a lens in focus shows nothing below 1.2
    flash_share: float = 0.0  # share of block-slots with a white flash
    weak: int = 0  # blocks with a tired battery
    weak_level: float = 1.0
    k1: float = 0.0  # lens distortion at unit focal length
    tilt_rad: float = 0.0  # camera axis against the table's normal


LEVELS = {
    'clean': ClutterLevel(),
    'ordinary': ClutterLevel(
        arms=1,
        arm_share=0.5,
        reflections=2,
        reflection_level=(30, 70),
        hot_pixels=10,
        gradient=10,
        vignette=0.15,
        core=90,
        texture=0.06,
        flash_share=0.03,
        weak=1,
        weak_level=0.8,
        k1=-0.08,
        tilt_rad=np.radians(2),
    ),
    'hard': ClutterLevel(
        arms=3,
        arm_share=0.6,
        reflections=5,
        reflection_level=(60, 150),
        hot_pixels=60,
        gradient=25,
        vignette=0.30,
        core=160,
        core_px=7,
        texture=0.15,
        flash_share=0.08,
        weak=3,
        weak_level=0.6,
        k1=-0.12,
        tilt_rad=np.radians(4),
    ),
    'brutal': ClutterLevel(
        arms=4,
        arm_share=0.8,
        arm_level=(60, 140),
        reflections=10,
        reflection_level=(80, 230),
        reflection_px=(5, 22),
        hot_pixels=300,
        gradient=40,
        vignette=0.45,
        core=230,
        core_px=9,
        texture=0.25,
        flash_share=0.15,
        weak=6,
        weak_level=0.4,
        k1=-0.16,
        tilt_rad=np.radians(7),
    ),
}
# hard, on new sandpaper whose grains mirror the lamps, and with lamps beside the platform
LEVELS['glittering'] = dataclasses.replace(
    LEVELS['hard'], glints=8000, specks=20, texture_px=1.2, lights=8
)


def clutter_calibration(level: str, width: int = 1280, height: int = 800) -> Calibration:
    """Return the camera of a clutter level: the ideal one, tilted and with a real lens."""
    ideal = Calibration.ideal(width, height)
    chosen = LEVELS[level]
    if not chosen.tilt_rad and not chosen.k1:
        return ideal
    focal = ideal.camera_matrix[0, 0]
    distance = focal / ideal.px_per_m()
    a = chosen.tilt_rad
    turn = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    # table point (x, y) in the camera's axes: x right, y down, z away from the camera
    columns = np.column_stack([turn @ [1, 0, 0], turn @ [0, -1, 0], [0, 0, distance]])
    homography = ideal.camera_matrix @ columns
    # a shrinking lens (k1 < 0) leaves room, a tilted one needs it: keep the scale at the centre
    return dataclasses.replace(
        ideal,
        homography=homography / homography[2, 2],
        distortion_coefficients=np.array([chosen.k1, 0, 0, 0, 0.0]),
    )


class Clutter:
    """The static image of one clutter level, and what moves in it as the image index grows.

    Args:
        level: a level, or its name in LEVELS.
        calibration: the camera and its table: arms scale with it, glints lie on its platform.
        background: grey level of the empty platform.
        seed: of everything drawn by chance.
        n_blocks: how many blocks there are.
        rate_hz: images a second, which turns an image index into a time.
    """

    def __init__(
        self,
        level: str | ClutterLevel,
        calibration: Calibration,
        background: float,
        seed: int,
        n_blocks: int,
        rate_hz: float,
    ):
        self.level = chosen = LEVELS[level] if isinstance(level, str) else level
        self.calibration, self.table = calibration, calibration.table
        self.seed, self.n_blocks, self.rate_hz = seed, n_blocks, rate_hz
        self.scale_px = calibration.px_per_m() * calibration.table.block_side_m / 45.8
        rng = np.random.default_rng([seed, 1])
        shape = (calibration.image_height, calibration.image_width)
        v, u = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float32)
        x = 2 * u / (shape[1] - 1) - 1
        y = 2 * v / (shape[0] - 1) - 1
        self.vignette = (1 - chosen.vignette * (x * x + y * y) / 2).astype(np.float32)
        heading = rng.uniform(0, 2 * np.pi)
        slope = chosen.gradient / 2 * (np.cos(heading) * x + np.sin(heading) * y)
        platform = (self.vignette * np.maximum(background + slope, 2.0)).astype(np.float32)
        if chosen.texture:
            platform *= 1 + 0.5 * chosen.texture * _speckle(rng, shape, 2.0 * self.scale_px)
        self.static = platform
        self._beside(np.random.default_rng([seed, 6]), u, v)
        self.glints = self._glints(np.random.default_rng([seed, 4]), shape)
        if len(self.glints):
            self.static += self.glints
        for _ in range(chosen.reflections):
            place = rng.uniform([0, 0], [shape[1], shape[0]])
            self._lamp(rng, u, v, place, chosen.reflection_px, chosen.reflection_level)
        hot = rng.integers(0, shape[0] * shape[1], chosen.hot_pixels)
        self.static.reshape(-1)[hot] += rng.uniform(60, 255, len(hot)).astype(np.float32)
        side = 48 if chosen.texture else 0
        self.texture = np.zeros((n_blocks, side, side), np.float32)
        for tile in self.texture[: n_blocks if side else 0]:
            tile += chosen.texture * _speckle(rng, tile.shape, chosen.texture_px)
        rng = np.random.default_rng([seed, 5])
        for tile in self.texture if chosen.specks else ():
            signs = rng.choice([-1.0, 1.0], chosen.specks)
            tile += (
                _points(
                    tile.shape,
                    rng.integers(0, side, (chosen.specks, 2)),
                    signs * self._levels(rng, chosen.specks),
                    1.2,
                )
                / _COVER_LEVEL
            )
        self.battery = np.ones(n_blocks)
        self.battery[rng.permutation(n_blocks)[: chosen.weak]] = chosen.weak_level

    def _lamp(
        self,
        rng: np.random.Generator,
        u: np.ndarray,
        v: np.ndarray,
        place: np.ndarray,
        sizes: tuple[float, float],
        levels: tuple[float, float],
    ) -> None:
        """Add the soft light of a lamp at `place` px, of a size and level between those given."""
        wide, narrow = np.sort(rng.uniform(*sizes, 2))[::-1] * self.scale_px
        turn = rng.uniform(0, np.pi)
        a = (u - place[0]) * np.cos(turn) + (v - place[1]) * np.sin(turn)
        b = (v - place[1]) * np.cos(turn) - (u - place[0]) * np.sin(turn)
        self.static += rng.uniform(*levels) * np.exp(-0.5 * ((a / wide) ** 2 + (b / narrow) ** 2))

    def _beside(self, rng: np.random.Generator, u: np.ndarray, v: np.ndarray) -> None:
        """Add lamps that stand in the image, but not on the platform."""
        level, missing = self.level, self.level.lights
        edge, end = 0.55 * np.array(self.table.platform_m), [u.shape[1], u.shape[0]]
        if missing and not (np.abs(self.calibration.to_table([[0, 0], end])) > edge).any():
            return  # nothing else is in the image
        while missing:
            place = rng.uniform([0, 0], end)
            if (np.abs(self.calibration.to_table(place[None])[0]) > edge).any():
                self._lamp(rng, u, v, place, level.light_px, level.light_level)
                missing -= 1

    def _levels(self, rng: np.random.Generator, n: int) -> np.ndarray:
        low, high = self.level.glint_level
        return low * (high / low) ** rng.random(n)

    def _glints(self, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
        """Return the light (h, w) of the platform's grains, which covers hide; (0, 0) for none."""
        n = self.level.glints
        if not n:
            return np.zeros((0, 0), np.float32)
        place = self.calibration.to_pixels(rng.uniform(-0.5, 0.5, (n, 2)) * self.table.platform_m)
        cells = np.rint(place[:, ::-1]).astype(int)
        inside = ((cells >= 0) & (cells < shape)).all(axis=1)
        return _points(shape, cells[inside], self._levels(rng, n)[inside], 1.2)

    def arms(self, image_index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return capsules (k, 5): x0, y0, x1, y1, radius in metres, and their grey levels (k,)."""
        time_s = image_index / self.rate_hz
        found, levels = [], []
        rim, platform = (  # their sizes over those of the paper
            np.divide(mine, paper)
            for mine, paper in (
                (self.table.rim_m(), Table().rim_m()),
                (self.table.platform_m, Table().platform_m),
            )
        )
        for arm in range(self.level.arms):
            slot, phase = divmod(time_s / _SLOT_S + arm / max(self.level.arms, 1), 1.0)
            rng = np.random.default_rng([self.seed, 2, arm, int(slot)])
            if rng.random() >= self.level.arm_share:
                continue
            side = rng.uniform(0, 2 * np.pi)
            goal = rng.uniform(-0.40, 0.40, 2) * rim
            sway = rng.uniform(0.02, 0.10) * np.sin(
                2 * np.pi * rng.uniform(1, 3) * phase + np.array([0, np.pi / 2])
            )
            grey = rng.uniform(*self.level.arm_level)
            shoulder = 1.25 * platform * [np.cos(side), np.sin(side)]
            reach = min(phase, 1 - phase) / 0.25
            reach = 1.0 if reach > 1 else reach * reach * (3 - 2 * reach)
            hand = shoulder + reach * (goal + sway - shoulder)
            wrist = hand + 0.10 * (shoulder - hand) / max(np.hypot(*(shoulder - hand)), 1e-6)
            found += [[*shoulder, *wrist, _ARM_RADIUS_M], [*wrist, *hand, _HAND_RADIUS_M]]
            levels += [grey, grey * 1.1]
        return np.reshape(found, (-1, 5)), np.array(levels)

    def arms_and(self, more: ArrayLike | None, image_index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return those of `arms` and capsules `more` beside them, and all grey levels.

        more: (k, 5), or (k, 6) with grey levels of their own.
        """
        capsules, grey = self.arms(image_index)
        added = np.zeros((0, 5)) if more is None else np.asarray(more, float)
        levels = added[:, 5] if added.shape[1] > 5 else np.full(len(added), _MORE_ARMS_LEVEL)
        return np.concatenate([capsules, added[:, :5]]), np.concatenate([grey, levels])

    def flashes(self, image_index: int) -> np.ndarray:
        """Return the white light of each block, (n,) in 0..1, that decays after a random start."""
        white = np.zeros(self.n_blocks)
        if not self.level.flash_share:
            return white
        place = image_index / self.rate_hz / _FLASH_SLOT_S
        slot = int(place)
        rng = np.random.default_rng([self.seed, 3, slot])
        lit = rng.random(self.n_blocks) < self.level.flash_share
        white[lit] = np.exp(-(place - slot) * _FLASH_SLOT_S / 0.12)
        return white

    def hidden_share(
        self, x: np.ndarray, y: np.ndarray, yaw: np.ndarray, arms: np.ndarray, side_m: float
    ) -> np.ndarray:
        """Return the share (n,) of each block's area under `arms` (k, 5), from 16 x 16 points."""
        grid = (np.arange(16) - 7.5) / 16 * side_m
        gx, gy = (g.ravel() for g in np.meshgrid(grid, grid))
        c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        px = np.asarray(x)[:, None] + c * gx - s * gy
        py = np.asarray(y)[:, None] + s * gx + c * gy
        hidden = np.zeros(px.shape, bool)
        for x0, y0, x1, y1, radius in arms:
            dx, dy = x1 - x0, y1 - y0
            t = np.clip(((px - x0) * dx + (py - y0) * dy) / max(dx * dx + dy * dy, 1e-12), 0, 1)
            hidden |= (px - x0 - t * dx) ** 2 + (py - y0 - t * dy) ** 2 < radius**2
        return hidden.mean(axis=1)


def _points(
    shape: tuple[int, int], cells: np.ndarray, levels: np.ndarray, sigma_px: float
) -> np.ndarray:
    """Return points of light as a lens shows them: spots of `sigma_px` that reach `levels`."""
    light = np.zeros(shape, np.float32)
    np.add.at(light, tuple(cells.T), levels)
    spot = cv2.getGaussianKernel(9, sigma_px, cv2.CV_32F)
    return cv2.sepFilter2D(light, cv2.CV_32F, spot, spot) / np.max(spot) ** 2


def _speckle(rng: np.random.Generator, shape: tuple[int, int], grain_px: float) -> np.ndarray:
    """Return smooth noise of unit standard deviation with structures of `grain_px`."""
    rough = rng.standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), grain_px)
    return smooth / smooth.std()


@njit(inline='always', fastmath=True)
def _grain(tile, x, y):
    """Return `tile` (T, T) at x, y in 0..1, bilinear."""
    size = tile.shape[0] - 1
    tu = min(max(x * size, 0.0), size - 0.001)
    tv = min(max(y * size, 0.0), size - 0.001)
    iu, iv = int(tu), int(tv)
    fu, fv = tu - iu, tv - iv
    return (1 - fv) * ((1 - fu) * tile[iv, iu] + fu * tile[iv, iu + 1]) + fv * (
        (1 - fu) * tile[iv + 1, iu] + fu * tile[iv + 1, iu + 1]
    )


@njit(cache=True, fastmath=True, error_model='numpy')
def draw_covers(
    work,
    vignette,
    glints,
    corners,
    level,
    core,
    core_px,
    texture,
    psf_px,
    owner,
    weight,
    windows,
):
    """Add covers as `kernels.draw_blocks` does; they hide `glints` (h, w), which `work` contains.

    glints may be (0, 0). Per block: level, core (k,), texture (k, T, T) relative, or (0, 0, 0) for
    smooth covers.
    """
    size, glitters = texture.shape[1], glints.shape[0] > 0
    blur = math.sqrt(psf_px * psf_px + 1.0 / 12.0)
    nx = np.empty(4)
    ny = np.empty(4)
    at = np.empty(4)
    inwards = np.empty(4)
    across = np.empty(work.shape[1], np.float32)
    cover = np.empty(work.shape[1], np.float32)
    for p in range(corners.shape[0]):
        b = owner[p]
        cu, cv = kernels.placed(work, corners[p], blur, nx, ny, inwards, windows, p)
        r0, r1, c0, c1 = windows[p]
        share, shine, lit = np.float32(weight[p]), np.float32(level[b]), core[b] > 0
        for i in range(c1 - c0):
            x = (c0 + i - cu) / core_px
            across[i] = core[b] * exp(-0.5 * x * x) if lit else 0.0
        for r in range(r0, r1):
            for k in range(4):
                at[k] = inwards[k] + nx[k] * (c0 - cu) + ny[k] * (r - cv)
            begin, end = kernels.covered(cover, nx, at, blur, c1 - c0)
            width = end - begin
            row, fall = work[r, c0 + begin : c0 + end], vignette[r, c0 + begin : c0 + end]
            down = np.float32(exp(-0.5 * ((r - cv) / core_px) ** 2)) if lit else np.float32(0.0)
            beam = across[begin:end]
            for i in range(width):
                row[i] += share * cover[i] * fall[i] * (shine + down * beam[i])
            if size > 0:
                for i in range(width):
                    a0, a1 = at[0] + nx[0] * (begin + i), at[1] + nx[1] * (begin + i)
                    a2, a3 = at[2] + nx[2] * (begin + i), at[3] + nx[3] * (begin + i)
                    grain = _grain(texture[b], a0 / (a0 + a2), a1 / (a1 + a3))
                    row[i] += share * cover[i] * fall[i] * shine * np.float32(grain)
            if glitters:
                hidden = glints[r, c0 + begin : c0 + end]
                for i in range(width):
                    row[i] -= share * cover[i] * hidden[i]
    return corners.shape[0]


@njit(cache=True, fastmath=True, error_model='numpy')
def draw_arms(work, vignette, arms, level, psf_px, windows, n):
    """Cover `work` with capsules `arms` (k, 5), u0, v0, u1, v1, radius px; return the windows."""
    blur = max(psf_px, 1.0)
    for a in range(arms.shape[0]):
        u0, v0, u1, v1, radius = arms[a]
        pad = radius + 4.5 * blur
        kernels._window(
            windows,
            n,
            work.shape,
            min(u0, u1) - pad,
            max(u0, u1) + pad,
            min(v0, v1) - pad,
            max(v0, v1) + pad,
        )
        r0, r1, c0, c1 = windows[n]
        n += 1
        du, dv = u1 - u0, v1 - v0
        length2 = max(du * du + dv * dv, 1e-9)
        outer = (radius + 4.5 * blur) ** 2
        beside = outer * length2
        for r in range(r0, r1):
            for c in range(c0, c1):
                aside = (c - u0) * dv - (r - v0) * du
                if aside * aside > beside:
                    continue
                t = ((c - u0) * du + (r - v0) * dv) / length2
                t = min(max(t, 0.0), 1.0)
                d2 = (c - u0 - t * du) ** 2 + (r - v0 - t * dv) ** 2
                if d2 >= outer:
                    continue
                cover = kernels._phi(np.float32((radius - math.sqrt(d2)) / blur))
                shade = level[a] * (1.0 - 0.5 * min(d2 / (radius * radius), 1.0)) * vignette[r, c]
                work[r, c] += cover * (shade - work[r, c])
    return n


class Cluttered(Renderer):
    """A renderer that draws clutter of a level, and arms."""

    def __init__(
        self,
        level: str | ClutterLevel = 'clean',
        calibration: Calibration | None = None,
        seed: int = 0,
        n_blocks: int | None = None,
        rate_hz: float = 60.0,
        **options: Any,
    ):
        self._level, self._seed, self._rate_hz = level, seed, rate_hz
        self._more: ArrayLike | None = None
        super().__init__(RenderOptions(**options), calibration, seed, n_blocks)
        self._windows = np.concatenate([self._windows, np.zeros((64, 4), np.int64)])

    def _platform(self) -> np.ndarray:
        options = self.options
        self.scenery = Clutter(
            self._level,
            self.calibration,
            options.background,
            self._seed,
            self.n_blocks,
            self._rate_hz,
        )
        return self.scenery.static

    def _covers(
        self, corners: np.ndarray, white: np.ndarray, on: np.ndarray, *given: np.ndarray
    ) -> int:
        scenery = self.scenery
        return draw_covers(
            self._work,
            scenery.vignette,
            scenery.glints,
            corners,
            self._levels(white, on),
            scenery.level.core * on,
            scenery.level.core_px * scenery.scale_px,
            scenery.texture,
            self.options.psf_px,
            *given,
            self._windows,
        )

    def render(
        self,
        x: ArrayLike,
        y: ArrayLike,
        yaw: ArrayLike,
        image_index: int,
        *out: np.ndarray | None,
        flash: ArrayLike | None = None,
        ir: ArrayLike | None = None,
        arms: ArrayLike | None = None,
        **more: Any,
    ) -> np.ndarray:
        """Draw as `Renderer` does; the level flashes blocks if `flash` is None.

        arms: (k, 5) capsules x0, y0, x1, y1, radius in metres, besides those of the level; (k, 6)
        with their grey levels.
        """
        self._more = arms
        flash = self.scenery.flashes(image_index) if flash is None else flash
        ir = self.scenery.battery * (1.0 if ir is None else np.asarray(ir, float))
        return super().render(x, y, yaw, image_index, *out, flash=flash, ir=ir, **more)

    def _cover(self, image_index: int, n: int) -> int:
        capsules, grey = self.scenery.arms_and(self._more, image_index)
        if not len(capsules):
            return n
        ends = self.calibration.to_pixels(capsules[:, :4].reshape(-1, 2)).reshape(-1, 4)
        arms = np.hstack([ends, capsules[:, 4:] * self.calibration.px_per_m()])
        vignette, psf_px = self.scenery.vignette, self.options.psf_px
        return draw_arms(self._work, vignette, arms, grey, psf_px, self._windows, n)

    def visible_share(
        self,
        x: ArrayLike,
        y: ArrayLike,
        yaw: ArrayLike,
        image_index: int,
        arms: ArrayLike | None = None,
    ) -> np.ndarray:
        """Return the true share (n,) of each cover that no arm hides in this image."""
        capsules, _ = self.scenery.arms_and(arms, image_index)
        side_m = self.table.block_side_m
        return 1.0 - self.scenery.hidden_share(x, y, np.asarray(yaw, float), capsules, side_m)
