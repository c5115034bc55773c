# SPDX-License-Identifier: Apache-2.0
"""Slides of equal blocks that go along together, with friction averaged over their vibrations.

Stiff linear springs tie equal blocks into a whole that goes along at V, while they vibrate against
each other by little. Friction, -F v/|v| with F = mu_k g, acts against their way, whatever vibrates
along it; what vibrates across, it damps at the rate c = F / V. So the motion of the whole and the
amplitudes of the vibrations are slow, and a step may be as long as V changes little: milliseconds,
in place of some rad of the fastest vibration. By averaging (Sanders, Verhulst and Murdock,
Averaging Methods in Nonlinear Dynamical Systems, 2nd ed., ch. 2 and 6), with P the projection
across the way, a mode of frequency w off its rest is the real part of

    M (1 + i N / w) Z exp(i w t),   M' = -c P M / 2,   N' = -M^-1 ((c P)' / 4 + c^2 P / 8) M,

M and N being the same for all modes; and of friction on the whole vibrations with velocities d
along and across the way leave, on the average over blocks and phases,

    along: -F (1 - <d_across^2> / (2 V^2)),   across: F <d_along d_across> / V^2.

The rest that modes vibrate about is what the rim's pull holds them to, that pull / w^2.
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.series import uncounted

NODES = 10  # of the polynomials of a step, in Gauss's places
ROUNDS = 40
ALIKE = 1e-5  # how equal blocks have to be, and how evenly the slowest mode moves them
GAP = 30.0  # times the frequency of the whole: at least that of every vibration
SLOWER = 0.3  # of V: how much it may change in a step
LASTING = 1.0  # times V / F: a step at most
SWUNG = 0.5  # rad of the motion of the whole: a step at most
RESONANT = 0.01  # of the third power of d: what of it does not average out
NEXT = 1.0 / 16.0  # times (c / w)^3 d / w: what the next term of the averages would add
SETTLED_M, STALLED_M = 1e-17, 1e-15  # a round that changes so little is the last one
X, V, M, N, STATE = 0, 2, 4, 8, 12  # where a state has its parts, and its length


class Averaged(NamedTuple):
    """The modes of a lattice, mode 0 the motion of the whole, and arrays to work in."""

    possible: bool
    small: float  # m: the error of a step
    friction: float  # mu_k g
    w: np.ndarray  # (n,) 1/s
    to_blocks: np.ndarray  # (n, n) displacement of each block by each mode, a row a mode
    to_modes: np.ndarray  # (n, n) acceleration of each mode by each block's, a row a block
    drive: np.ndarray  # (3, n) acceleration by the rim's x, cos(phi) - 1, sin(phi)
    share: np.ndarray  # (n,) mean square of a mode over the blocks
    pushed: float  # acceleration of mode 0 by one of all blocks
    moved: float  # displacement of the blocks by mode 0
    node: np.ndarray  # (NODES,) on 0..1
    weight: np.ndarray
    inner: np.ndarray  # (NODES + 1, NODES) integrals to the nodes, and to 1
    fit: np.ndarray  # (NODES, NODES) Legendre coefficients of the polynomial through the nodes
    begin: np.ndarray  # (STATE,) x and v of mode 0, M and N
    at_node: np.ndarray  # (NODES, STATE)
    slope: np.ndarray  # (NODES, STATE)
    now: np.ndarray  # (STATE,)
    spread: np.ndarray  # (3,) <d_x d_x>, <d_x d_y>, <d_y d_y> at the beginning
    swing: np.ndarray  # (4, n) Z: real parts, x and y, and minus w times the imaginary ones
    q: np.ndarray  # (4, n) modes' displacement and velocity


def make_averaged(
    at: Lattice, w: np.ndarray, to_blocks: np.ndarray, to_modes: np.ndarray, tolerance: float
) -> Averaged:
    """Return the modes of a lattice, given as `glide.make_glide` finds them, and arrays.

    A step may err by `tolerance` of mu_k g / w^2, the way at which springs balance friction.
    """
    n, friction = at.n, at.friction * at.inverse
    sign = np.sign(np.sum(to_blocks[0])) * (np.arange(n) == 0) + (np.arange(n) > 0)
    to_blocks, to_modes = to_blocks * sign[:, None], to_modes * sign  # mode 0 moves blocks forward
    # as a sum of what each spring holds: an eigenvalue is only as exact as the greatest of them
    shape = np.append(to_blocks[0], np.zeros(len(at.anchors)))
    whole = np.sum(at.k * (shape[at.first] - shape[at.second]) ** 2)
    alike = [friction, at.mass, to_blocks[0], to_modes[:, 0]]
    possible = all(np.ptp(a) <= ALIKE * np.max(np.abs(a)) for a in alike)
    possible = possible and friction[0] > 0.0 and 0.0 < GAP**2 * whole < w[1] ** 2
    legendre = np.polynomial.legendre.legvander
    x, weight = np.polynomial.legendre.leggauss(NODES)
    fit = (np.arange(NODES) + 0.5)[:, None] * legendre(x, NODES - 1).T * weight
    ends = legendre(np.append(x, 1.0), NODES)
    below = np.column_stack([-np.ones(NODES + 1), ends[:, : NODES - 1]])  # integrals from -1 on
    inner = 0.5 * (ends[:, 1:] - below) / (2 * np.arange(NODES) + 1) @ fit
    return Averaged(
        bool(possible),
        float(tolerance * friction[0] / whole) if possible else 0.0,
        float(friction[0]),
        np.append(np.sqrt(whole), w[1:]),
        to_blocks,
        to_modes,
        (at.drive * at.inverse[:, None]).T @ to_modes,
        np.mean(to_blocks**2, axis=1),
        float(np.sum(to_modes[:, 0])),
        float(np.mean(to_blocks[0])),
        0.5 * (x + 1.0),
        0.5 * weight,
        inner,
        fit,
        np.zeros(STATE),
        np.zeros((NODES, STATE)),
        np.zeros((NODES, STATE)),
        np.zeros(STATE),
        np.zeros(3),
        np.zeros((4, n)),
        np.zeros((4, n)),
    )


@uncounted
def rim_at(s, used, cx, cy, cc, cs):
    """Return how far the rim's x, y, cos(phi) - 1 and sin(phi) have changed at s."""
    x = y = c = r = 0.0
    for k in range(used, 0, -1):
        x, y, c, r = (x + cx[k]) * s, (y + cy[k]) * s, (c + cc[k]) * s, (r + cs[k]) * s
    return x, y, c, r


@uncounted
def rim_rate(s, used, cx, cy, cc, cs):
    """Return how fast they change at s."""
    x = y = c = r = 0.0
    for k in range(used, 0, -1):
        x, y, c, r = x * s + k * cx[k], y * s + k * cy[k], c * s + k * cc[k], r * s + k * cs[k]
    return x, y, c, r


@uncounted
def pull_on(k, x, y, c, r, av):
    """Return the rim's pull on mode k, an acceleration, or its rate for rates of the rim."""
    d = av.drive
    return d[0, k] * x + d[1, k] * c - d[2, k] * r, d[0, k] * y + d[1, k] * r + d[2, k] * c


@uncounted
def add_rest(sign, s, used, av, cx, cy, cc, cs):
    """Add `sign` times what the rim's pull holds the modes to at s, and its rate, to av.q."""
    x, y, c, r = rim_at(s, used, cx, cy, cc, cs)
    x, y, c, r = x + cx[0], y + cy[0], c + cc[0], r + cs[0]
    xr, yr, cr, rr = rim_rate(s, used, cx, cy, cc, cs)
    for k in range(1, len(av.w)):
        flat = sign / (av.w[k] * av.w[k])
        a, b = pull_on(k, x, y, c, r, av)
        av.q[0, k] += a * flat
        av.q[1, k] += b * flat
        a, b = pull_on(k, xr, yr, cr, rr, av)
        av.q[2, k] += a * flat
        av.q[3, k] += b * flat


@uncounted
def to_modes(u, v, av):
    """Write the modes' displacement and velocity into av.q."""
    n, q = len(av.w), av.q
    for c in range(4):
        for k in range(n):
            q[c, k] = 0.0
    for i in range(n):
        for k in range(n):
            q[0, k] += av.to_modes[i, k] * u[i, 0]
        for k in range(n):
            q[1, k] += av.to_modes[i, k] * u[i, 1]
        for k in range(n):
            q[2, k] += av.to_modes[i, k] * v[i, 0]
        for k in range(n):
            q[3, k] += av.to_modes[i, k] * v[i, 1]


@uncounted
def whole_slope(out, state, pull_x, pull_y, av):
    """Write the rate of change of a state, with the rim's pull on mode 0."""
    vx, vy = state[V], state[V + 1]
    size = np.sqrt(vx * vx + vy * vy) + 1e-200
    ex, ey = vx / size, vy / size
    speed = av.moved * size
    c = av.friction / speed
    m00, m01, m10, m11 = state[M], state[M + 1], state[M + 2], state[M + 3]
    across_0, across_1 = ex * m10 - ey * m00, ex * m11 - ey * m01  # M seen along and across
    along_0, along_1 = ex * m00 + ey * m10, ex * m01 + ey * m11
    a = across_0 * av.spread[0] + across_1 * av.spread[1]
    b = across_0 * av.spread[1] + across_1 * av.spread[2]
    less = 0.5 * (a * across_0 + b * across_1) / (speed * speed)
    aside = av.friction * (a * along_0 + b * along_1) / (speed * speed)
    along = -av.friction * (1.0 - less)
    square = av.w[0] * av.w[0]
    ax = pull_x - square * state[X] + av.pushed * (along * ex - aside * ey)
    ay = pull_y - square * state[X + 1] + av.pushed * (along * ey + aside * ex)
    out[X], out[X + 1], out[V], out[V + 1] = vx, vy, ax, ay
    out[M], out[M + 1] = 0.5 * c * ey * across_0, 0.5 * c * ey * across_1
    out[M + 2], out[M + 3] = -0.5 * c * ex * across_0, -0.5 * c * ex * across_1
    # (c P)' / 4 + c^2 P / 8 has, along and across, the elements 0, mixed, mixed, grown
    grown = 0.25 * c * (0.5 * c - (ex * ax + ey * ay) / size)
    mixed = -0.25 * c * (ex * ay - ey * ax) / size
    a, b = grown * across_0 + mixed * along_0, grown * across_1 + mixed * along_1
    x0, y0 = mixed * ex * across_0 - ey * a, mixed * ey * across_0 + ex * a
    x1, y1 = mixed * ex * across_1 - ey * b, mixed * ey * across_1 + ex * b
    scale = -1.0 / (m00 * m11 - m01 * m10)
    out[N], out[N + 1] = scale * (m11 * x0 - m01 * y0), scale * (m11 * x1 - m01 * y1)
    out[N + 2], out[N + 3] = scale * (m00 * y0 - m10 * x0), scale * (m00 * y1 - m10 * x1)


@uncounted
def swinging(vx, vy, av):
    """Return by how much the velocity of mode 0 swings about (vx, vy), with the vibrations in av.q.

    Of its friction, what is not the mean is half the rate of displacement times velocity.
    """
    q, xx, xy, yy = av.q, 0.0, 0.0, 0.0
    for k in range(1, len(av.w)):
        xx += av.share[k] * q[0, k] * q[2, k]
        xy += 0.5 * av.share[k] * (q[0, k] * q[3, k] + q[2, k] * q[1, k])
        yy += av.share[k] * q[1, k] * q[3, k]
    square = vx * vx + vy * vy + 1e-200
    scale = 0.5 * av.pushed * av.friction / (av.moved * av.moved * square * square)
    along = 0.5 * scale * (vy * vy * xx - 2.0 * vx * vy * xy + vx * vx * yy)
    aside = scale * (vx * vy * (yy - xx) + (vx * vx - vy * vy) * xy)
    size = np.sqrt(square)
    return (along * vx - aside * vy) / size, (along * vy + aside * vx) / size


@uncounted
def begin_step(u, v, used, av, cx, cy, cc, cs):
    """Write the state at the beginning of a step, and its rate of change into av.now."""
    q, z, state = av.q, av.swing, av.begin
    to_modes(u, v, av)
    add_rest(-1.0, 0.0, used, av, cx, cy, cc, cs)
    for p in range(STATE):
        state[p] = q[p, 0] if p < M else 0.0
    x, y = swinging(q[2, 0], q[3, 0], av)
    state[V], state[V + 1] = state[V] - x, state[V + 1] - y
    state[M] = state[M + 3] = 1.0
    vx, vy = state[V], state[V + 1]
    square = vx * vx + vy * vy + 1e-200
    half = 0.5 * av.friction / (av.moved * square * np.sqrt(square))
    xx = xy = yy = 0.0
    for k in range(1, len(av.w)):
        aside = half * (vx * q[1, k] - vy * q[0, k])
        z[0, k], z[1, k] = q[0, k], q[1, k]
        z[2, k], z[3, k] = q[2, k] - aside * vy, q[3, k] + aside * vx
        w = av.w[k] * av.w[k]
        xx += av.share[k] * (w * z[0, k] * z[0, k] + z[2, k] * z[2, k])
        xy += av.share[k] * (w * z[0, k] * z[1, k] + z[2, k] * z[3, k])
        yy += av.share[k] * (w * z[1, k] * z[1, k] + z[3, k] * z[3, k])
    av.spread[0], av.spread[1], av.spread[2] = 0.5 * xx, 0.5 * xy, 0.5 * yy
    x, y = pull_on(0, cx[0], cy[0], cc[0], cs[0], av)
    whole_slope(av.now, state, x, y, av)


@uncounted
def most_swing(av):
    """Return the highest speed that vibrations can add up to on any block."""
    n, z, most = len(av.w), av.swing, 0.0
    for i in range(n):
        total = 0.0
        for k in range(1, n):
            w = av.w[k] * av.w[k]
            square = w * (z[0, k] * z[0, k] + z[1, k] * z[1, k])
            square += z[2, k] * z[2, k] + z[3, k] * z[3, k]
            total += abs(av.to_blocks[k, i]) * np.sqrt(square)
        most = max(most, total)
    return most


@uncounted
def averaged_reach(h, av):
    """Return the step, at most `h`, for which averages hold; 0 where a block may reverse."""
    vx, vy = av.begin[V], av.begin[V + 1]
    size = np.sqrt(vx * vx + vy * vy) + 1e-200
    ex, ey, speed, most = vx / size, vy / size, av.moved * size, most_swing(av)
    if most >= speed:
        return 0.0
    xx, xy, yy = av.spread[0], av.spread[1], av.spread[2]
    along = ex * ex * xx + 2.0 * ex * ey * xy + ey * ey * yy
    across = np.sqrt(max(0.0, ey * ey * xx - 2.0 * ex * ey * xy + ex * ex * yy))
    late = av.friction / (speed * av.w[1])
    if NEXT * late * late * late * across / av.w[1] > av.small:
        return 0.0
    if av.friction * np.sqrt(along) * across / (speed * speed * av.w[1] * av.w[1]) > av.small:
        return 0.0
    ax, ay = av.now[V], av.now[V + 1]
    change, slower = av.moved * np.sqrt(ax * ax + ay * ay), -av.moved * (ax * ex + ay * ey)
    h = min(h, SLOWER * speed / (change + 1e-200), LASTING * speed / av.friction, SWUNG / av.w[0])
    least = speed
    if slower > 0.0:
        h = min(h, (speed - most) / slower)
        least = speed - slower * h
    third = RESONANT * av.friction * along * across / (least * least * least)
    return min(h, np.sqrt(2.0 * av.small / (third + 1e-200)))


@uncounted
def averaged_step(u, v, h, used, av, cx, cy, cc, cs):
    """Work out a step of at most `h` into av.begin, av.slope and av.swing; return its length.

    0 where averages do not hold.
    """
    begin_step(u, v, used, av, cx, cy, cc, cs)
    h = averaged_reach(h, av)
    if h <= 0.0:
        return 0.0
    for j in range(NODES):
        for p in range(STATE):
            av.at_node[j, p] = av.begin[p] + av.now[p] * h * av.node[j]
    last = np.inf
    for _ in range(ROUNDS):
        for j in range(NODES):
            x, y, c, r = rim_at(av.node[j] * h, used, cx, cy, cc, cs)
            x, y = pull_on(0, x + cx[0], y + cy[0], c + cc[0], r + cs[0], av)
            whole_slope(av.now, av.at_node[j], x, y, av)
            for p in range(STATE):
                av.slope[j, p] = av.now[p]
        change = 0.0
        for j in range(NODES):
            for p in range(STATE):
                total = 0.0
                for e in range(NODES):
                    total += av.inner[j, e] * av.slope[e, p]
                total = av.begin[p] + h * total
                if p < M:
                    scale = av.moved * (h if p >= V else 1.0)
                    change = max(change, scale * abs(total - av.at_node[j, p]))
                av.at_node[j, p] = total
        if change < SETTLED_M or (change > 0.5 * last and change < STALLED_M):
            return h if seen(h, av) else 0.0
        last = change
    return 0.0


@uncounted
def seen(h, av):
    """Return whether the polynomial of the acceleration has all of it."""
    unseen = 0.0
    for r in range(NODES - 2, NODES):
        for p in range(V, M):
            total = 0.0
            for j in range(NODES):
                total += av.fit[r, j] * av.slope[j, p]
            unseen = max(unseen, abs(total))
    return unseen * av.moved * h * h < av.small


@uncounted
def part_of(tau, e, av):
    """Return the integral to `tau`, 0..1, of what is 1 at node e and 0 at the others."""
    x, total, before, here = 2.0 * tau - 1.0, 0.0, -1.0, 1.0
    for k in range(NODES):
        after = x if k == 0 else ((2 * k + 1) * x * here - k * before) / (k + 1)
        total += 0.5 * av.fit[k, e] * (after - before) / (2 * k + 1)
        before, here = here, after
    return total


@uncounted
def state_at(s, h, av):
    """Write the state at s of a step h into av.now."""
    for p in range(STATE):
        av.now[p] = av.begin[p]
    for e in range(NODES):
        part = h * (av.inner[NODES, e] if s == h else part_of(s / h, e, av))
        for p in range(STATE):
            av.now[p] += part * av.slope[e, p]


@uncounted
def averaged_state(s, h, used, av, cx, cy, cc, cs, u, v):
    """Write the blocks' places and velocities at s of a step h."""
    n, now, z, q = len(av.w), av.now, av.swing, av.q
    state_at(s, h, av)
    vx, vy = now[V], now[V + 1]
    square = vx * vx + vy * vy + 1e-200
    half = 0.5 * av.friction / (av.moved * square * np.sqrt(square))
    for k in range(1, n):
        w = av.w[k]
        cosine, sine = np.cos(w * s), np.sin(w * s)
        ax, ay = z[0, k] * cosine + z[2, k] * sine / w, z[1, k] * cosine + z[3, k] * sine / w
        bx, by = z[2, k] * cosine / w - z[0, k] * sine, z[3, k] * cosine / w - z[1, k] * sine
        px, py = now[N] * ax + now[N + 1] * ay, now[N + 2] * ax + now[N + 3] * ay
        ax += (now[N] * bx + now[N + 1] * by) / w
        ay += (now[N + 2] * bx + now[N + 3] * by) / w
        bx, by = w * bx - px, w * by - py
        x, y = now[M] * ax + now[M + 1] * ay, now[M + 2] * ax + now[M + 3] * ay
        aside = half * (vx * y - vy * x)
        q[0, k], q[1, k] = x, y
        q[2, k] = now[M] * bx + now[M + 1] * by + aside * vy
        q[3, k] = now[M + 2] * bx + now[M + 3] * by - aside * vx
    x, y = swinging(vx, vy, av)
    q[0, 0], q[1, 0], q[2, 0], q[3, 0] = now[X], now[X + 1], vx + x, vy + y
    to_blocks(s, used, av, cx, cy, cc, cs, u, v)


@uncounted
def to_blocks(s, used, av, cx, cy, cc, cs, u, v):
    """Write the blocks' places and velocities by those of the modes off their rest, in av.q."""
    n, q = len(av.w), av.q
    add_rest(1.0, s, used, av, cx, cy, cc, cs)
    for i in range(n):
        u[i, 0] = u[i, 1] = v[i, 0] = v[i, 1] = 0.0
    for k in range(n):
        for i in range(n):
            u[i, 0] += av.to_blocks[k, i] * q[0, k]
            u[i, 1] += av.to_blocks[k, i] * q[1, k]
            v[i, 0] += av.to_blocks[k, i] * q[2, k]
            v[i, 1] += av.to_blocks[k, i] * q[3, k]


@uncounted
def ledger_at(s, weight, used, at, cx, cy, cc, cs, energy, u, v):
    """Add `weight` (s) times drive power and friction power at s to `energy`."""
    x, y, c, r = rim_at(s, used, cx, cy, cc, cs)
    x, y, c, r = x + cx[0], y + cy[0], c + cc[0], r + cs[0]
    xr, yr, cr, rr = rim_rate(s, used, cx, cy, cc, cs)
    for i in range(at.n):
        energy[1] += weight * at.friction[i] * np.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2)
        for q in range(at.rim_lo[i], at.rim_lo[i + 1]):
            e = at.rim_spring[q]
            bx, by = at.anchors[at.second[e] - at.n, 0], at.anchors[at.second[e] - at.n, 1]
            dx, dy = x + c * bx - r * by - u[i, 0], y + r * bx + c * by - u[i, 1]
            power = dx * (xr + cr * bx - rr * by) + dy * (yr + rr * bx + cr * by)
            energy[0] += weight * at.k[e] * power


@uncounted
def averaged_ledger(h, used, at, av, cx, cy, cc, cs, energy, u, v):
    """Add the drive work and the friction heat (J) of a step, vibrations averaged, to `energy`."""
    for j in range(NODES):
        s, q, state = av.node[j] * h, av.q, av.at_node[j]
        for c in range(4):
            q[c, 0] = state[c]
            for k in range(1, len(av.w)):
                q[c, k] = 0.0
        to_blocks(s, used, av, cx, cy, cc, cs, u, v)
        ledger_at(s, av.weight[j] * h, used, at, cx, cy, cc, cs, energy, u, v)
        vx, vy = state[V], state[V + 1]
        size = np.sqrt(vx * vx + vy * vy) + 1e-200
        a = (vx * state[M + 2] - vy * state[M]) / size
        b = (vx * state[M + 3] - vy * state[M + 1]) / size
        across = a * a * av.spread[0] + 2.0 * a * b * av.spread[1] + b * b * av.spread[2]
        for i in range(at.n):  # a block's way is longer for what vibrates across
            energy[1] += av.weight[j] * h * at.friction[i] * 0.5 * across / (av.moved * size)


@uncounted
def swing_work(u, v, s, used, av, cx, cy, cc, cs):
    """Return the work (J) of the rim on the vibrations, an integral, at s."""
    to_modes(u, v, av)
    add_rest(-1.0, s, used, av, cx, cy, cc, cs)
    x, y, c, r = rim_rate(s, used, cx, cy, cc, cs)
    total = 0.0
    for k in range(1, len(av.w)):
        a, b = pull_on(k, x, y, c, r, av)
        total += (av.q[2, k] * a + av.q[3, k] * b) / (av.w[k] * av.w[k])
    return total


@uncounted
def averaged_on(
    t, h, worth, u, v, used, at, av, cx, cy, cc, cs, grid, sampled, ledger, energy, here, rate
):  # fmt: skip
    """Go on by a step of at most `h` and at least `worth`; return (step, count of samples).

    (0, -1) where averages do not hold; else samples, energies and the state are written.
    """
    h = averaged_step(u, v, h, used, av, cx, cy, cc, cs)
    if h < worth:
        return 0.0, -1
    while sampled < len(grid.t) and grid.t[sampled] <= t + h:
        averaged_state(
            grid.t[sampled] - t, h, used, av, cx, cy, cc, cs, grid.u[sampled], grid.v[sampled]
        )
        sampled += 1
    if ledger:
        averaged_ledger(h, used, at, av, cx, cy, cc, cs, energy, here, rate)
        energy[0] -= swing_work(u, v, 0.0, used, av, cx, cy, cc, cs)
    averaged_state(h, h, used, av, cx, cy, cc, cs, u, v)
    if ledger:
        energy[0] += swing_work(u, v, h, used, av, cx, cy, cc, cs)
    return h, sampled
