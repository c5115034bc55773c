# SPDX-License-Identifier: Apache-2.0
"""Stiffness by hung weights: forces against the twin's own model, and twins nobody has told of."""

import math

import numpy as np
import pytest
from support import measured_twins
from support.paper import N_BLOCKS
from support.witness import spring_forces

from eol_ros.core.measure import springs
from eol_ros.core.measure.estimate import Estimate
from eol_ros.core.physics import builders
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.table import Table
from eol_ros.errors import EolError

NATURAL_M = 0.055
SEEN = np.ones(N_BLOCKS, bool)
WIDE = Table(rows=3, columns=4, gap_y_m=0.07, block_side_m=0.06)
HOLES = Table(absent=(0, 7, 9, 12))


def pulled_by_model(u, yaw, k=1.0, table=Table()):
    """Return the force (cells, 2) of all springs, by the model that the solvers run."""
    scene = from_mapping(
        builders.table({'kind': 'none'}, 1.0, k=k, natural_m=NATURAL_M, geometric=True,
                       rotation={'side': table.block_side_m}, shape=table)
    )  # fmt: skip
    by_id = np.zeros((table.cells, 2))
    by_id[table.ids] = spring_forces(scene, u[table.ids], 0.0, yaw[table.ids])
    return by_id


@pytest.mark.parametrize('table', [Table(), WIDE, HOLES])
def test_the_pull_of_springs_is_that_of_the_twin(table):
    random, cells = np.random.default_rng(3), table.cells
    u, yaw = random.normal(0, 0.005, (cells, 2)), random.normal(0, 0.1, cells)
    places = np.column_stack([table.rest + u, yaw])
    places[~table.present] = np.nan  # as of what is never seen
    wanted = pulled_by_model(u, yaw, table=table)
    found = [
        springs.pull_of_springs(places, block, NATURAL_M, table=table) for block in range(cells)
    ]
    np.testing.assert_allclose(found, wanted, atol=1e-14)


def hung(stiffness, friction, way, block=14, table=Table()):
    """Return rests and weights (kg) of a block that stands `way` (n,) m outwards."""
    out, rests = springs.outwards(block, table), []
    weights, still = [], np.zeros(table.cells)
    for k, moved in enumerate([0.0, *way]):
        u = np.zeros((table.cells, 2))
        u[block] = moved * out
        rests.append(springs.Rest(np.column_stack([table.rest + u, still]), k))
        held = friction * np.sign(moved - (way[k - 2] if k > 1 else 0.0))
        pull = -pulled_by_model(u, still, stiffness, table)[block] @ out
        weights.append((pull + held + 0.05) / builders.GRAVITY)  # the rim stands off a little
    return rests, weights[1:]


@pytest.mark.parametrize('table', [WIDE, HOLES])
def test_weights_at_any_table_give_its_stiffness(table):
    block = springs.usual(table)
    assert block == {WIDE: 7, HOLES: 14}[table]
    rests, weights = hung(81.0, 0.3, [0.004, 0.009, 0.02, 0.012, 0.006, 0.002], block, table)
    found = springs.fit(rests, weights, block, NATURAL_M, table)
    assert found.stiffness.value == pytest.approx(81.0, rel=1e-9)
    with pytest.raises(EolError, match='block 6 stands inside.* such as'):
        springs.outwards(6, table)
    finder = springs.Rests(block, table)
    places, seen = rests[0].places, table.present.copy()
    assert [finder.add(0.5 * k, places, seen) for k in range(9)][-1] is not None


@pytest.mark.parametrize('block', [14, 2, 0, 10, 22])
def test_weights_give_stiffness_and_what_friction_held(block):
    rests, weights = hung(81.0, 0.3, [0.004, 0.009, 0.02, 0.012, 0.006, 0.002], block)

    found = springs.fit(rests, weights, block, NATURAL_M)

    assert found.stiffness.value == pytest.approx(81.0, rel=1e-9)
    assert found.friction_n == pytest.approx(0.3, abs=1e-9)
    low, high = found.stiffness.interval(0.68)
    # the ruler alone: half a millimetre in the springs across, two in how the rim lies
    assert 0.003 < (high - low) / 2 / 81.0 < 0.02


def test_what_cannot_be_known_is_refused():
    rests, weights = hung(81.0, 0.3, [0.004, 0.009, 0.02, 0.012, 0.006])
    with pytest.raises(EolError, match='came to rest 5 times for 5 weights'):
        springs.fit(rests[1:], weights, 14, NATURAL_M)
    with pytest.raises(EolError, match='hang 5 or more'):
        springs.fit(rests[:4], weights[:3], 14, NATURAL_M)
    with pytest.raises(EolError, match='take the weights off'):
        springs.fit(*hung(81.0, 0.3, [0.004, 0.006, 0.008, 0.01, 0.012]), 14, NATURAL_M)
    with pytest.raises(EolError, match='in the order that was said'):
        springs.fit(rests, [weights[k] for k in (3, 4, 0, 1, 2)], 14, NATURAL_M)
    with pytest.raises(EolError, match='block 12 stands inside'):
        springs.outwards(12)


def test_rests_are_found_between_motions_and_not_on_the_way():
    random = np.random.default_rng(1)
    finder, told = springs.Rests(14), []
    time_s = 0.0
    # at rest; 1 mm a second for 6 s; at rest; 0.06 mm further, which is none; at rest; hidden
    for seconds, speed, seen in (
        (6, 0, True), (6, 1e-3, True), (9, 0, True), (0.3, 2e-4, True), (6, 0, True),
        (1, 3e-3, True), (6, 0, False), (3, 0, True),
    ):  # fmt: skip
        for _ in range(round(10 * seconds)):
            time_s += 1 / 10
            moved = (told[-1] if told else 0.0) + speed / 10
            told.append(moved)
            places = np.column_stack([Table().rest, np.zeros(N_BLOCKS)])
            places[14, 0] += moved
            places[:, :2] += random.normal(0, 9e-6, (N_BLOCKS, 2))
            there = SEEN.copy()
            there[13] = seen
            finder.add(time_s, places, there)
    along = [rest.places[14, 0] - Table().rest[14, 0] for rest in finder.found]
    np.testing.assert_allclose(along, [0.0, 0.006], atol=1e-4)


def test_intervals_are_those_of_student():
    estimate = Estimate(10.0, 2.0, 5)
    np.testing.assert_allclose(estimate.interval(0.95), [10 - 5.1412, 10 + 5.1412], atol=1e-3)
    np.testing.assert_allclose(Estimate(0.0, 1.0).interval(0.95), [-1.95996, 1.95996], atol=1e-4)
    # JCGM 100, G.4.1: degrees of freedom grow with the share that is known
    wider = estimate.widened(2.0)
    assert wider.sigma == pytest.approx(math.sqrt(8)) and wider.dof == pytest.approx(20)
    assert estimate.widened(0.0) == estimate


@pytest.mark.soak
def test_intervals_hold_as_often_as_they_say():
    twins = [measured_twins.Hung(seed) for seed in range(2000, 2100)]
    found = [measured_twins.measured_springs(twin).stiffness for twin in twins]
    held = measured_twins.held([(t.stiffness, s) for t, s in zip(twins, found, strict=True)])
    assert 59 <= held[0] <= 77 and held[1] >= 90
