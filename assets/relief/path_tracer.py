# SPDX-License-Identifier: Apache-2.0
"""Light through printed covers, and what a camera sees of it: by Mitsuba 3 (Jakob et al. 2022).

Two passes. All surfaces scatter light evenly, so what leaves a cover is the same for every camera:
it is path-traced once for each of its vertices, from the board of LEDs through both faces of the
wall, each of which sends back or lets through. Then every pixel of an image is cut into strata; a
ray of each meets a cover, whose light is known, or the table, which sends back what one more ray
from there finds. So the outline of a cover has no noise but that of the strata, and what noise the
first pass leaves stays on the cover like the grain of its plastic.

Left out: light from one cover on its neighbours' walls, scattering along the wall (each face
scatters at once, the thickness lies between them), gloss.
"""

from typing import Any

import cv2
import numpy as np
from support.paper import RIM_SIDE_M
from support.relief.films import PSF_PX
from support.relief.scene import CELLS, GAP_M, Shot

from assets.covers.mesh import CoverShape, cover_mesh
from assets.relief import surfaces
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import DeviceMissing, pip_install
from eol_ros.verbs.progress import track

FACE = 0.9  # of the light that meets a face goes on, one half to each side
BOARD_MM, BOARD_HEIGHT_MM = 72.0, 2.0  # of the LEDs under their diffusing sheet
WHITE = 0.7  # albedo of what carries the board
AMBIENT = 40.0  # grey levels that a white sheet on the table would send back
LEVEL = 130.0  # mean of the light that leaves the covers' roofs, grey levels
_AT_ONCE = 1 << 21  # rays


def mitsuba(threads: int = 0) -> Any:
    """Return the module, ready to draw on so many `threads`, or raise DeviceMissing."""
    try:
        import mitsuba as mi
    except ImportError:
        raise DeviceMissing(
            'Mitsuba 3 is not installed, which draws the films: make films, or '
            f'{pip_install(".[render]")}'
        ) from None
    if mi.variant() is None:
        try:
            mi.set_variant('llvm_ad_mono')
            import drjit

            drjit.eval(mi.Float(1.0) + mi.Float([0.0, 1.0]))
        except Exception as error:
            raise DeviceMissing(
                f'Mitsuba finds no LLVM ({error}): install libllvm19 (Debian), or name the '
                'library in DRJIT_LIBLLVM_PATH'
            ) from None
    if threads:
        import drjit

        drjit.set_thread_count(threads)
    return mi


def cover_light(land: np.ndarray, shape: CoverShape, samples: int, seed: int) -> np.ndarray:
    """Return the light (n,) that leaves each vertex of surfaces.cover_surface, for a board of 1."""
    mi = mitsuba()
    solid = cover_mesh(land, shape).reshape(-1, 3)
    wall = {
        'type': 'principledthin',
        'base_color': FACE,
        'diff_trans': 1.0,
        'spec_trans': 0.0,
        'eta': 1.001,
        'roughness': 1.0,
    }
    white = {'type': 'twosided', 'inner': {'type': 'diffuse', 'reflectance': WHITE}}
    sand = {'type': 'diffuse', 'reflectance': surfaces.SAND}
    flat = mi.ScalarTransform4f
    inside = shape.side_mm / 2 - shape.wall_mm - 0.5
    world = mi.load_dict(
        {
            'type': 'scene',
            'integrator': {'type': 'path', 'max_depth': 16, 'rr_depth': 6},
            'cover': _mesh(mi, solid, np.arange(len(solid)).reshape(-1, 3), mi.load_dict(wall)),
            'board': {
                'type': 'rectangle',
                'to_world': flat().translate([0, 0, BOARD_HEIGHT_MM]).scale([BOARD_MM / 2] * 3),
                'bsdf': white,
                'light': {'type': 'area', 'radiance': 1.0},
            },
            'carrier': {
                'type': 'rectangle',
                'to_world': flat().translate([0, 0, BOARD_HEIGHT_MM - 0.5]).scale([inside] * 3),
                'bsdf': white,
            },
            'sand': {
                'type': 'rectangle',
                'to_world': flat().translate([0, 0, -1e3 * GAP_M]).scale([200.0] * 3),
                'bsdf': sand,
            },
        }
    )
    at, to = _looks(land, shape)
    n = len(at)
    total = np.zeros(n)
    rounds = max(1, round(n * samples / _AT_ONCE))
    each = -(-samples // rounds)
    index = np.repeat(np.arange(n), each)
    integrator = world.integrator()
    for r in range(rounds):
        sampler = mi.load_dict({'type': 'independent'})
        sampler.seed(seed * 1000 + r, len(index))
        ray = mi.RayDifferential3f(
            mi.Point3f(*(mi.Float(at[index, k].astype(np.float32)) for k in range(3))),
            mi.Vector3f(*(mi.Float(to[index, k].astype(np.float32)) for k in range(3))),
        )
        light = np.array(integrator.sample(world, sampler, ray)[0]).reshape(-1)
        total += light.reshape(n, each).mean(axis=1)
    return total / rounds


def covers_light(shot: Shot, samples: int) -> np.ndarray:
    """Return the light (25, n) of all covers in grey levels, LEVEL on the mean of their roofs."""
    light = np.array(
        [
            cover_light(land, shot.shape(), samples, seed)
            for seed, land in enumerate(track(surfaces.covers(shot), 'light through the covers'))
        ]
    )
    return light * LEVEL / light[:, : (CELLS + 1) ** 2].mean()


def _looks(land: np.ndarray, shape: CoverShape) -> tuple[np.ndarray, np.ndarray]:
    """Return a point (n, 3) in mm just outside each vertex, and the direction (n, 3) to it.

    Corners are approached from a little inside of their faces, lest the ray passes them by.
    """
    vertices, _ = surfaces.cover_surface(land, shape)
    n = (CELLS + 1) ** 2
    vertices[:, :2] *= 1 - 0.3 / shape.side_mm
    to = np.zeros_like(vertices)
    to[:n, 2] = -1.0
    each = (surfaces.SIDE_ROWS + 1) * (CELLS + 1)
    for k, away in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
        side = slice(n + k * each, n + (k + 1) * each)
        to[side, :2] = -np.array(away)
        rows = vertices[side].reshape(surfaces.SIDE_ROWS + 1, -1, 3)
        rows[0, :, 2] += 0.2
        rows[-1, :, 2] -= 0.2
    at = vertices - 0.5 * to
    at[:n, 2] = shape.skirt_mm + shape.relief_mm + 1.0  # over what may stand beside a pit
    return at, to


def render(
    shot: Shot,
    light: np.ndarray,
    strata: int = 8,
    seed: int = 0,
    ambient: float = AMBIENT,
) -> tuple[np.ndarray, tuple[int, int]]:
    """Return grey levels (h, w) of the part of the image that the table fills, and its corner.

    light (25, n) of cover_light in grey levels; strata (squared) is the number of rays of a pixel.
    """
    mi = mitsuba()
    import drjit as dr

    calibration = shot.view.calibration()
    world = mi.load_dict({'type': 'scene', **_table(mi, shot, light, ambient)})
    low, size = _crop(calibration)
    u, v = np.meshgrid(np.arange(size[0]) + low[0], np.arange(size[1]) + low[1])
    px = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    centre, grid = _rays(calibration, px)
    fine = np.empty((size[1], strata, size[0], strata), np.float32)  # v, row in a pixel, u, column
    sampler = mi.load_dict({'type': 'independent'})
    cells = [(a, b) for a in range(strata) for b in range(strata)]
    lines = max(1, _AT_ONCE // size[0])
    for first in range(0, size[1], lines):
        part = slice(first * size[0], min(first + lines, size[1]) * size[0])
        n = part.stop - part.start
        place, du, dv = (mi.Vector3f(*grid[k][part].T.astype(np.float32)) for k in range(3))
        sampler.seed(seed * 1000 + first, n)
        for a, b in cells:
            shift_u = (a + sampler.next_1d()) / strata - 0.5
            shift_v = (b + sampler.next_1d()) / strata - 0.5
            ray = mi.Ray3f(
                mi.Point3f(*map(float, centre)), dr.normalize(place + shift_u * du + shift_v * dv)
            )
            got = _light(mi, dr, world, ray, sampler, ambient)
            dr.eval(got, sampler)
            fine[first : first + n // size[0], b, :, a] = np.array(got).reshape(-1, size[0])
    return through_lens(fine.reshape(strata * size[1], strata * size[0]), strata), low


def through_lens(fine: np.ndarray, strata: int) -> np.ndarray:
    """Return the image of the light `fine`, so many `strata` a pixel each way.

    The lens blurs first, then pixels take what falls on them: were whole pixels blurred, the width
    of an edge would change with its place in a pixel.
    """
    blurred = cv2.GaussianBlur(fine, (0, 0), strata * PSF_PX, borderType=cv2.BORDER_REPLICATE)
    size = fine.shape[1] // strata, fine.shape[0] // strata
    return cv2.resize(blurred, size, interpolation=cv2.INTER_AREA)


def _light(mi: Any, dr: Any, world: Any, ray: Any, sampler: Any, ambient: float) -> Any:
    """Return the light along `ray`, one bounce off the table included."""
    seen = world.ray_intersect(ray)
    there = seen.is_valid()
    glow = seen.shape.eval_attribute_1('vertex_glow', seen, there)
    albedo = seen.shape.eval_attribute_1('vertex_albedo', seen, there)
    bounces = there & (albedo > 0)
    local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    facing = dr.select(dr.dot(seen.n, ray.d) > 0, -1.0, 1.0) * seen.n
    other = world.ray_intersect(
        mi.Ray3f(seen.p + 1e-5 * facing, mi.Frame3f(facing).to_world(local)), bounces
    )
    meets = other.is_valid() & bounces
    found = other.shape.eval_attribute_1('vertex_glow', other, meets)
    dark = other.shape.eval_attribute_1('vertex_albedo', other, meets)
    arriving = dr.select(meets, found + 0.5 * ambient * dark, ambient)
    return dr.select(there, glow, 0.0) + dr.select(bounces, albedo * arriving, 0.0)


def _table(mi: Any, shot: Shot, light: np.ndarray, ambient: float) -> dict[str, Any]:
    shape, found = shot.shape(), {}
    for i, land in enumerate(surfaces.covers(shot)):
        vertices, faces = surfaces.cover_surface(land, shape)
        shade = np.where(vertices[:, 0] > 0, shot.half[i], 1.0)
        glow = light[i] * shot.battery[i] * shade + 0.5 * ambient
        mesh = surfaces.Mesh(
            surfaces.placed(vertices, shot.poses[i]), faces, glow, np.zeros(len(vertices))
        )
        found[f'cover {i}'] = _with_light(mi, mesh)
    for i, mesh in enumerate(surfaces.furniture(shot)):
        found[f'piece {i}'] = _with_light(mi, mesh)
    return found


def _with_light(mi: Any, mesh: surfaces.Mesh) -> Any:
    made = _mesh(mi, mesh.vertices, mesh.faces, mi.load_dict({'type': 'diffuse'}))
    for name, values in (('vertex_glow', mesh.glow), ('vertex_albedo', mesh.albedo)):
        made.add_attribute(name, 1, values.astype(np.float32))
    return made


def _mesh(mi: Any, vertices: np.ndarray, faces: np.ndarray, bsdf: Any) -> Any:
    properties = mi.Properties()
    properties['mesh_bsdf'] = bsdf
    made = mi.Mesh('mesh', len(vertices), len(faces), props=properties)
    numbers = mi.traverse(made)
    numbers['vertex_positions'] = vertices.astype(np.float32).ravel()
    numbers['faces'] = faces.astype(np.uint32).ravel()
    numbers.update()
    return made


def _crop(calibration: Calibration) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return corner and size (u, v) of the part of the image that the rim fills, 16 px more."""
    reach = RIM_SIDE_M / 2 + surfaces.BAR_M
    corners = calibration.to_pixels([[x, y] for x in (-reach, reach) for y in (-reach, reach)])
    most = np.array([calibration.image_width, calibration.image_height])
    low = np.clip(np.floor(corners.min(axis=0)) - 16, 0, most).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)) + 16, 0, most).astype(int)
    return (int(low[0]), int(low[1])), (int(high[0] - low[0]), int(high[1] - low[1]))


def _rays(calibration: Calibration, px: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the camera's place, and the ray of each pixel with its change by u and by v."""
    pose = np.linalg.inv(calibration.camera_matrix) @ calibration.homography
    pose /= np.linalg.norm(pose[:, 0])
    turn = np.column_stack([pose[:, 0], pose[:, 1], np.cross(pose[:, 0], pose[:, 1])])
    camera = np.linalg.inv(calibration.camera_matrix)

    def along(at: np.ndarray) -> np.ndarray:
        flat = calibration.undistort(at)
        return (np.column_stack([flat, np.ones(len(flat))]) @ camera.T) @ turn

    step = [along(px + d) - along(px - d) for d in ([0.5, 0], [0, 0.5])]
    return -turn.T @ pose[:, 2], [along(px), *step]
