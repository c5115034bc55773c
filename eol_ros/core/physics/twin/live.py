# SPDX-License-Identifier: Apache-2.0
"""The simulated table as the twin runs it: from one image to the next, under a moving rim."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.physics import builders
from eol_ros.core.physics.drive import POSES, Drive
from eol_ros.core.physics.event.kernel import make_workspace, run
from eol_ros.core.physics.event.solver import rules_for
from eol_ros.core.physics.kernel_args import Grid, Ledger, empty_log
from eol_ros.core.physics.lattice import spans
from eol_ros.core.physics.numerics import kinetic_energy, length_scale
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.status import NOT_FINITE, OK
from eol_ros.core.physics.twin import rim_springs
from eol_ros.core.physics.twin.hands import Frame, keep_within
from eol_ros.core.table import Table
from eol_ros.settings import TwinSettings

if TYPE_CHECKING:
    from eol_ros.core.physics.twin.rotating import Rotating

TOLERANCE = 1e-5
MOST_EVENTS, MOST_STEPS = 2000, 5000  # between two images: some 50 ms of work
FRICTION_SPREAD = 0.15  # blocks differ by up to this share, as grit and weights do
OFFSET_M = 0.004  # the blocks are set down by hand,
REST = 0.0725  # and rest: no further off than this share of what stretches a spring to a break
OF_GAP = 0.05  # nor than this share of the gap between two blocks
CLEAR_M = 0.002  # between the rim and a block: nearer the hands do not push
TOUCH_M = 1e-7
MOST_CONTACTS = 100


class Coupling(NamedTuple):
    """What couples the blocks: stiffness of a spring (N/m) and the mean friction on the grit.

    With `rotate` springs also rotate the blocks, at whose edges they pull. `spring_natural_m` is
    the length of a spring that nothing pulls, `block_kg` the mass of a block.
    """

    stiffness: float = TwinSettings.stiffness
    mu_static: float = TwinSettings.mu_static
    mu_kinetic: float = TwinSettings.mu_kinetic
    rotate: bool = TwinSettings.rotate
    spring_natural_m: float = TwinSettings.spring_natural_m
    block_kg: float = TwinSettings.block_kg

    @classmethod
    def of(cls, settings: TwinSettings) -> 'Coupling':
        """Return that of a twin."""
        return cls(*(getattr(settings, name) for name in cls._fields))

    @property
    def break_m(self) -> float:
        """By how much one spring must stretch to break a block loose."""
        return self.mu_static * self.block_kg * builders.GRAVITY / self.stiffness


SOFT = Coupling(builders.STIFFNESS, builders.MU_STATIC, builders.MU_KINETIC, False)  # named scenes


class Trace(NamedTuple):
    """How blocks moved between two images.

    t (n + 1,): s, from 0 to the end; u, v (n + 1, cells, 2): displacement (m), velocity (m/s) then.
    event_t, event_block, event_start (e,): when which block broke loose (1) or came to rest (0).
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    event_t: np.ndarray
    event_block: np.ndarray
    event_start: np.ndarray


def scene_of(
    seed: int, coupling: Coupling, drive: builders.Plain, duration_s: float, table: Table = Table()
) -> builders.Plain:
    """Return the twin's table as a scene: friction and starting offsets follow from `seed`.

    Its blocks are those of `table.ids`, in this order.
    """
    random = np.random.default_rng([seed, 0x7461626C])
    share = 1 + FRICTION_SPREAD * random.uniform(-1, 1, table.count)
    offset_m = min(OFFSET_M, REST * coupling.break_m, OF_GAP * min(table.gaps_m))
    return builders.table(
        drive,
        duration_s,
        k=coupling.stiffness,
        mass=coupling.block_kg,
        natural_m=coupling.spring_natural_m,
        geometric=True,
        mu_s=list(coupling.mu_static * share),
        mu_k=list(coupling.mu_kinetic * share),
        u0=random.uniform(-offset_m, offset_m, (table.count, 2)).tolist(),
        rotation={'side': table.block_side_m} if coupling.rotate else None,
        shape=table,
    )


class LiveTable:
    """Blocks with static and kinetic Coulomb friction, springs, and a rim that is led.

    `x`, `y`, `yaw` (cells,) are the block centres (m, rad), `velocity` (cells, 3) their rates, and
    `moving` (cells,) tells which slide; a place without a block is at rest. `slips` counts slips
    begun, `energy_residual` (J) is what the ledger misses since the start. `faults` counts images
    in which the solver met a limit: blocks then move on from where they have got to, and are late
    by what is left of that image. With `samples`, `trace` tells how the blocks moved in the last
    step, at so many equal parts of it; None where all was still.
    """

    def __init__(
        self,
        seed: int,
        samples: int = 0,
        coupling: Coupling | None = None,
        table: Table = Table(),
    ) -> None:
        coupling = coupling or Coupling()
        scene = from_mapping(scene_of(seed, coupling, {'kind': 'none'}, 0.0, table))
        self.table, self._frame = table, Frame.of(table)
        self._scene = scene
        self._rules = rules_for(TOLERANCE, length_scale(scene))
        self._rest = table.rest
        springs = scene.to_frame
        side = springs.rest / np.linalg.norm(springs.rest, axis=1)[:, None]
        self._beside, self._k = springs.i, coupling.stiffness
        self._natural_m = coupling.spring_natural_m
        # in the complex plane: ends at the rim, centres of the blocks at rest, from there to their
        # edges, the ways inwards
        self._ends = springs.anchor.copy().view(complex)[:, 0]
        self._centres = self._rest[table.ids].view(complex)[self._beside, 0]
        self._arms = (springs.anchor - springs.rest).view(complex)[:, 0] - self._centres
        self._inward = -side.view(complex)[:, 0]
        self._u, self._v = scene.u0.copy(), scene.v0.copy()
        self._ledger = Ledger(empty_log(MOST_EVENTS), np.zeros(2), np.zeros(3, np.int64))
        self._rotating: Rotating | None = None
        if coupling.rotate:
            from eol_ros.core.physics.twin import rotating

            self._rotating = rotating.Rotating(scene, samples)
        else:
            self._workspace = make_workspace(scene.lattice, self._rules.order)
        self._sampled = np.linspace(0.0, 1.0, samples + 1)
        rows = (samples + 1, table.count, 2)
        self._path = np.zeros(samples + 1), np.zeros(rows), np.zeros(rows)
        self._grid = Grid(*(part[1:] for part in self._path))
        self.trace: Trace | None = None
        self._drive = Drive(POSES, np.zeros(4), np.zeros(2), np.zeros((1, 3, 4)))
        # of the blocks that there are, in order of their ids
        self._rim_rate, self._yaw = np.zeros(3), np.zeros(table.count)
        self._moving = np.zeros(table.count, bool)
        self.rim_pose = np.zeros(3)
        self.faults = 0
        self._energy0 = self._energy()
        self._place()
        # a run of no time, on copies: compiles or loads the kernels before the clock runs
        self.pull(self.rim_pose)
        self.clearance_m(self.rim_pose)
        self._solve(self._u.copy(), self._v.copy(), self._moving.copy(), 0.0)
        self._ledger.work_and_heat[:] = self._ledger.counts[:] = 0

    def advance(self, start_s: float, stop_s: float, pose: np.ndarray, rate: np.ndarray) -> None:
        """Move from `start_s` to `stop_s`; the rim goes to `pose` (3,), arriving at `rate` (3,).

        A rim that meets a block goes no further that way and slides along it, and `pose` and `rate`
        are set to that: hands feel it. The springs' model has no contact, and blocks would else
        pass over the rim.
        """
        span = float(stop_s - start_s)
        self._stop_at_blocks(pose, rate, span)
        self.trace = None
        # plain numbers: arrays of three cost more than what they hold
        begin, end = self.rim_pose.tolist(), pose.tolist()
        leaves, arrives = self._rim_rate.tolist(), rate.tolist()
        if not (begin != end or any(arrives) or any(leaves) or self._moving.any()):
            return  # all is still: nothing to work out
        for c, p, q, a, b in zip(self._drive.cubics[0], begin, end, leaves, arrives, strict=True):
            mean = (q - p) / span
            c[:] = p, a, (3 * mean - 2 * a - b) / span, (a + b - 2 * mean) / span**2
        self._drive.knots[1] = span
        t, u, v = self._path
        if len(t) > 1:
            t[:], u[0], v[0] = span * self._sampled, self._u, self._v
        status, events = self._solve(self._u, self._v, self._moving, span)
        self.faults += status != OK
        if status == NOT_FINITE:
            self._v[:] = 0.0
            if self._rotating:
                self._rotating.stop()
            self._moving[:] = False
        elif status == OK and len(t) > 1:
            when, which, starts = (column[:events] for column in self._ledger.log)
            if self.table.absent:
                which = self.table.ids[which]
            self.trace = Trace(t, self._by_id(u, 1), self._by_id(v, 1), when, which, starts)
        self.rim_pose = np.array(pose, float)
        self._rim_rate = np.array(rate, float)
        self._place()

    def pull(self, pose: np.ndarray) -> np.ndarray:
        """Return the force of the springs on the rim at `pose` (3,): N, N, and N m about it."""
        force = np.empty(3)
        rim_springs.pull(
            pose, self._u, self._yaw, self._beside, self._ends, self._centres, self._arms, self._k,
            self._natural_m, force,
        )  # fmt: skip
        return force

    def clearance_m(self, pose: np.ndarray) -> float:
        """Return the least distance (m) from the rim at `pose` (3,) inwards to the block beside."""
        return self._near(pose)[0]

    def _near(self, pose: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the least distance (m) from the rim at `pose` to a block, and all, by spring."""
        gap = np.empty(len(self._beside))
        least = rim_springs.gaps(
            pose, self._u, self._yaw, self._rotating is not None, 0.5 * self.table.block_side_m,
            self._beside, self._ends, self._centres, self._inward, gap,
        )  # fmt: skip
        return least, gap

    def _stop_at_blocks(self, pose: np.ndarray, rate: np.ndarray, span_s: float) -> None:
        """Move `pose` to where no block is nearer than allowed, and `rate` with it.

        The rim slides along what it touches, without friction: from where the hands want it, it is
        put back by the least motion in |dx|^2 + |dy|^2 + (gyration_m dyaw)^2, block by block, until
        none is too near (Kaczmarz 1937), and between blocks onto the platform.
        """
        nearest, near = self._near(pose)
        if nearest >= CLEAR_M or np.array_equal(pose, self.rim_pose):
            return
        # a block may have come nearer by itself
        least = np.minimum(CLEAR_M, self._near(self.rim_pose)[1])
        if np.all(near >= least):
            return
        for _ in range(MOST_CONTACTS):
            keep_within(pose, self._frame)
            short = least - self._near(pose)[1]
            worst = int(np.argmax(short))
            if short[worst] <= TOUCH_M:
                break
            slope = self._slope(pose, worst)
            light = slope * (1.0, 1.0, self._frame.gyration_m**-2)
            pose += short[worst] / (slope * light).sum() * light
        else:  # held from all sides
            pose[:] = self.rim_pose
        rate[:] = (pose - self.rim_pose) / span_s

    def _slope(self, pose: np.ndarray, which: int) -> np.ndarray:
        """Return the derivative (3,) of one distance of `_near` after x, y and yaw."""
        block = self._beside[which]
        sine, cosine = elementary.sincos(pose[2])
        rotation = complex(cosine, sine)
        end, normal = rotation * self._ends[which], rotation * self._inward[which]
        way = complex(pose[0], pose[1]) + end - self._centres[which] - complex(*self._u[block])
        rotated = (1j * end * normal.conjugate()).real + (way * (1j * normal).conjugate()).real
        if self._rotating:  # it reaches further with its corners
            s, c = elementary.sincos(self._yaw[block] - pose[2])
            rotated += 0.5 * self.table.block_side_m * (s * np.sign(c) - c * np.sign(s))
        return -np.array([normal.real, normal.imag, rotated])

    def _solve(
        self, u: np.ndarray, v: np.ndarray, moving: np.ndarray, span: float
    ) -> tuple[int, int]:
        rim, ledger = self._drive, self._ledger
        if self._rotating:
            return self._rotating.solve(u, v, moving, span, rim, self._grid, ledger, MOST_STEPS)
        status, _, events, _ = run(
            u,
            v,
            moving,
            span,
            self._rules,
            self._scene.lattice,
            rim,
            self._grid,
            ledger.log,
            MOST_STEPS,
            ledger.work_and_heat,
            True,
            ledger.counts,
            self._workspace,
        )
        return int(status), int(events)

    @property
    def slips(self) -> int:
        """Slips begun since the start."""
        return int(self._ledger.counts[0])

    @property
    def energy_residual(self) -> float:
        """Drive work less friction heat less the change of energy (J) since the start."""
        work, heat = self._ledger.work_and_heat.tolist()
        return work - heat - (self._energy() - self._energy0)

    def _energy(self) -> float:
        m = self._scene.lattice
        x, y, phi = self.rim_pose
        s, c = elementary.sin(phi), -2 * elementary.sin(phi / 2) ** 2
        ax, ay = m.anchors[:, 0], m.anchors[:, 1]
        led = np.stack([x + c * ax - s * ay, y + s * ax + c * ay], axis=1)
        rotating = self._rotating
        yaw, spin = (rotating.yaw, rotating.spin) if rotating else (None, None)
        d = spans(self._scene, self._u, led, yaw) + m.rest
        held = 0.5 * np.sum(m.k * (elementary.hypot(d[:, 0], d[:, 1]) - m.natural) ** 2)
        return float(held + kinetic_energy(self._scene, self._v, spin))

    def _place(self) -> None:
        if self._rotating:
            self._yaw = self._rotating.yaw
        u, self.yaw, self.moving = self._u, self._yaw, self._moving
        if self.table.absent:
            u, self.yaw, self.moving = map(self._by_id, (u, self.yaw, self.moving))
        self.x = self._rest[:, 0] + u[:, 0]
        self.y = self._rest[:, 1] + u[:, 1]

    def _by_id(self, values: np.ndarray, axis: int = 0) -> np.ndarray:
        """Return `values` with a row for each place; 0 where no block is. May be `values`."""
        if not self.table.absent:
            return values
        shape = list(values.shape)
        shape[axis] = self.table.cells
        spread = np.zeros(shape, values.dtype)
        spread[(slice(None),) * axis + (self.table.ids,)] = values
        return spread

    @property
    def velocity(self) -> np.ndarray:
        """Return the rates (cells, 3) of x, y and yaw."""
        spin = self._rotating.spin if self._rotating else np.zeros(self.table.count)
        return self._by_id(np.column_stack([self._v, spin]))
