# SPDX-License-Identifier: Apache-2.0
"""The blocks as TUIO 1.1 objects and TUIO 2.0 tokens: poses and what follows from them.

Kaltenbrunner, "TUIO 1.1 Protocol Specification" and "TUIO 2.0 Protocol Specification", tuio.org.
Positions are 0..1 over the platform, from its back left corner, y towards the front. Angles are
clockwise, 0..2 pi. Velocities are in widths, depths and turns a second, and accelerations are the
change of their amount by time, as in the reference implementations.
"""

import ipaddress
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.table import Table

REST_S = 0.1  # without a change, after which a block rests (chosen: 3 mm/s is seen to move)
REFRESH_S = 1.0  # period at which all objects are sent again: datagrams may be lost
STEP_M, STEP_RAD = 0.0003, 0.003  # least change of a pose (chosen: above its noise)
MOST = 2**31  # ids and numbers of frames begin again there

Message = tuple[object, ...]  # address, value, ...


@dataclass(frozen=True)
class Token:
    """One block; values: x, y, angle, their velocities, motion and rotation acceleration."""

    session: int
    block: int
    values: tuple[float, ...]


@dataclass(frozen=True)
class Frame:
    """What one image changed: `tokens`; `alive` are the sessions of all blocks that are known."""

    number: int
    alive: tuple[int, ...]
    tokens: tuple[Token, ...]


class Tokens:
    """Feed it the poses of each image; it returns frames.

    A block that was not known gets a new session.
    """

    def __init__(self, table: Table):
        width, depth = table.platform_m
        self._scale = np.array([1 / width, -1 / depth, -1 / math.tau])  # m, m, rad to turns
        self._step = np.array([STEP_M, STEP_M, STEP_RAD]) * np.abs(self._scale)
        self._sessions, self._frames = itertools.count(1), itertools.count(1)
        self._session = np.zeros(table.cells, int)  # 0: not known
        self._at = np.zeros((table.cells, 3))  # as told: x, y, turns
        self._speed = np.zeros((table.cells, 3))
        self._growth = np.zeros((table.cells, 2))  # accelerations
        self._since_s = np.zeros(table.cells)  # when it was told, or rested last
        self._refresh_s = -math.inf

    def frame(self, stamp_s: float, poses: np.ndarray) -> Frame:
        """Return what poses (cells, 3) in m and rad at a time say; NaN is not known."""
        at = poses * self._scale + (0.5, 0.5, 0.0)
        known = np.isfinite(at).all(axis=1)
        new, goes_on = known & (self._session == 0), known & (self._session > 0)
        self._session[~known] = 0
        for block in np.flatnonzero(new):
            self._session[block] = next(self._sessions) % MOST
        self._at[new], self._speed[new], self._growth[new] = at[new], 0.0, 0.0
        self._since_s[new] = stamp_s
        span_s = stamp_s - self._since_s
        with np.errstate(invalid='ignore'):
            moves = goes_on & (span_s > 0) & (np.abs(at - self._at) > self._step).any(axis=1)
        stops = goes_on & ~moves & (span_s >= REST_S) & self._speed.any(axis=1)
        self._change(moves, at, span_s)
        self._change(stops, self._at, span_s)
        rests = goes_on & ~moves & ~self._speed.any(axis=1)
        self._since_s[moves | stops | rests] = stamp_s
        self._growth[rests & ~stops] = 0.0
        told = new | moves | stops
        if not 0 <= stamp_s - self._refresh_s < REFRESH_S:
            told, self._refresh_s = known, stamp_s
        return Frame(
            next(self._frames) % MOST,
            tuple(self._session[known].tolist()),
            tuple(self._token(block) for block in np.flatnonzero(told).tolist()),
        )

    def forget(self) -> None:
        """Take all blocks for new: time has jumped."""
        self._session[:] = 0

    def _change(self, which: np.ndarray, at: np.ndarray, span_s: np.ndarray) -> None:
        span = span_s[which, None]
        before = self._speed[which]
        speed = (at[which] - self._at[which]) / span
        motion = elementary.hypot(*speed[:, :2].T) - elementary.hypot(*before[:, :2].T)
        self._growth[which] = np.stack([motion, speed[:, 2] - before[:, 2]], axis=1) / span
        self._at[which], self._speed[which] = at[which], speed

    def _token(self, block: int) -> Token:
        x, y, turns = self._at[block].tolist()
        values = x, y, turns % 1.0 * math.tau, *self._speed[block], *self._growth[block]
        return Token(int(self._session[block]), block, tuple(map(float, values)))


def tuio1(frame: Frame, name: str, address: str) -> list[Message]:
    """Return the messages of a bundle of TUIO 1.1: profile 2Dobj."""
    of = '/tuio/2Dobj'
    return [
        (of, 'source', f'{name}@{address}'),
        (of, 'alive', *frame.alive),
        *((of, 'set', t.session, t.block, *t.values) for t in frame.tokens),
        (of, 'fseq', frame.number),
    ]


def tuio2(
    frame: Frame, time_tag: int, platform_m: Sequence[float], name: str, address: str
) -> list[Message]:
    """Return the messages of a bundle of TUIO 2.0; the dimension is that of the platform in mm."""
    width, depth = (round(1000 * side) for side in platform_m)
    number = int(ipaddress.ip_address(address)) % 2**32
    return [
        ('/tuio2/frm', frame.number, time_tag, width << 16 | depth, f'{name}:0@0x{number:08X}'),
        *(('/tuio2/tok', t.session, 0, t.block, *t.values) for t in frame.tokens),
        ('/tuio2/alv', *frame.alive),
    ]
