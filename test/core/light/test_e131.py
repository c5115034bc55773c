# SPDX-License-Identifier: Apache-2.0
"""sACN: packets octet by octet against the table of the standard, and when they are sent."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eol_ros.core.light.e131 import AGAIN_S, MOST_HZ, Stream, mistakes, target
from eol_ros.settings import LedsSettings

CID = bytes(range(16))


def by_the_table(universe, priority, sequence, options, slots):
    """E1.31-2018, table 4-1: octet, size, field name, value."""
    end = 126 + len(slots)
    rows = [
        (0, 2, 'preamble size', 0x0010),
        (2, 2, 'post-amble size', 0x0000),
        (4, 12, 'ACN packet identifier', 0x4153432D45312E3137000000),
        (16, 2, 'flags and length', 0x7000 | (end - 16)),
        (18, 4, 'VECTOR_ROOT_E131_DATA', 0x00000004),
        (22, 16, 'CID', int.from_bytes(CID, 'big')),
        (38, 2, 'flags and length', 0x7000 | (end - 38)),
        (40, 4, 'VECTOR_E131_DATA_PACKET', 0x00000002),
        (44, 64, 'source name', int.from_bytes(b'Echoes of the Land'.ljust(64, b'\0'), 'big')),
        (108, 1, 'priority', priority),
        (109, 2, 'synchronization address', 0),
        (111, 1, 'sequence number', sequence),
        (112, 1, 'options', options),
        (113, 2, 'universe', universe),
        (115, 2, 'flags and length', 0x7000 | (end - 115)),
        (117, 1, 'VECTOR_DMP_SET_PROPERTY', 0x02),
        (118, 1, 'address type and data type', 0xA1),
        (119, 2, 'first property address', 0x0000),
        (121, 2, 'address increment', 0x0001),
        (123, 2, 'property value count', 1 + len(slots)),
        (125, 1, 'START code', 0x00),
    ]
    packet = bytearray(end)
    for at, size, _, value in rows:
        packet[at : at + size] = value.to_bytes(size, 'big')
    packet[126:] = slots
    return bytes(packet)


@pytest.mark.parametrize(('first', 'cells'), [(1, 25), (1, 225), (288, 225), (512, 1)])
def test_a_packet_is_that_of_the_standard(first, cells):
    stream = Stream(CID, 0x1234, first, 150, bytes(cells))
    levels = bytes((7 * k + 1) % 256 for k in range(cells))
    stream.take(levels, 0.0)
    slots = bytes(first - 1) + levels
    assert stream.due(0.0) == by_the_table(0x1234, 150, 0, 0, slots)
    assert stream.due(1.0) == by_the_table(0x1234, 150, 1, 0, slots)
    dark = bytes(len(slots))
    assert stream.end() == [by_the_table(0x1234, 150, k, 0x40, dark) for k in (2, 3, 4)]


def sent(changes, end_s, step_s=0.001):
    """Return (time, levels) of packets; changes as (time, level of the only block)."""
    stream, found, left = Stream(CID, 1, 1, 100, b'\0'), [], list(changes)
    for tick in range(round(end_s / step_s)):
        now_s = tick * step_s
        while left and left[0][0] <= now_s:
            stream.take(bytes([left.pop(0)[1]]), now_s)
        if packet := stream.due(now_s):
            found.append((now_s, packet[126]))
    return found


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 3), st.integers(1, 255)), max_size=300))
def test_no_more_than_44_a_second_and_the_last_level_is_never_lost(changes):
    changes.sort(key=lambda change: change[0])
    found = sent([*changes, (3.1, 9)], 4.0)
    times = np.array([at for at, _ in found])
    assert (np.diff(times) >= 1 / MOST_HZ - 1e-9).all()
    assert np.diff(times).max() < AGAIN_S + 0.002
    assert next(level for at, level in found if at > 3.13) == 9
    known = [*(level for _, level in changes), 9]
    at = 0
    for level in [
        level for _, level in found if level
    ]:  # what is sent is part of what leds said, in its order: no flash is added
        at = known.index(level, at)


def test_a_change_is_told_three_times_and_then_kept_alive():
    found = sent([(0.1 * k, 50 + k) for k in range(5)], 1.2)
    assert [level for at, level in found if at > 0.39] == [54] * 3
    assert [round(at, 2) for at, _ in found if at > 0.47] == []


def test_lights_whose_node_is_gone_go_out():
    found = sent([(0.0, 200), (0.5, 180)], 4.0)
    assert all(level for at, level in found if at < 3.0)
    assert not any(level for at, level in found if at > 3.05)


def test_what_is_refused():
    off, view, field = (
        LedsSettings(flash_limit=limit) for limit in ('false', 'field_of_view', 'field')
    )
    assert list(mistakes(488, field, 25, False)) == []
    assert [name for name, _ in mistakes(1, view, 25, False)] == ['sacn']
    assert [name for name, _ in mistakes(489, off, 25, False)] == ['sacn', 'first_channel']
    assert [name for name, _ in mistakes(1, None, 25, False)] == ['sacn']
    assert [name for name, _ in mistakes(1, field, 25, True)] == ['sacn']
    what = dict(mistakes(489, field, 25, False))['first_channel']
    assert what == '489 leaves 24 channels for 25 places: at most 488'


def test_a_receiver_may_leave_its_port_out():
    assert (target('10.0.0.9'), target('node:6000')) == ('10.0.0.9:5568', 'node:6000')
