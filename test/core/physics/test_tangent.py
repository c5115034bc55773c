# SPDX-License-Identifier: Apache-2.0
"""The tangent of the exact path, against runs from starts that differ a little."""

import numpy as np
import pytest

from eol_ros.core.physics import builders, presets
from eol_ros.core.physics.choose import simulate
from eol_ros.core.physics.exact.tangent import tangent
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import ConfigError

PUSH_M = 1e-9


def differences(given, du):
    """The change at the end of two runs from starts that differ by du (n,) to either side."""
    ends = []
    for sign in (1, -1):
        moved = np.asarray(given['u0'], float) + sign * PUSH_M * np.column_stack([du, 0 * du])
        run = simulate(from_mapping(given | {'u0': moved.tolist()}), given['T'], ledger=False)
        ends.append((run.u[-1, :, 0], run.v[-1, :, 0], len(run.event_t)))
    (u1, v1, n1), (u2, v2, n2) = ends
    assert n1 == n2
    return (u1 - u2) / (2 * PUSH_M), (v1 - v2) / (2 * PUSH_M), n1


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'seconds', 'more', 'events', 'reversals'),
    [
        ('S2', 6.1, {}, 10, 0),
        ('S3L', 2.3, {}, 24, 0),  # ends amid slips
        ('S3L', 4.05, {}, 97, 0),
        ('S3L', 4.03, {'mu_k': 0.1}, 110, 12),  # blocks swing so far that they reverse
        ('S5', 4.6, {}, 40, 0),
    ],
)
def test_the_tangent_is_the_difference_of_neighbours(name, seconds, more, events, reversals):
    given = presets.scene(name) | {'T': seconds} | more
    du = np.random.default_rng(1).normal(size=given['n'])
    du /= np.linalg.norm(du)
    found = tangent(from_mapping(given), du, np.zeros(len(du)))
    size = np.exp(found.log_size[-1])
    u, v, count = differences(given, du)

    assert (found.events, found.reversals) == (count, reversals) and count == events
    np.testing.assert_allclose(found.du * size, u, rtol=0, atol=1e-6 * np.abs(u).max())
    scale = max(np.abs(v).max(), found.pace_hz * np.abs(u).max())
    np.testing.assert_allclose(found.dv * size, v, rtol=0, atol=1e-6 * scale)


def test_a_shift_of_all_blocks_is_a_delay_and_any_other_change_grows():
    """Under a plate, which pulls at all alike; one block knows of no other change."""
    five = from_mapping(presets.scene('S2') | {'T': 60.0})
    for scene, n in ((from_mapping(presets.scene('S1') | {'T': 60.0}), 1), (five, 5)):
        found = tangent(scene, np.ones(n), np.zeros(n))
        assert found.events > 30 and np.abs(found.log_size).max() < 8
        rate, error = found.exponent()
        assert abs(rate) < max(3 * error, 0.1)
    du = np.random.default_rng(1).normal(size=5)
    rate, error = tangent(five, du, np.zeros(5)).exponent()
    assert rate > 3 * error > 0


def test_the_size_of_the_change_given_does_not_matter():
    scene = from_mapping(presets.scene('S2') | {'T': 20.0})
    du = np.random.default_rng(1).normal(size=5)
    small, great = (tangent(scene, factor * du, np.zeros(5)) for factor in (1e-12, 1e3))
    np.testing.assert_allclose(small.log_size, great.log_size, atol=1e-9)


def test_other_scenes_are_refused():
    with pytest.raises(ConfigError, match='blocks along x with linear springs'):
        tangent(from_mapping(presets.scene('S4L')), np.ones(25), np.zeros(25))
    weak = builders.train(presets.PULL, 5.0, weakening={'speed': 0.1})
    with pytest.raises(ConfigError, match='constant friction'):
        tangent(from_mapping(weak), np.ones(5), np.zeros(5))
    still = from_mapping(builders.single(presets.PULL, 0.5))
    with pytest.raises(ConfigError, match='too few for a Lyapunov exponent'):
        tangent(still, np.ones(1), np.zeros(1)).exponent()
