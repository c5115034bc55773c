# SPDX-License-Identifier: Apache-2.0
"""TUIO frames against what the specifications say of objects that move as the test says."""

import math

import numpy as np
import pytest

from eol_ros.core.table import Table
from eol_ros.core.tuio import REFRESH_S, Tokens, tuio1, tuio2

TABLE = Table(platform_m=(1.6, 1.2))
HZ = 60.0


def still():
    return np.column_stack([TABLE.rest, np.zeros(TABLE.cells)])


def test_corners_of_the_platform_and_angles():
    poses, half = np.full((25, 3), np.nan), math.pi / 2
    poses[:4] = [
        (-0.8, 0.6, 0),
        (0.8, -0.6, -half),
        (0, 0, half),
        (0, 0, 14 * half),
    ]
    frame = Tokens(TABLE).frame(10.0, poses)
    assert frame.number == 1 and frame.alive == (1, 2, 3, 4)
    assert [token.block for token in frame.tokens] == [0, 1, 2, 3]
    found = np.array([token.values for token in frame.tokens])
    expected = [(0, 0, 0), (1, 1, half), (0.5, 0.5, 3 * half), (0.5, 0.5, 2 * half)]
    assert found[:, :3] == pytest.approx(np.array(expected))
    assert (found[:, 3:] == 0).all()


def test_velocities_and_accelerations():
    """Block 7 speeds up from rest by 2 m/s2 to the right; block 8 turns by half a turn a second."""
    tokens, last = Tokens(TABLE), {}
    for k in range(31):
        t = k / HZ
        poses = still()
        poses[7, 0] += t**2
        poses[8, 2] -= math.pi * t  # clockwise
        frame = tokens.frame(100 + t, poses)
        if k:
            assert {token.block for token in frame.tokens} <= {7, 8}
        last |= {token.block: token.values for token in frame.tokens}
    x, _, _, vx, vy, va, m, r = last[7]
    assert x == pytest.approx(0.5 + (TABLE.rest[7, 0] + 0.25) / 1.6)
    assert vx == pytest.approx((1.0 - 1 / HZ) / 1.6, rel=1e-6) and vy == va == r == 0
    assert m == pytest.approx(2.0 / 1.6, rel=1e-6)
    assert last[8][5] == pytest.approx(0.5) and last[8][3] == 0
    assert last[8][2] == pytest.approx(math.pi / 2)
    stopped = [tokens.frame(100.5 + k / HZ, poses) for k in range(1, 20)]
    told = [token for frame in stopped for token in frame.tokens]
    assert sorted(token.block for token in told) == [7, 8]  # once each
    assert all(not any(token.values[3:6]) for token in told)
    assert next(t for t in told if t.block == 7).values[6] < 0


@pytest.mark.parametrize('speed', [0.005, 0.02, 0.5])
def test_a_slow_block_has_its_speed_and_one_at_rest_none(speed):
    rng, tokens, told = np.random.default_rng(1), Tokens(TABLE), []
    for k in range(120):
        poses = still()
        poses[3, 1] += speed * k / HZ
        poses += rng.normal(0, 2e-5, poses.shape)
        told += tokens.frame(k / HZ, poses).tokens if k else ()
    assert {token.block for token in told if any(token.values[3:6])} == {3}
    found = [token.values[4] for token in told if token.block == 3 and token.values[4]]
    assert np.median(found) == pytest.approx(-speed / 1.2, rel=0.1)


def test_sessions_and_refresh():
    tokens, poses = Tokens(TABLE), still()
    assert tokens.frame(0.0, poses).alive == tuple(range(1, 26))
    poses[4] = np.nan
    gone = tokens.frame(0.1, poses)
    assert 5 not in gone.alive and len(gone.alive) == 24 and gone.tokens == ()
    back = tokens.frame(0.2, still())
    assert [(t.session, t.block) for t in back.tokens] == [(26, 4)] and 26 in back.alive
    assert len(tokens.frame(REFRESH_S, still()).tokens) == 25  # all of them: datagrams get lost
    assert tokens.frame(REFRESH_S + 0.1, still()).tokens == ()
    tokens.forget()  # time jumped back
    again = tokens.frame(0.3, still())
    assert again.alive == tuple(range(27, 52)) and len(again.tokens) == 25
    assert not any(any(token.values[3:]) for token in again.tokens)
    ring = Table(absent=(12,))
    rest = np.column_stack([ring.rest, np.zeros(25)])
    rest[12] = np.nan
    assert len(Tokens(ring).frame(0.0, rest).alive) == 24


def test_the_messages_of_both_versions():
    poses = np.full((25, 3), np.nan)
    poses[6] = 0.4, 0.3, 0.0
    frame = Tokens(TABLE).frame(0.0, poses)
    at = (0.75, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert tuio1(frame, 'eol', '10.0.0.1') == [
        ('/tuio/2Dobj', 'source', 'eol@10.0.0.1'),
        ('/tuio/2Dobj', 'alive', 1),
        ('/tuio/2Dobj', 'set', 1, 6, *at),
        ('/tuio/2Dobj', 'fseq', 1),
    ]
    assert tuio2(frame, 99, (1.6, 1.2), 'eol', '10.0.0.1') == [
        ('/tuio2/frm', 1, 99, 1600 << 16 | 1200, 'eol:0@0x0A000001'),
        ('/tuio2/tok', 1, 0, 6, *at),
        ('/tuio2/alv', 1),
    ]
