# SPDX-License-Identifier: Apache-2.0
"""Solve a calibration from the blocks themselves, from known points, or from a ChArUco board.

Each way ends in a `Solution`: the calibration, what it could not explain, and how far off it may be
at the platform's corners. A poor one is refused, with the reason.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from eol_ros.core.compiled import read_only
from eol_ros.core.table import Table
from eol_ros.core.verdict import Verdict, judged, worst
from eol_ros.core.vision import outline
from eol_ros.core.vision.appearance.squares import find_squares
from eol_ros.core.vision.calibration.corners import corners
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.falling_light import NEAR_SHINE_PX, side_sigma
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.image_health import Watch
from eol_ros.errors import ConfigError
from eol_ros.said import clauses, said

REST_SIGMA_M = 0.004  # friction leaves blocks this far from the lattice when all is still
MOST_PX = 0.5  # RMS residual, per axis, above which a calibration is refused
GOOD_PX = 0.26  # two standard deviations of the corners of lit covers, _RELIEF_SIGMA_PX
GOOD_MM = 1.0  # RMS over the platform (docs/explanation/vision_measured.md)
MOST_CORNER_MM = 8.0  # and the standard deviation at a corner of the platform
LENS_GAIN = 25.0  # of the misfit, for each number of the lens: five standard deviations
_RELIEF_ROUNDS = 3
CORNER_SIGMA_PX = 0.05
_RELIEF_SIGMA_PX = 0.13  # of lit covers' corners: each side is found 0.1 px more or less far out
_STEP = 1e-6  # of finite differences, in the solver's own units
_FRAME_SIGMA = 1e-4  # m and rad: the frame is the mean of the rim's places, by definition
_SQUARE_SIGMA = 1e-4  # of a camera's pixels
# How well its focal length is known, and where its axis meets the sensor, in focal lengths. From
# there on a camera that leans by 5 degrees says less of its plane than 75 covers do.
_CAMERA_SIGMA = np.array([0.1, 0.01, 0.01])
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
_SQUARE = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])
_WHOLE_SHARE = 0.8  # of the blocks: whole covers that are needed in all


@dataclass(frozen=True)
class Solution:
    """A calibration with its evidence.

    Args:
        calibration: with residual_px and residual_mm, RMS per axis.
        px, rest_px: (n, 2) measured points and what is left of them, px.
        names: (n,) what each point is.
        corner_mm: (4,) standard deviation at the platform's corners; NaN where nothing tells.
        platform_mm: expected error, RMS over the platform, where the frame lies left out.
        note: what a person should know of a calibration that is good.
        lens: how many of the lens's k1, k2 were solved for.
        misfit: sum of squared residuals in standard deviations, of all that was fitted.
    """

    calibration: Calibration
    px: np.ndarray
    rest_px: np.ndarray
    names: list[str]
    corner_mm: np.ndarray
    platform_mm: float = float('nan')
    note: str = ''
    lens: int = 0
    misfit: float = 0.0

    def by_name(self) -> dict[str, tuple[float, float]]:
        """Return RMS residual per axis in px and mm of each named thing."""
        scale = self.calibration.px_per_m() / 1e3
        found = {}
        for name in dict.fromkeys(self.names):
            mine = self.rest_px[[n == name for n in self.names]]
            rms = float(np.sqrt((mine**2).mean()))
            found[name] = (rms, rms / scale)
        return found

    def verdict(self) -> Verdict:
        """Return whether the calibration is good enough; what is refused is poor."""
        if refused := self.refusal():
            return Verdict('poor', refused.partition(': ')[0], refused.partition(': ')[2])
        more = 'take three images with the table stirred in between, or points further out'
        if not np.isfinite(self.corner_mm).any():
            return Verdict('usable', 'four points fit any table', 'give five points or more')
        found = [
            judged(
                'residual', self.calibration.residual_px, 'px', (GOOD_PX, MOST_PX),
                'light moves the corners of covers by 0.13 px', 'take a sharp, still image',
            ),
            judged(
                "platform's corners", float(np.nanmax(self.corner_mm)), 'mm',
                (1e3 * REST_SIGMA_M, MOST_CORNER_MM),
                'friction leaves blocks 4 mm off their places', more,
            ),
        ]  # fmt: skip
        if np.isfinite(self.platform_mm):
            found.append(
                judged(
                    'places on the platform', self.platform_mm, 'mm', (GOOD_MM, MOST_CORNER_MM),
                    'what this way reaches from three images', more,
                )
            )  # fmt: skip
        return worst(found)

    def refusal(self) -> str:
        """Return why this calibration must not be used, or an empty string."""
        done = self.calibration
        if not done.residual_px <= MOST_PX:
            worst = max(self.by_name().items(), key=lambda item: item[1][0])
            return (
                f'residual {done.residual_px:.2f} px ({done.residual_mm:.2f} mm) is above '
                f'{MOST_PX} px; worst is {worst[0]} with {worst[1][0]:.2f} px: check '
                'that it is what it is taken for, and that the image is sharp and still'
            )
        if np.nanmax(self.corner_mm, initial=0.0) > MOST_CORNER_MM:
            return (
                'the corners of the platform are only known to '
                f'{np.nanmax(self.corner_mm):.1f} mm (at most {MOST_CORNER_MM:.0f}): '
                'use more points or images, further out; of blocks take three images with the '
                'table stirred in between, and name printed covers with --covers'
            )
        return ''


def platform_corners(table: Table) -> np.ndarray:
    """Return the corners (4, 2) of the platform in m, counter-clockwise from the front left."""
    return _CORNERS * np.array(table.platform_m) / 2


def nominal(
    width: int, height: int, focal_px: float | None = None, table: Table | None = None
) -> Calibration:
    """Return a pinhole camera of this image size above a table, with nothing else known."""
    ideal = Calibration.ideal(width, height, table=table)
    if focal_px is None:
        return ideal
    camera = ideal.camera_matrix.copy()
    camera[0, 0] = camera[1, 1] = focal_px
    return replace(ideal, camera_matrix=camera)


def from_blocks(
    views: list[tuple[np.ndarray, np.ndarray]],
    start: Calibration,
    cover_height_m: float = 0.0,
    rest_sigma_m: float = REST_SIGMA_M,
    lens: int = 2,
    side_sigma: float = 0.0,
    corner_sigma_px: float = CORNER_SIGMA_PX,
    relief: tuple[Calibration, Callable[[Calibration], np.ndarray]] | None = None,
) -> Solution:
    """Calibrate on the blocks: squares of a known side near their places on their lattice.

    Bundle adjustment (Triggs et al. 2000): homography, lens (k1, k2) and the pose of every block in
    every view are solved together from the corners of the covers. The squares give the lengths; the
    lattice, with `rest_sigma_m` of freedom, gives the frame. Between views the rim may have been
    pushed and turned: each has a rim pose of its own; the table's origin and axes are their mean.
    The camera's pixels are square, so it sees a plane's axes at right angles and equally long, as
    far as its focal length and axis are known.

    Args:
        views: per image the ids (n,) and the corners (n, 4, 2) px (see corners.corners). Ids
            that run to the left, as seen in a mirror, give a calibration with a mirror.
        start: image size, camera matrix and table.
        lens: how many of k1 and k2 to solve for; the others stay as in `start`.
        side_sigma: share by which all sides together may seem longer than they are, as light falls
            towards them (falling_light). The lattice then has a say in the lengths. 0: not at all.
        corner_sigma_px: standard deviation of a corner.
        relief: the camera that the outlines of covers were found with, and how far (m, 4, 2) px
            corners of all views stand beside those of flat covers under any camera: covers of known
            heights look the wider, the further they are from the point below it.

    Raises:
        ConfigError: fewer whole covers in all than four fifths of the blocks.
    """
    bundle = _Bundle(views, start, lens, (rest_sigma_m, side_sigma, corner_sigma_px))
    if relief is not None:
        bundle.lean(*relief)
    done = least_squares(
        bundle.rests, bundle.x0, bundle.slopes, method='lm', x_scale='jac', max_nfev=60
    )
    n = len(bundle.ids)
    left = (done.fun[: 8 * n] * corner_sigma_px).reshape(n, 4, 2).reshape(-1, 2)
    corner_mm, platform_mm = _sigmas(done, bundle.camera, bundle.n_camera, 1.0)
    return Solution(
        _judged(
            replace(bundle.camera(done.x), cover_height_m=cover_height_m), left,
            (10 * n - len(bundle.x0) + len(_CAMERA_SIGMA)) / (8 * n),
        ),
        bundle.corners.reshape(-1, 2), left, [f'block {i}' for i in bundle.ids for _ in range(4)],
        corner_mm, platform_mm, lens=lens, misfit=2 * float(done.cost),
    )  # fmt: skip


class _Bundle:
    """What the bundle adjustment solves for, x: the camera, places of the rim, poses of covers.

    Of the n covers of all views that show all four sides: ids (n,), corners (n, 4, 2) px in the
    order of the table's. `x0` is where it starts.

    Raises:
        ConfigError: fewer whole covers in all than four fifths of the blocks.
    """

    def __init__(
        self,
        views: list[tuple[np.ndarray, np.ndarray]],
        start: Calibration,
        n_lens: int,
        sigmas: tuple[float, float, float],
    ):
        ids = np.concatenate([np.asarray(i) for i, _ in views])
        corners = np.concatenate([c for _, c in views])
        view = np.repeat(np.arange(len(views)), [len(i) for i, _ in views])
        self._whole = whole = np.isfinite(corners).all(axis=(1, 2))
        least = math.ceil(_WHOLE_SHARE * start.table.count)
        if whole.sum() < least:
            raise ConfigError(said('few_covers', count=int(whole.sum()), least=least))
        self.ids, corners = ids[whole], corners[whole]
        self._rest = rest = start.table.rest[self.ids]
        self._view = view = np.unique(view[whole], return_inverse=True)[1]
        flat = start.undistort(corners.mean(axis=1))
        rims = _rim_places(rest, flat, view)
        first, _ = cv2.findHomography(_pushed(rest, rims[view]), flat)
        there = replace(start, homography=first)
        # round the square, as the table has it
        self._turn = [1, 0, 3, 2] if there.mirrored else [0, 1, 2, 3]
        self.corners = corners = corners[:, self._turn]
        # poses of the covers under that homography
        table = there.to_table(corners.reshape(-1, 2)).reshape(-1, 4, 2)
        side = table[:, 0] - table[:, 3] + table[:, 1] - table[:, 2]
        poses = np.column_stack([table.mean(axis=1), np.arctan2(side[:, 1], side[:, 0])])
        self._start, self._sigmas = start, sigmas  # of a place at rest, of sides, of corners
        self._scale = np.abs(first.ravel()[:8]) + 1e-3 * np.abs(first).max() * np.array(
            [1, 1, 1, 1, 1, 1, 1e-3, 1e-3]
        )
        self._n_lens, self._n_known = n_lens, 8 + n_lens + (sigmas[1] > 0)
        self.n_camera = self._n_known + len(_CAMERA_SIGMA)  # with what is known of it
        self._n_rim = 3 * len(rims) if len(rims) > 1 else 0  # of one view the rim is the frame
        self._n_shared = self.n_camera + self._n_rim
        self._leads = np.zeros((8 + n_lens, *corners.shape))  # of relief, by each of the camera's
        self.x0 = np.concatenate(
            [
                first.ravel()[:8] / first[2, 2] / self._scale,
                start.distortion_coefficients[:n_lens],
                np.zeros(self.n_camera - 8 - n_lens),
                rims.ravel()[: self._n_rim],
                poses.ravel(),
            ]
        )

    def lean(self, known: Calibration, beside: Callable[[Calibration], np.ndarray]) -> None:
        """Begin with a known camera, and let corners move as relief does (see `from_blocks`)."""
        n_lens, x0 = self._n_lens, self.x0
        homography = known.homography / known.homography[2, 2]
        x0[:8] = homography.ravel()[:8] / self._scale
        x0[8 : 8 + n_lens] = known.distortion_coefficients[:n_lens]
        steps = np.full(8 + n_lens, 0.01)
        steps[6:8] = 0.003 / self._scale[6:]
        for k, step in enumerate(np.diag(steps)):
            ahead, back = (beside(self.camera(x0[: 8 + n_lens] + d)) for d in (step, -step))
            self._leads[k] = ((ahead - back) / (2 * steps[k]))[self._whole][:, self._turn]

    def camera(self, x: np.ndarray) -> Calibration:
        """Return the camera of x."""
        n_lens = self._n_lens
        h = np.append(x[:8] * self._scale, 1.0).reshape(3, 3)
        k = np.array([*x[8 : 8 + n_lens], *self._start.distortion_coefficients[n_lens:]])
        return replace(self._start, homography=h, distortion_coefficients=k)

    def rests(self, x: np.ndarray) -> np.ndarray:
        """Return what x leaves of everything measured and known, in standard deviations."""
        rest_sigma_m, side_sigma, corner_sigma_px = self._sigmas
        n_lens = self._n_lens
        pose, longer = x[self._n_shared :].reshape(-1, 3), x[8 + n_lens : self._n_known]
        known = x[self._n_known : self.n_camera]
        rim = x[self.n_camera : self._n_shared].reshape(-1, 3)
        side_m = self._start.table.block_side_m * (1 + longer.sum())
        covers = _cover_corners(pose, side_m).reshape(-1, 2)
        seen = self.camera(x).to_pixels(covers).reshape(-1, 4, 2)
        seen += np.tensordot(x[: 8 + n_lens] - self.x0[: 8 + n_lens], self._leads, 1)
        place = _pushed(self._rest, rim[self._view]) if self._n_rim else self._rest
        return np.concatenate(
            [
                ((seen - self.corners) / corner_sigma_px).ravel(),
                ((pose[:, :2] - place) / rest_sigma_m).ravel(),
                longer / (side_sigma or 1.0),
                known / _CAMERA_SIGMA,
                _oblong(self.camera(x), known) / _SQUARE_SIGMA,
                rim.sum(axis=0) / _FRAME_SIGMA if self._n_rim else [],
            ]
        )

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Return the Jacobian: a cover's pose moves nothing but its own corners."""
        n = len(self.ids)
        base, cover = self.rests(x), np.arange(n)
        found = np.zeros((len(base), len(x)))
        for k in range(self._n_shared):
            there = x.copy()
            there[k] += _STEP
            found[:, k] = (self.rests(there) - base) / _STEP
        for k in range(3):
            there = x.copy()
            there[self._n_shared + k :: 3] += _STEP
            moved = (self.rests(there) - base) / _STEP
            for begin, size in ((0, 8), (8 * n, 2)):  # its corners, its place on the lattice
                rows = begin + size * cover[:, None] + np.arange(size)
                found[rows, (self._n_shared + 3 * cover + k)[:, None]] = moved[rows]
        return found


def _oblong(camera: Calibration, off: np.ndarray) -> np.ndarray:
    """Return how far (2,) the table's axes are from right angles and from equal lengths.

    off (3,): share by which the focal length is longer, and its axis further right and down, than
    `camera` says. A plane that a camera with square pixels sees has neither (Zhang 2000).
    """
    matrix = camera.camera_matrix.copy()
    matrix[:2, 2] += off[1:] * matrix[0, 0]
    matrix[[0, 1], [0, 1]] *= 1 + off[0]
    x, y = (np.linalg.inv(matrix) @ camera.homography).T[:2]
    wide, long = np.linalg.norm(x), np.linalg.norm(y)
    return np.array([x @ y / (wide * long), np.log(wide / long)])


def _pushed(xy: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Return points (n, 2) of a rim at rest where that rim at x, y, yaw (n, 3) takes them."""
    c, s = np.cos(rim[:, 2]), np.sin(rim[:, 2])
    x, y = xy.T
    return np.column_stack([rim[:, 0] + c * x - s * y, rim[:, 1] + s * x + c * y])


def _rim_places(rest: np.ndarray, flat: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Return about where the rim stands in each view, (m, 3) x, y, yaw with a mean of zero.

    rest (n, 2): of the blocks, flat (n, 2): undistorted pixels, view (n,): of 0 to m - 1.
    """
    most = view == np.argmax(np.bincount(view))
    there, _ = cv2.findHomography(flat[most], rest[most])
    table = cv2.perspectiveTransform(flat[None], there)[0]
    rims = np.zeros((view.max() + 1, 3))
    for k, rim in enumerate(rims):
        mine = view == k
        at, to = rest[mine].mean(axis=0), table[mine].mean(axis=0)
        x, y = (rest[mine] - at).T
        u, v = (table[mine] - to).T
        rim[2] = np.arctan2((x * v - y * u).sum(), (x * u + y * v).sum())
        rim[:2] = to - _pushed(at[None], np.array([[0.0, 0.0, rim[2]]]))[0]
    turn = rims[:, 2].mean()  # all are turned back by it: the frame turns with them
    back = np.array([[0.0, 0.0, -turn]])
    rims[:, :2] = _pushed(rims[:, :2] - rims[:, :2].mean(axis=0), np.repeat(back, len(rims), 0))
    rims[:, 2] -= turn
    return rims


def from_images(
    images: Iterable[np.ndarray],
    start: Calibration,
    cover_height_m: float = 0.0,
    covers: CoverOutlines | None = None,
    mirror: bool = False,
    lens: bool = True,
) -> Solution:
    """Calibrate on images (h, w) uint8 that show all blocks at rest, as `from_blocks`.

    With `covers` the corners are those that flat covers at `cover_height_m` would have; where the
    outlines stand beside them follows from the camera, which is solved again until both agree. The
    rim is turned by less than 45 degrees; where it stands may differ between images.

    Raises:
        ConfigError: no image shows all squares on their lattice; or as `from_blocks`.
    """
    start = replace(start, cover_height_m=cover_height_m, covers=covers)
    seen, reasons = [], []
    for image in images:
        try:
            seen.append((image, all_blocks(image, start, mirror)))
        except ConfigError as error:
            reasons.append(str(error))
    if not seen:
        why = reasons[-1] if reasons else 'there is none'
        raise ConfigError(f'no image shows all blocks at rest: {why}')
    left_out = ''
    if reasons:
        left_out = f'{len(reasons)} of {len(seen) + len(reasons)} images left out: {reasons[-1]}'
    solution = from_squares(seen, start, lens)
    return replace(solution, note=clauses([solution.note, left_out]))


def from_squares(
    seen: list[tuple[np.ndarray, np.ndarray]],
    start: Calibration,
    lens: bool = True,
) -> Solution:
    """Calibrate on images (h, w) uint8, each with its squares, SQUARE (count,) in order of id.

    The lens: as many of k1 and k2 as these images plainly ask for; the others are held at what they
    are in `start`, and that is said. Height and relief of the covers are those of `start`.

    Raises:
        ConfigError: as `from_blocks`.
    """
    ids, covers = start.table.ids, start.covers
    flat = [(ids, corners(image, blobs)) for image, blobs in seen]

    def solved(camera: Calibration | None, lens: int) -> Solution:
        if covers is None:
            return from_blocks(flat, start, start.cover_height_m, lens=lens)
        views = flat
        if camera is not None:
            tables = [outline.tables(camera, blobs, NEAR_SHINE_PX) for _, blobs in seen]
            views = [(ids, corners(*its, on)) for its, on in zip(seen, tables, strict=True)]

        def shifts(camera: Calibration) -> np.ndarray:
            return np.concatenate([outline.corner_shifts(camera, blobs) for _, blobs in seen])

        return from_blocks(
            views,
            start,
            start.cover_height_m,
            lens=lens,
            side_sigma=side_sigma(float(np.median([b['side_px'] for _, b in seen]))),
            corner_sigma_px=_RELIEF_SIGMA_PX * len(seen) ** 0.5,  # the same in every image
            relief=None if camera is None else (camera, shifts),
        )

    best: Solution | None = None
    for numbers in range(3 if lens else 1):
        solution = solved(None, numbers)
        for _ in range(_RELIEF_ROUNDS if covers is not None else 0):
            solution = solved(solution.calibration, numbers)
        if best is None or best.misfit - solution.misfit > LENS_GAIN * (numbers - best.lens):
            best = solution
    assert best is not None
    if not lens or best.lens == 2:
        return best
    k = start.distortion_coefficients[best.lens : 2]
    held = ', '.join(f'k{best.lens + 1 + i} = {value:g}' for i, value in enumerate(k))
    note = said('lens_held', held=held)
    return replace(best, note=note)


def all_blocks(image: np.ndarray, start: Calibration, mirror: bool) -> np.ndarray:
    """Return the squares in `image` (h, w) as a SQUARE array in order of id.

    The rim is turned by less than 45 degrees and the far edge of the table is on top of the image;
    in a mirror, which must be said, columns run to the left.

    Raises:
        ConfigError: the image cannot be used, or does not show all squares on their lattice.
    """
    fault = Watch(None).fault(0.0, image)
    if fault:
        raise ConfigError(fault)
    found = find_squares(read_only(image), start, mirror)
    if found.calibration is None:
        raise ConfigError(found.why)
    table = start.table
    if not found.seen[table.ids].all():
        raise ConfigError(said('squares_seen', count=int(found.seen.sum()), all=table.count))
    return found.blocks[table.ids]


def from_points(
    px: np.ndarray,
    xy: np.ndarray,
    start: Calibration,
    cover_height_m: float = 0.0,
) -> Solution:
    """Calibrate on points whose places on the table are known.

    The lens stays as in `start`. Points on the platform are carried to the plane of the
    covers, which needs the true focal length in `start`.

    Parameters
    ----------
    px : ndarray
        (n, 2) measured pixels, n >= 4.
    xy : ndarray
        (n, 2) table metres of the same points.
    start : Calibration
        Image size, camera matrix and lens.
    cover_height_m : float
        Height above the platform, in m.

    Returns
    -------
    Solution
        The calibration with its residuals.

    Raises
    ------
    ConfigError
        Fewer than four points, or three of four in one line.

    Examples
    --------
    >>> camera = Calibration.ideal()
    >>> xy = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [0.1, 0.2]])
    >>> solved = from_points(camera.to_pixels(xy), xy, camera).calibration
    >>> bool(np.abs(solved.to_table(camera.to_pixels(xy)) - xy).max() < 1e-9)
    True
    """
    px, xy = np.asarray(px, float).reshape(-1, 2), np.asarray(xy, float).reshape(-1, 2)
    if len(px) < 4 or len(px) != len(xy):
        raise ConfigError(f'{len(px)} points are given; at least 4 are needed, each as u v x y')
    flat = start.undistort(px)
    for where, one in (('the image', flat), ('the table', xy)):
        spread = np.linalg.svd(one - one.mean(axis=0), compute_uv=False)
        if spread[1] < 0.05 * spread[0]:
            raise ConfigError(
                f'the points lie almost in one line in {where}: take corners of the table'
            )
    first, _ = cv2.findHomography(xy, flat)
    places = np.column_stack([xy, np.ones(len(xy))])
    # all points, and the middle of the table, lie before the camera
    if first is None or not (places @ first[2] * first[2, 2] > 0).all():
        raise ConfigError('no camera can see these points so: check their order')
    scale = np.abs(first.ravel()[:8]) + 1e-6 * np.abs(first).max()

    def camera(x: np.ndarray) -> Calibration:
        return replace(start, homography=np.append(x * scale, 1.0).reshape(3, 3))

    done = least_squares(
        lambda x: (camera(x).to_pixels(xy) - px).ravel(), first.ravel()[:8] / first[2, 2] / scale
    )
    n = len(px)
    corner_mm, platform_mm = _sigmas(done, camera, 8) if n > 4 else (np.full(4, np.nan), np.nan)
    solved = raise_plane(camera(done.x), cover_height_m)
    solved, left = replace(solved, cover_height_m=cover_height_m), done.fun.reshape(-1, 2)
    solved = _judged(solved, left, max(2 * n - 8, 0) / (2 * n))
    return Solution(solved, px, left, [f'point {i + 1}' for i in range(n)], corner_mm, platform_mm)


def raise_plane(calibration: Calibration, height_m: float) -> Calibration:
    """Return `calibration` with its plane lifted by `height_m`."""
    if height_m == 0.0:
        return calibration
    lifted = calibration.homography.copy()
    lifted[:, 2] += height_m * calibration.upward()
    return replace(calibration, homography=lifted / lifted[2, 2])


def _cover_corners(poses: np.ndarray, side_m: float) -> np.ndarray:
    """Return table corners (n, 4, 2) of covers of `side_m` at poses (n, 3)."""
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x, y = side_m / 2 * _SQUARE.T
    return np.stack([poses[:, :1] + c * x - s * y, poses[:, 1:2] + s * x + c * y], axis=-1)


def _sigmas(
    done: OptimizeResult,
    camera: Callable[[np.ndarray], Calibration],
    n_camera: int,
    least: float = 0.0,
) -> tuple[np.ndarray, float]:
    """Return standard deviations in mm, from the Jacobian: (4,) at the platform's corners.

    And of all places on the platform, RMS, where the frame lies and how it is turned left out; of
    residuals whose variance is at `least` so much.
    """
    freedom = max(len(done.fun) - len(done.x), 1)
    variance = 2 * done.cost / freedom
    covariance = np.linalg.pinv(done.jac.T @ done.jac, hermitian=True)[:n_camera, :n_camera]
    there, axis = camera(done.x), np.linspace(-0.5, 0.5, 9)
    wide, deep = there.table.platform_m
    grid = np.stack(np.meshgrid(axis * wide, axis * deep), -1).reshape(-1, 2)
    places = np.concatenate([platform_corners(there.table), grid])
    at = there.to_pixels(places)
    moves = np.zeros((len(at), 2, n_camera))
    for k in range(n_camera):
        step = np.zeros(len(done.x))
        step[k] = 1e-4 * max(abs(done.x[k]), 1.0)
        ahead = camera(done.x + step).to_table(at)
        back = camera(done.x - step).to_table(at)
        moves[..., k] = (ahead - back) / (2 * step[k])

    def variances(moves: np.ndarray) -> np.ndarray:
        return 1e6 * np.einsum('pak,kl,pal->p', moves, covariance, moves)

    corner = np.sqrt(variance * variances(moves[:4]))
    spread = moves[4:] - moves[4:].mean(axis=0)
    turned = np.column_stack([-grid[:, 1], grid[:, 0]])
    turn = np.einsum('pa,pak->k', turned, spread) / (turned**2).sum()
    left = spread - turned[..., None] * turn
    return corner, float(np.sqrt(max(variance, least) * variances(left).mean()))


def _judged(calibration: Calibration, left: np.ndarray, freedom: float) -> Calibration:
    """Return it with the RMS of residuals (n, 2) px, of which a share `freedom` is free."""
    rms = float(np.sqrt((left**2).mean() / freedom)) if freedom > 0 else 0.0
    return replace(calibration, residual_px=rms, residual_mm=rms / calibration.px_per_m() * 1e3)
