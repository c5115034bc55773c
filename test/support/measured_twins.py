# SPDX-License-Identifier: Apache-2.0
"""Twins whose springs and friction nobody has told, as their camera sees them being measured.

What is drawn and not told: stiffness, natural length within what a ruler leaves open, friction of
every block, how the blocks stand, how the rim lies, the direction of the thread, and what the
kitchen scale is off. `images` yields stamp (s), places (25, 3) and who was seen (25,).
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from eol_ros.core.measure import friction, springs
from eol_ros.core.measure.estimate import Estimate, SampleMean
from eol_ros.core.measure.springs import NATURAL_SIGMA_M, RIM_SIGMA_M, outwards
from eol_ros.core.physics import builders
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.twin.live import Coupling, LiveTable
from eol_ros.lab.choose import simulate
from support.paper import BLOCK_SIDE_M, N_BLOCKS, rest_lattice

NOISE_M, NOISE_RAD = 9e-6, 3e-4  # of the tracker, `eol bench vision`
SCALE_KG = 6e-4  # of a kitchen scale that shows grams
STIFFNESSES = 20.0, 200.0  # N/m, evenly in its logarithm
THREAD_M = 100.0  # the weight is a spring so long that its pull is the same everywhere
SHARES = (0.25, 0.5, 0.75, 1.0, 0.85, 0.6, 0.35, 0.1)  # of the greatest weight, up and down
STEPS = 7  # in which a hand lowers a weight
CAMERA_FPS, PULL_MPS, PULL_M = 60.0, 0.03, 0.10
BREAKS_M = 0.012, 0.032  # how far one spring stretches until a block slips
STIFFNESS_SHARE = 0.01  # to which the springs were measured
FPS, LOWERED_S, SWING_S, REST_S = 12.0, 3.0, 1.5, 5.0

Image = tuple[float, np.ndarray, np.ndarray]
Measured = Estimate | SampleMean


def noisy(places: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return `places` (25, 3) as the tracker gives them."""
    sigma = np.array([NOISE_M, NOISE_M, NOISE_RAD])
    return places + sigma * random.standard_normal(places.shape)


class Pulled:
    """A table whose rim is pulled to and fro at PULL_MPS, such that its middle answers.

    `coupling` is the truth, `each` (25, 2) mu_s and mu_k of the blocks; `stiffness` and `mass` are
    what was measured before, with their errors.
    """

    def __init__(self, seed: int, seconds: float = 30.0):
        random = self._random = np.random.default_rng([seed, 0x70756C])
        static, kilos = random.uniform(0.6, 1.1), 0.25 * random.uniform(0.95, 1.05)
        stiffness = static * kilos * builders.GRAVITY / random.uniform(*BREAKS_M)
        natural_m = builders.NATURAL_M + random.normal(0, NATURAL_SIGMA_M)
        self.coupling = Coupling(
            stiffness, static, static * random.uniform(0.6, 0.85), True, natural_m, kilos
        )
        share = random.normal(0, STIFFNESS_SHARE)
        self.stiffness = Estimate(stiffness * (1 + share), stiffness * STIFFNESS_SHARE)
        self.mass = Estimate(kilos + random.normal(0, SCALE_KG), SCALE_KG)
        self.natural_m, self._seconds = builders.NATURAL_M, seconds
        self._table = LiveTable(int(random.integers(2**31)), 0, self.coupling)
        scene = self._table._scene
        self.each = np.column_stack([scene.static_limit, scene.kinetic_force]) / (
            kilos * builders.GRAVITY
        )
        self._way = np.exp(2j * np.pi * random.uniform())

    def images(self) -> Iterator[Image]:
        """Yield the images of the pull."""
        table, along, speed, seen = self._table, 0.0, PULL_MPS, np.ones(N_BLOCKS, bool)
        for k in range(round(self._seconds * CAMERA_FPS)):
            step = np.array([self._way.real, self._way.imag, 0.0]) * speed
            begin_s, end_s = k / CAMERA_FPS, (k + 1) / CAMERA_FPS
            table.advance(begin_s, end_s, table.rim_pose + step / CAMERA_FPS, step)
            along += speed / CAMERA_FPS
            if abs(along) > PULL_M:
                speed = -np.sign(along) * PULL_MPS
            yield end_s, noisy(np.column_stack([table.x, table.y, table.yaw]), self._random), seen


class Hung:
    """A table of which one block, on rollers, is pulled by weights.

    `stiffness` (N/m) is the truth; `weights_kg` what the scale says, `natural_m` what the ruler.
    """

    def __init__(self, seed: int, shares: Sequence[float] = SHARES, block: int = 14):
        random = self._random = np.random.default_rng([seed, 0x6873])
        self.block, self.natural_m = block, builders.NATURAL_M
        self.stiffness = float(np.exp(random.uniform(*np.log(STIFFNESSES))))
        self._natural_m = float(self.natural_m + random.normal(0, NATURAL_SIGMA_M))
        self._static = random.uniform(0.6, 1.1) * (1 + random.uniform(-0.15, 0.15, N_BLOCKS))
        self._static[block] = random.uniform(0.01, 0.05)
        self._kinetic = self._static * random.uniform(0.6, 0.85)
        most_kg = (
            2.67 * self.stiffness * 0.022 / builders.GRAVITY
        )  # two springs along, two across: 22 mm
        self.weights_kg = np.round(most_kg * np.array(shares), 3).tolist()
        self._hung_kg = np.array(self.weights_kg) + random.normal(0, SCALE_KG, len(shares))
        self._rim = random.normal(0, [RIM_SIGMA_M, RIM_SIGMA_M, 0.004])
        self._u = random.uniform(-0.002, 0.002, (N_BLOCKS, 2))
        self._yaw = random.normal(0, 0.02, N_BLOCKS)
        turn = random.normal(0, 0.02)
        c, s = np.cos(turn), np.sin(turn)
        self._thread = np.array([[c, -s], [s, c]]) @ outwards(block)
        self._time_s = 0.0

    def images(self) -> Iterator[Image]:
        """Yield the images of the whole measurement, from before the first weight on."""
        hung = 0.0
        for weight in (0.0, *self._hung_kg):
            for part in np.linspace(hung, weight, STEPS + 1)[1:]:
                yield from self._solved(float(part), LOWERED_S / STEPS)
            yield from self._solved(weight, SWING_S)
            hung = weight
            for _ in range(round(REST_S * FPS)):
                yield self._image(self._u, self._yaw)

    def _image(self, u: np.ndarray, yaw: np.ndarray) -> Image:
        self._time_s += 1 / FPS
        places = np.column_stack([rest_lattice() + u, yaw])
        return self._time_s, noisy(places, self._random), np.ones(N_BLOCKS, bool)

    def _solved(self, weight_kg: float, span_s: float) -> Iterator[Image]:
        scene = builders.table(
            {'kind': 'none'}, span_s, k=self.stiffness, natural_m=self._natural_m, geometric=True,
            mu_s=self._static.tolist(), mu_k=self._kinetic.tolist(), u0=self._u.tolist(),
            rotation={'side': BLOCK_SIDE_M, 'yaw0': self._yaw.tolist()},
        )  # fmt: skip
        x, y, yaw = self._rim
        c, s = np.cos(yaw), np.sin(yaw)
        for spring in scene['springs_to_frame']:
            ax, ay = spring['anchor']
            spring['anchor'] = [float(x + c * ax - s * ay), float(y + s * ax + c * ay)]
        if weight_kg > 0:
            edge = outwards(self.block) * BLOCK_SIDE_M / 2
            far = rest_lattice()[self.block] + edge + THREAD_M * self._thread
            scene['springs_to_frame'].append({
                'i': self.block, 'k': weight_kg * builders.GRAVITY / THREAD_M, 'L0': 0.0,
                'dir': self._thread.tolist(), 'Lnom': THREAD_M, 'anchor': far.tolist(),
                'arm': edge.tolist(),
            })  # fmt: skip
        run = simulate(from_mapping(scene), 1 / FPS, ledger=False, tolerance=1e-6)
        assert run.yaw is not None
        for u, turned in zip(run.u[1:], run.yaw[1:], strict=True):
            yield self._image(u, turned)
        self._u, self._yaw = run.u[-1].copy(), run.yaw[-1].copy()


def measured_springs(twin: Hung) -> springs.Springs:
    """Return what weights on a twin say."""
    rests = springs.Rests(twin.block)
    for image in twin.images():
        rests.add(*image)
    return springs.fit(rests.found, twin.weights_kg, twin.block, twin.natural_m)


def measured_friction(twin: Pulled) -> friction.Friction:
    """Return what pulling the rim of a twin says."""
    track = tracked(twin.images())
    slips = friction.find_slips(track, twin.stiffness.value, twin.mass.value, twin.natural_m)
    return friction.fit(slips, track, twin.stiffness, twin.mass, twin.natural_m)


def tracked(images: Iterable[Image]) -> friction.Track:
    """Return images as one track."""
    return friction.Track(*(np.array(part) for part in zip(*images, strict=True)))


def held(pairs: Sequence[tuple[float, Measured]]) -> tuple[int, int]:
    """Return how many intervals of 68 % and of 95 % hold the true values."""
    counts = []
    for level in (0.68, 0.95):
        ends = [measured.interval(level) for _, measured in pairs]
        inside = [low <= truth <= high for (truth, _), (low, high) in zip(pairs, ends, strict=True)]
        counts.append(sum(inside))
    return counts[0], counts[1]
