# SPDX-License-Identifier: Apache-2.0
"""Limits of messages at tables of several sizes and shapes."""

import numpy as np
import pytest
from eol_msgs.msg import BlockTap, Cascade, GrainTrigger, LedCommand, Slip, Truth

from eol_ros.core.table import Table
from eol_ros.ros.definitions import definition
from eol_ros.streams.checks import Check
from eol_ros.streams.triggers import NO_BLOCK

RING = Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))


def wrong(message, table):
    """Return what the check of a message says."""
    name = f'eol_msgs/msg/{type(message).__name__}'
    return Check(name, definition(name), table)(message)


@pytest.mark.parametrize('table', [Table(), Table(rows=3, columns=4), RING, Table(15, 15)])
def test_blocks_are_those_of_the_table(table):
    there = set(table.ids.tolist())
    for block in {*range(table.cells + 1), NO_BLOCK}:
        for message in (Slip(kind=1, block=block), BlockTap(block=block)):
            assert wrong(message, table) == ('' if block in there else f'block is {block}')
        assert (wrong(GrainTrigger(block=block), table) == '') == (block in {*there, NO_BLOCK})
    all_of_them = Cascade(nucleus=1, area=table.count, blocks=table.ids.tolist())

    assert wrong(all_of_them, table) == ''
    all_of_them.blocks = [*all_of_them.blocks, 0]
    all_of_them.area += 1
    assert wrong(all_of_them, table) == f'area is {table.count + 1}'


def test_arrays_have_an_item_for_each_place():
    table = Table(rows=3, columns=4)
    twelve = np.zeros(12)

    assert wrong(LedCommand(white=bytes(12)), table) == ''
    assert wrong(LedCommand(white=bytes(25)), table) == 'white has 25 items, the table 12 places'
    truth = Truth(x=twelve, y=twelve, yaw=twelve, moving=[False] * 12)
    assert wrong(truth, table) == ''
    truth.moving = [False] * 11
    assert wrong(truth, table) == 'moving has 11 items, the table 12 places'
