# SPDX-License-Identifier: Apache-2.0
"""The lattice of the table, against the sums of the paper's own sizes."""

import numpy as np
import pytest

from eol_ros.core.geometry import SPRING_M, neighbours, rest_lattice, spring_ends

REST = np.column_stack([rest_lattice(), np.zeros(25)])


def lengths(ends):
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def test_all_springs_are_as_long_as_they_were_installed():
    assert lengths(spring_ends(REST)) == pytest.approx([SPRING_M] * 40)
    ends = spring_ends(REST, np.zeros(3))
    assert lengths(ends) == pytest.approx([SPRING_M] * 60)
    assert np.abs(ends[40:, 1]).max(axis=1) == pytest.approx([0.48] * 20)  # on the rim of 96 cm


def test_springs_join_neighbours():
    at = rest_lattice()
    pairs = {
        tuple(sorted(int(np.linalg.norm(at - end, axis=1).argmin()) for end in spring))
        for spring in spring_ends(REST)
    }
    assert pairs == {(i, j) for i in range(25) for j in neighbours(i) if i < j}


def test_a_table_that_is_carried_off_has_springs_of_the_same_length():
    yaw, shift = 0.3, np.array([0.1, -0.05])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    moved = np.column_stack([rest_lattice() @ turn.T + shift, np.full(25, yaw)])
    ends = spring_ends(moved, np.array([*shift, yaw]))
    assert ends == pytest.approx(spring_ends(REST, np.zeros(3)) @ turn.T + shift)


def test_a_block_that_turns_takes_the_ends_of_its_own_springs_along():
    turned = REST.copy()
    turned[12, 2] = 0.2
    moved = np.any(spring_ends(turned, np.zeros(3)) != spring_ends(REST, np.zeros(3)), axis=2)
    assert moved.sum() == 4 and moved[:40].sum() == 4
    assert np.isnan(spring_ends(np.full((25, 3), np.nan))).all()
