# SPDX-License-Identifier: Apache-2.0
"""Slides of all blocks at once on stiff linear springs: exact modes, friction by collocation.

Where blocks go along together and vibrate against each other, a power series follows the fastest
vibration, which hardly moves anything. Here the springs are taken by their normal modes, which are
exact whatever the step, and what is left, friction and the rim, goes in by the variation of
constants (an exponential collocation method; Hochbruck and Ostermann, Acta Numerica 19, 2010):
as a polynomial through its values at Gauss nodes of the step, each mode's response to it in closed
form. The values hang on the motion that they make; they are worked out in rounds (Picard), each
better by mu_k g h / |v|. A step is 20 rad of the fastest vibration, twenty times a series' step.
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.event.averaged import Averaged, ledger_at, make_averaged, rim_at
from eol_ros.core.physics.event.sweep import fastest
from eol_ros.core.physics.event.taylor import force_on
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.series import uncounted
from eol_ros.core.vectors import WIDTH, lane_product, lane_response, lane_responses

LONG, SHORT = (20.0, 20), (6.0, 12)  # rad of the fastest vibration in a step, and nodes of it
NONE = (1.0, 1)  # where there are to be no such steps
FINE = 40  # nodes of the integrals that a response is made of
MOST_BLOCKS = 200  # the modes are dense
ROUNDS = 8
ANSWERS = 3  # of friction to the first change of its guess, before it is worked out again
FREE = 1e-12  # of the highest w^2: below it a mode has no spring at all
HASTE = 1.0  # times mu_k g h: slower blocks change direction too quickly for it
WAIT = 8  # steps after which a length that did not hold is tried again
WORTH = 4.0  # plain steps that one must be worth
APART = 0.5  # of the speed: how much it may change from node to node, and between blocks
ROUNDING = 4e-15  # of a place: an error of each step that stays below 1e-12 m over a slide


class Modes(NamedTuple):
    """Normal modes of all blocks, and how they respond to a force within a step; rows of lanes."""

    span: float  # s, the step
    w: np.ndarray  # (lanes,) 1/s
    to_blocks: np.ndarray  # (n, lanes) displacement of each block by each mode
    to_modes: np.ndarray  # (n, lanes) acceleration of each mode by each block's
    drive: np.ndarray  # (3, lanes) acceleration by the rim's x, cos(phi) - 1, sin(phi)
    even: np.ndarray  # (nodes + 1, lanes) cos(w t) at the nodes and the end,
    odd: np.ndarray  # sin(w t) / w,
    rise: np.ndarray  # (1 - cos(w t)) / w^2
    speed: np.ndarray  # ((nodes + 1) nodes, lanes) velocity at a node by the force at another
    place: np.ndarray  # displacement
    node: np.ndarray  # (nodes,) on 0..1
    weight: np.ndarray
    fit: np.ndarray  # (nodes, nodes) Legendre coefficients of the polynomial through the nodes
    fine: np.ndarray  # (2, fine) nodes and weights on 0..1
    reach: np.ndarray  # (lanes,) s^2: a mode's displacement at the end by an acceleration
    unseen: float  # m per m/s^2 in the first Legendre coefficient that is left out
    friction: np.ndarray  # (lanes,) mu_k g


class Work(NamedTuple):
    """What a step is worked out in; x rows of nodes above y rows."""

    push: np.ndarray  # (2 nodes, lanes) modes' acceleration by friction and rim
    rim: np.ndarray  # (2 nodes, lanes) by the rim alone
    free: np.ndarray  # (2 nodes, lanes) modes' velocity without either
    rate: np.ndarray  # (2 nodes, lanes) modes' velocity
    v: np.ndarray  # (2 nodes, lanes) blocks'
    n: np.ndarray  # (2 nodes, lanes) friction
    more: np.ndarray  # (2 nodes, lanes) by which the push is to change
    aside: np.ndarray  # (nodes, lanes) across the blocks' way: of that, with what it brings about,
    asked: np.ndarray  # without,
    swerve: np.ndarray  # and that itself
    across: np.ndarray  # (3, nodes) a unit vector across their way, and mu_k g / |v|
    start: np.ndarray  # (6, lanes) blocks' velocity, acceleration by springs and by friction
    begin: np.ndarray  # (6, lanes) the same of the modes
    terms: np.ndarray  # (2, nodes, lanes) response at a moment
    p: np.ndarray  # (nodes,)
    l: np.ndarray  # noqa: E741 Lagrange's polynomials at a moment
    y: np.ndarray  # (4, lanes) modes' displacement and velocity


class Stride(NamedTuple):
    """Steps of one length."""

    modes: Modes
    work: Work


class Glide(NamedTuple):
    """What slides of all blocks at once are worked out with."""

    long: Stride
    short: Stride
    ready: bool  # whether these two are there
    averaged: Averaged  # of equal blocks
    due: np.ndarray  # (3,) number of the step at which each is tried again, averaged ones last


def make_glide(at: Lattice, tolerance: float, averaged: bool = True) -> Glide:
    """Return the modes of all blocks of a lattice of linear springs, and arrays.

    Averaged steps are exact to `tolerance`. With `averaged`, and for equal blocks, what other steps
    need is left out.
    """
    n = at.n
    stiffness = np.diag(at.k_sum)
    i = np.repeat(np.arange(n), np.diff(at.lo))
    np.subtract.at(stiffness, (i, at.near), at.k_near)
    root = np.sqrt(at.mass)
    square, shape = np.linalg.eigh(stiffness / np.outer(root, root))
    w = np.sqrt(np.where(square > FREE * square[-1], square, 0.0))
    to_blocks = np.ascontiguousarray((shape / root[:, None]).T)
    to_modes = np.ascontiguousarray(shape * root[:, None])
    mean = make_averaged(at, w, to_blocks, to_modes, tolerance)
    ready = not (averaged and mean.possible)
    return Glide(
        _stride(at, w, to_blocks, to_modes, *(LONG if ready else NONE)),
        _stride(at, w, to_blocks, to_modes, *(SHORT if ready else NONE)),
        ready,
        mean,
        np.zeros(3, np.int64),
    )


def _stride(
    at: Lattice,
    w: np.ndarray,
    to_blocks: np.ndarray,
    to_modes: np.ndarray,
    angle: float,
    nodes: int,
) -> Stride:
    """Return the tables of one length of step, and arrays; rows in C order, as vectors want."""
    from scipy.special import spherical_jn  # the live table never comes here, and does without

    pad = [(0, 0), (0, -at.n % WIDTH)]
    w, to_blocks, to_modes = np.pad(w, pad[1]), np.pad(to_blocks, pad), np.pad(to_modes, pad)
    lanes, span = len(w), angle / w.max()
    x, weight = np.polynomial.legendre.leggauss(nodes)
    node, weight = 0.5 * (x + 1), 0.5 * weight
    y, share = np.polynomial.legendre.leggauss(FINE)
    y, share = 0.5 * (y + 1), 0.5 * share
    legendre = np.polynomial.legendre.legvander
    fit = (2 * np.arange(nodes) + 1)[:, None] * legendre(x, nodes - 1).T * weight
    ends = np.append(node, 1.0)
    values = legendre(2 * np.outer(ends, y) - 1, nodes - 1) @ fit
    values *= (span * ends)[:, None, None] * share[:, None]
    cosine, sine, _ = _swing(span * ends[:, None] * (1 - y), w)
    even, odd, rise = _swing(span * ends, w)
    slowest = 1 / np.maximum(w, 1 / span)
    modes = Modes(
        float(span),
        w,
        to_blocks,
        to_modes,
        (at.drive * at.inverse[:, None]).T @ to_modes,
        even,
        odd,
        rise,
        (values.transpose(0, 2, 1) @ cosine).reshape(-1, lanes),
        (values.transpose(0, 2, 1) @ sine).reshape(-1, lanes),
        node,
        weight,
        fit,
        np.stack((y, share)),
        span * np.minimum(0.5 * span, slowest),
        float(np.max(np.abs(spherical_jn(nodes, 0.5 * span * w)) * span * slowest)),
        np.pad(at.friction * at.inverse, pad[1]),
    )
    wide, narrow = (2 * nodes, lanes), (nodes, lanes)
    shapes = [wide] * 7 + [narrow] * 3 + [(3, nodes), (6, lanes), (6, lanes), (2, nodes, lanes)]
    arrays = [np.zeros(shape) for shape in [*shapes, (nodes,), (nodes,), (4, lanes)]]
    return Stride(modes, Work(*arrays))


def _swing(t: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cos(w t), sin(w t) / w and (1 - cos(w t)) / w^2, with a last axis for w."""
    angle = t[..., None] * w
    full = np.sinc(angle / np.pi)
    half = np.sinc(angle / (2 * np.pi))
    return np.cos(angle), t[..., None] * full, 0.5 * (t[..., None] * half) ** 2


@uncounted
def fast_enough(m, v, span, at, pl):
    """Return whether no sliding block is so slow that friction could stop it within `span` (s)."""
    for c in range(m):
        i = pl.slots[c]
        limit = HASTE * at.friction[i] * at.inverse[i] * span
        if v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] < limit * limit:
            return False
    return True


@uncounted
def would_glide(m, v, plain, h, at, pl):
    """Return whether steps by modes, of at most `h` (s), are worth many of `plain` (s)."""
    if at.geometric or at.rail or m < at.n or m < 2 or m > MOST_BLOCKS:
        return False
    square = fastest(m, at, pl)
    if square == 0.0:
        return False
    x = y = 0.0
    for c in range(m):
        i = pl.slots[c]
        x, y = x + v[i, 0] / m, y + v[i, 1] / m
    for c in range(m):  # else friction reverses, and sweeps are for that
        i = pl.slots[c]
        a, b = v[i, 0] - x, v[i, 1] - y
        if a * a + b * b > APART * APART * (x * x + y * y):
            return False
    span = SHORT[0] / np.sqrt(square)
    return WORTH * plain < span <= h and fast_enough(m, v, span, at, pl)


@uncounted
def glide_step(u, v, used, at, gl, cx, cy, cc, cs, small):
    """Work out a step of modes.span; return whether it holds.

    `work.push` then has what moves the modes, `work.begin` how they start, `work.v` the blocks'
    velocity at the nodes.
    """
    mo, wo = gl.modes, gl.work
    nodes = len(mo.node)
    n, lanes, h = at.n, len(mo.w), mo.span
    start, begin = wo.start, wo.begin
    far = last = 0.0
    for i in range(n):  # the first guess: friction as at the start, whose response is closed
        far = max(far, max(abs(u[i, 0]), abs(u[i, 1])))
        x, y = force_on(i, u, at, cx[0], cy[0], cc[0], cs[0])
        inverse = -mo.friction[i] / np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + 1e-200)
        start[0, i], start[1, i] = v[i, 0], v[i, 1]
        start[2, i], start[3, i] = x * at.inverse[i], y * at.inverse[i]
        start[4, i], start[5, i] = v[i, 0] * inverse, v[i, 1] * inverse
    lane_product(begin, start, 6, mo.to_modes, 0, n)
    for j in range(nodes):
        p = nodes + j
        x, y, c, r = rim_at(mo.node[j] * h, used, cx, cy, cc, cs)
        for k in range(lanes):
            wo.rim[j, k] = mo.drive[0, k] * x + mo.drive[1, k] * c - mo.drive[2, k] * r
        for k in range(lanes):
            wo.rim[p, k] = mo.drive[0, k] * y + mo.drive[1, k] * r + mo.drive[2, k] * c
        for k in range(lanes):
            wo.free[j, k] = begin[0, k] * mo.even[j, k] + begin[2, k] * mo.odd[j, k]
        for k in range(lanes):
            wo.free[p, k] = begin[1, k] * mo.even[j, k] + begin[3, k] * mo.odd[j, k]
        for k in range(lanes):
            wo.push[j, k] = begin[4, k] + wo.rim[j, k]
        for k in range(lanes):
            wo.push[p, k] = begin[5, k] + wo.rim[p, k]
        for k in range(lanes):
            wo.rate[j, k] = wo.free[j, k] + begin[4, k] * mo.odd[j, k]
        for k in range(lanes):
            wo.rate[p, k] = wo.free[p, k] + begin[5, k] * mo.odd[j, k]
    small = max(small, ROUNDING * far)
    for p in range(ROUNDS):
        if p > 0:
            lane_responses(wo.rate, mo.speed, wo.push, nodes)
            for j in range(2 * nodes):
                for k in range(lanes):
                    wo.rate[j, k] += wo.free[j, k]
        lane_product(wo.v, wo.rate, 2 * nodes, mo.to_blocks, 0, n)
        if not friction_along(n, gl):
            return False
        lane_product(wo.more, wo.n, 2 * nodes, mo.to_modes, 0, n)
        for k in range(lanes):
            wo.y[0, k] = 0.0
        for j in range(2 * nodes):
            for k in range(lanes):
                wo.more[j, k] += wo.rim[j, k] - wo.push[j, k]
            for k in range(lanes):
                wo.y[0, k] = max(wo.y[0, k], abs(wo.more[j, k]))
        left = 0.0
        for k in range(lanes):
            left = max(left, wo.y[0, k] * mo.reach[k])
        answer(ANSWERS if p == 0 else ANSWERS - 1, n, gl)
        if p > 0:  # what is left after this round, by how much the last one gained
            if left * left <= small * last:
                return resolved(small, n, gl)
            if left > 0.3 * last:
                return False
        last = left
    return False


@uncounted
def friction_along(n, gl):
    """Write the friction at all nodes; False where a block may stop or reverse between two."""
    mo, wo = gl.modes, gl.work
    nodes = len(mo.node)
    lanes = len(mo.w)
    v, y = wo.v, wo.y
    for k in range(lanes):
        y[0, k], y[1, k] = np.inf, 0.0
    for j in range(nodes):
        r = nodes + j
        for k in range(lanes):
            square = v[j, k] * v[j, k] + v[r, k] * v[r, k]
            y[0, k] = min(y[0, k], square)
            inverse = -mo.friction[k] / np.sqrt(square + 1e-200)
            wo.n[j, k], wo.n[r, k] = v[j, k] * inverse, v[r, k] * inverse
        if j > 0:
            for k in range(lanes):
                x, z = v[j, k] - v[j - 1, k], v[r, k] - v[r - 1, k]
                y[1, k] = max(y[1, k], x * x + z * z)
    for k in range(n):
        limit = HASTE * mo.friction[k] * mo.span
        if y[0, k] < limit * limit or y[1, k] > APART * APART * y[0, k]:
            return False
    return True


@uncounted
def answer(rounds, n, gl):
    """Add `work.more` to the push of the modes, and how friction answers it.

    As if all blocks went along together: then friction across their way is mu_k g / |v| times the
    velocity across, for each mode by itself.
    """
    mo, wo = gl.modes, gl.work
    nodes = len(mo.node)
    lanes = len(mo.w)
    total = 0.0
    for i in range(n):
        total += mo.friction[i]
    for j in range(nodes):
        x = y = 0.0
        for i in range(n):
            x += wo.v[j, i]
            y += wo.v[nodes + j, i]
        size = np.sqrt(x * x + y * y) + 1e-200
        wo.across[0, j], wo.across[1, j], wo.across[2, j] = -y / size, x / size, total / size
        x, y = -y / size, x / size
        for k in range(lanes):
            wo.asked[j, k] = x * wo.more[j, k] + y * wo.more[nodes + j, k]
        for k in range(lanes):
            wo.aside[j, k] = wo.asked[j, k]
    for _ in range(rounds):
        lane_response(wo.swerve, mo.speed, wo.aside, nodes)
        for j in range(nodes):
            for k in range(lanes):
                wo.swerve[j, k] *= wo.across[2, j]
            for k in range(lanes):
                wo.aside[j, k] = wo.asked[j, k] - wo.swerve[j, k]
    for j in range(nodes):
        a, b = wo.across[0, j], wo.across[1, j]
        for k in range(lanes):
            wo.push[j, k] += wo.more[j, k] - a * wo.swerve[j, k]
        for k in range(lanes):
            wo.push[nodes + j, k] += wo.more[nodes + j, k] - b * wo.swerve[j, k]


@uncounted
def resolved(small, n, gl):
    """Return whether what the nodes do not see of friction moves no block by `small` (m).

    Twice as high as its last Legendre coefficient is what they take for the mean.
    """
    mo, wo = gl.modes, gl.work
    nodes = len(mo.node)
    most, first = 0.0, 1e-300
    for q in range(2):
        for k in range(n):
            first = max(first, abs(wo.n[q * nodes, k] - wo.n[q * nodes + nodes - 1, k]))
    for r in range(nodes - 2, nodes):
        for q in range(2):
            for k in range(len(mo.w)):
                wo.y[q, k] = 0.0
            for j in range(nodes):
                for k in range(len(mo.w)):
                    wo.y[q, k] += mo.fit[r, j] * wo.n[q * nodes + j, k]
            for k in range(n):
                most = max(most, abs(wo.y[q, k]))
    return mo.unseen * most + 0.5 * mo.span * mo.span * most * most / first <= small


@uncounted
def respond(s, gl):
    """Write into work.y the modes' displacement and velocity at s, 0 <= s <= modes.span."""
    mo, wo = gl.modes, gl.work
    nodes = len(mo.node)
    lanes, terms = len(mo.w), wo.terms
    for j in range(nodes):
        for k in range(lanes):
            terms[0, j, k] = terms[1, j, k] = 0.0
    for g in range(FINE):
        x = 2.0 * mo.fine[0, g] * s / mo.span - 1.0
        for j in range(nodes):
            wo.l[j] = 0.0
        wo.p[0], wo.p[1] = 1.0, x
        for r in range(2, nodes):
            wo.p[r] = ((2 * r - 1) * x * wo.p[r - 1] - (r - 1) * wo.p[r - 2]) / r
        for r in range(nodes):
            for j in range(nodes):
                wo.l[j] += mo.fit[r, j] * wo.p[r]
        weight, left = mo.fine[1, g] * s, s * (1.0 - mo.fine[0, g])
        for k in range(lanes):
            w = mo.w[k]
            wo.y[0, k] = weight * np.cos(w * left)
            wo.y[1, k] = weight * (np.sin(w * left) / w if w > 0.0 else left)
        for j in range(nodes):
            for k in range(lanes):
                terms[0, j, k] += wo.l[j] * wo.y[0, k]
                terms[1, j, k] += wo.l[j] * wo.y[1, k]
    for k in range(lanes):
        w = mo.w[k]
        half = np.sin(0.5 * w * s)
        even, odd, rise = 1.0 - 2.0 * half * half, s, 0.5 * s * s
        if w > 0.0:
            odd, rise = np.sin(w * s) / w, 2.0 * half * half / (w * w)
        for q in range(2):
            x = wo.begin[q, k] * odd + wo.begin[2 + q, k] * rise
            d = wo.begin[q, k] * even + wo.begin[2 + q, k] * odd
            for j in range(nodes):
                x += terms[1, j, k] * wo.push[q * nodes + j, k]
                d += terms[0, j, k] * wo.push[q * nodes + j, k]
            wo.y[q, k], wo.y[2 + q, k] = x, d


@uncounted
def respond_at(j, gl):
    """Do what `respond` does at node j; that of number nodes is the end."""
    mo, wo = gl.modes, gl.work
    nodes = len(mo.node)
    for q in range(2):
        for k in range(len(mo.w)):
            wo.y[q, k] = wo.begin[q, k] * mo.odd[j, k] + wo.begin[2 + q, k] * mo.rise[j, k]
            wo.y[2 + q, k] = wo.begin[q, k] * mo.even[j, k] + wo.begin[2 + q, k] * mo.odd[j, k]
        for e in range(nodes):
            for k in range(len(mo.w)):
                wo.y[q, k] += mo.place[j * nodes + e, k] * wo.push[q * nodes + e, k]
                wo.y[2 + q, k] += mo.speed[j * nodes + e, k] * wo.push[q * nodes + e, k]


@uncounted
def to_state(u, at, gl, u_out, v_out):
    """Write what work.y says of the blocks, which were at `u`."""
    mo, y = gl.modes, gl.work.y
    for i in range(at.n):
        u_out[i, 0], u_out[i, 1] = u[i, 0], u[i, 1]
        v_out[i, 0] = v_out[i, 1] = 0.0
    for q in range(2):
        for k in range(at.n):
            x, d = y[q, k], y[2 + q, k]
            for i in range(at.n):
                u_out[i, q] += mo.to_blocks[k, i] * x
                v_out[i, q] += mo.to_blocks[k, i] * d


@uncounted
def glide_ledger(u, used, at, gl, cx, cy, cc, cs, energy, here, rate):
    """Add the drive work and the friction heat (J) of a step to `energy`."""
    mo = gl.modes
    for j in range(len(mo.node)):
        respond_at(j, gl)
        to_state(u, at, gl, here, rate)
        weight = mo.weight[j] * mo.span
        ledger_at(mo.node[j] * mo.span, weight, used, at, cx, cy, cc, cs, energy, here, rate)


@uncounted
def glide_on(
    t,
    h,
    u,
    v,
    m,
    used,
    at,
    gl,
    pl,
    cx,
    cy,
    cc,
    cs,
    small,
    grid,
    sampled,
    ledger,
    energy,
    here,
    rate,
):
    """Go on by modes.span where that is at most `h` and holds; return the count of samples, or -1.

    Samples, energies and the state are written as the event path's kernel has them.
    """
    mo = gl.modes
    if mo.span > h or not fast_enough(m, v, mo.span, at, pl):
        return -1
    if not glide_step(u, v, used, at, gl, cx, cy, cc, cs, small):
        return -1
    while sampled < len(grid.t) and grid.t[sampled] <= t + mo.span:
        respond(grid.t[sampled] - t, gl)
        to_state(u, at, gl, grid.u[sampled], grid.v[sampled])
        sampled += 1
    if ledger:
        glide_ledger(u, used, at, gl, cx, cy, cc, cs, energy, here, rate)
    respond_at(len(mo.node), gl)
    to_state(u, at, gl, u, v)
    return sampled
