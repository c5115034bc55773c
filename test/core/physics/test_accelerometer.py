# SPDX-License-Identifier: Apache-2.0
"""The twin's accelerometers against spring and friction forces worked out here."""

import dataclasses

import numpy as np
import pytest
from support.paper import BLOCK_MASS_KG, BLOCK_SIDE_M, N_BLOCKS, SPRING_M

from eol_ros.core.physics.builders import GRAVITY, NATURAL_M
from eol_ros.core.physics.twin import accelerometer
from eol_ros.core.physics.twin.accelerometer import MG, Accelerometers, Sensing
from eol_ros.core.physics.twin.live import SOFT, Coupling
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.table import Table
from eol_ros.settings import TwinSettings

IMAGE_S = 1 / 60
SETTINGS = TwinSettings(**SOFT._asdict())
QUIET = Sensing(noise_ug=0, offset_mg=0, rub_mg=0, rim_hits_per_min=0, footstep_mg=0)
NOBODY = np.zeros(N_BLOCKS, bool)


def play(seconds, samples, seed=1, settings=SETTINGS, sensing=QUIET, sensors=None):
    """Yield begin, table and samples of each image with visitors."""
    coupling = Coupling(*(getattr(settings, name) for name in Coupling._fields))
    play = Play(seed, samples, coupling)
    table, rim, sensors = play.table, play.rim, sensors or Accelerometers(settings, sensing=sensing)
    for _ in range(int(seconds / IMAGE_S)):
        begin_s = play.advance(IMAGE_S)
        moves = bool(rim.velocity.any())
        yield begin_s, table, sensors.advance(begin_s, play.time_s, table.trace, moves, NOBODY)


@pytest.fixture
def exact(monkeypatch):
    """Samples in mg, as they are before the sensor's steps."""
    monkeypatch.setattr(accelerometer, '_counts', lambda mg: mg)


@pytest.mark.slow
def test_looking_leaves_the_table_as_it_is():
    plays = [Play(4, samples) for samples in (0, 7, 64)]
    tables = [play.table for play in plays]
    for _ in range(300):
        for play in plays:
            play.advance(IMAGE_S)
    assert tables[0].slips > 5
    for table in tables[1:]:
        assert np.array_equal(table.x, tables[0].x) and np.array_equal(table.y, tables[0].y)
        assert table.energy_residual == tables[0].energy_residual
    assert tables[0].trace is None


def spring(table, way):
    length = np.hypot(*way)
    return table._scene.between.k[0] * (length - NATURAL_M) * way / length


def forces(table, u):
    """Spring forces (25, 2) on blocks displaced by `u`; the springs of the rim are left out."""
    pitch = BLOCK_SIDE_M + SPRING_M
    total = np.zeros((N_BLOCKS, 2))
    for i in range(N_BLOCKS):
        for j, rest in ((i + 1, (SPRING_M, 0.0)), (i + 5, (0.0, SPRING_M))):
            if j < N_BLOCKS and not (j == i + 1 and j % 5 == 0):
                pull = spring(table, np.array(rest) + u[j] - u[i])
                total[i] += pull
                total[j] -= pull
    assert pitch == pytest.approx(0.174)
    return total


@pytest.mark.slow
def test_samples_are_the_force_on_the_block_by_its_mass(exact):
    """Of inner blocks that slide all through a sample, from the springs between the blocks."""
    lively = Coupling(rotate=False)._asdict()  # inner blocks slide; the oracle rotates none
    settings = dataclasses.replace(SETTINGS, **lively)
    sensing = QUIET._replace(platform_kg=1000)  # others' knocks: 0.06 mg
    inner, errors = [6, 7, 8, 11, 12, 13, 16, 17, 18], []
    for begin_s, table, found in play(12, 128, settings=settings, sensing=sensing):
        trace = table.trace
        for s in found if trace is not None else ():
            if s.block not in inner or s.block in trace.event_block:
                continue
            mu = table._scene.kinetic_force[s.block] / (BLOCK_MASS_KG * GRAVITY)
            for n in range(1, len(s.xy), 9):
                time = s.first_s + n * s.period_s - begin_s
                rows = np.searchsorted(trace.t, [time - s.period_s, time])
                speed = trace.v[slice(*rows), s.block]
                if np.hypot(*speed.T).min() < 0.02:
                    continue
                middle = int(rows.sum()) // 2
                force = forces(table, trace.u[middle])[s.block]
                v = trace.v[middle, s.block]
                force -= mu * BLOCK_MASS_KG * GRAVITY * v / np.hypot(*v)
                errors.append(s.xy[n] - force / BLOCK_MASS_KG / MG)
    assert len(errors) > 100
    assert np.sqrt(np.mean(np.square(errors))) < 0.3  # mg; the oracle takes one moment for the mean


@pytest.mark.slow
def test_error_against_a_finer_step(exact):
    """At TRACE = 16 samples of the solver from image to image; stated in docs."""
    fine = [s for _, _, found in play(5, 512) for s in found]
    errors = {}
    for samples in (4, 16, 64):
        coarse = [s for _, _, found in play(5, samples) for s in found]
        pairs = {(s.block, s.first_s): s.xy for s in coarse}
        difference = [
            pairs[s.block, s.first_s] - s.xy for s in fine if (s.block, s.first_s) in pairs
        ]
        assert len(difference) > 0.95 * len(fine)
        errors[samples] = np.sqrt(np.mean(np.square(np.concatenate(difference))))
    print(errors)
    assert errors[64] < errors[16] < errors[4]
    assert errors[16] < 0.5  # mg, against 5.7 mg of noise


@pytest.mark.slow
def test_a_slip_begins_and_ends_with_a_shock(exact):
    """All at once up to (mu_s - mu_k) g; and a block that has stopped rings on its grit."""
    rings = starts = 0
    for begin_s, table, found in play(6, 128):
        trace = table.trace
        for s in found:
            own = trace.event_block == s.block if trace is not None else np.zeros(0, bool)
            if own.sum() != 1:
                continue
            t = float(trace.event_t[own][0])
            times = s.first_s + np.arange(len(s.xy)) * s.period_s - begin_s
            after = s.xy[times > t + s.period_s]
            before = s.xy[times < t]
            if len(after) < 3 or len(before) < 3:
                continue
            if trace.event_start[own][0]:
                starts += 1
                drop = (
                    (table._scene.static_limit - table._scene.kinetic_force)[s.block]
                    / BLOCK_MASS_KG
                    / MG
                )
                assert np.hypot(*after[0]) == pytest.approx(drop, rel=0.05)
                assert np.abs(before).max() < 10  # others' slips, through platform and springs
            else:
                rings += 1
                stopping = before[-2] / np.hypot(*before[-2])
                time = times[times > t + s.period_s] - 0.5 * s.period_s - t
                rate = 2 * np.pi * QUIET.grit_hz
                ring = np.cos(rate * time) - 0.1 * np.sin(rate * time)
                expected = np.hypot(*before[-2]) * ring * np.exp(-0.1 * rate * time)
                assert after @ stopping == pytest.approx(expected, rel=0.1, abs=15)
    assert rings > 5 and starts > 5


def test_at_rest_nothing_is_sampled_and_noise_and_offset_are_those_of_the_part():
    settings = TwinSettings()
    sensors = Accelerometers(settings)
    assert sensors.advance(0.0, 1.0, None, False, NOBODY) == []
    xy = sensors.at_rest(4000) / 16
    rms = xy.std(axis=1)
    assert rms == pytest.approx(np.hypot(220e-3 * 672**0.5, 4 / 12**0.5), rel=0.05)
    assert 25 < xy.mean(axis=1).std() < 55
    keep = NOBODY.copy()
    keep[3] = True
    (one,) = sensors.advance(1.0, 2.0, None, False, keep)
    assert one.block == 3 and len(one.xy) == pytest.approx(1 / one.period_s, abs=1)
    assert sensors.period_s.std() / sensors.period_s.mean() == pytest.approx(0.02, rel=0.4)


def test_a_sleeping_block_wakes_by_what_is_strong_enough():
    settings = dataclasses.replace(SETTINGS, seed=3)
    sensors = Accelerometers(settings, sensing=QUIET)
    sensors.asleep[:] = True
    woken = {}
    for _, _, found in play(4, 16, seed=3, sensors=sensors):
        for s in found:
            assert s.woken == (s.block not in woken)
            woken[s.block] = s
    assert woken and not sensors.asleep[list(woken)].any()
    assert sensors.asleep.any()


@pytest.mark.parametrize(
    'table', [Table(rows=3, columns=4), Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))]
)
def test_only_blocks_that_there_are_have_sensors(table):
    loud = QUIET._replace(rim_hits_per_min=6000, rim_hit_mg=200)
    for always in (False, True):
        sensors = Accelerometers(SETTINGS, always, table, loud)
        keep = np.zeros(table.cells, bool)
        found = set()
        for k in range(20):
            samples = sensors.advance(k * IMAGE_S, (k + 1) * IMAGE_S, None, True, keep)
            found |= {one.block for one in samples}
        assert found == set(table.ids.tolist())
    assert sensors.at_rest(4).shape == (table.cells, 4, 2)
