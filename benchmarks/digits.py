# SPDX-License-Identifier: Apache-2.0
"""eol bench digits: the first events of scenes in the plane, in 50 digits.

A reference that shares neither code nor method with the solvers, nor their arithmetic: mpmath's
numbers, forces written out again, and the extrapolated midpoint rule of Gragg, Bulirsch and Stoer
(Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.9). Where a block is slow
the direction of its friction turns at the rate r = mu_k g / |v|; with the independent variable s,
ds/dt = (w^4 + sum of r^4)^(1/4) (Sundman's transformation), a start from rest and a stop are
smooth, exponential in s, so that a block sets off at 1e-28 m/s and stops below 1e-26.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpmath import mp

from benchmarks import physics_peers as peers
from benchmarks.machine import tell
from benchmarks.parting import same_events
from benchmarks.physics_oracles import ARM_S, CAPTURE_MPS
from eol_ros.core.physics import presets
from eol_ros.core.physics.choose import simulate
from eol_ros.core.physics.drive import CIRCLE, NONE, VELOCITY
from eol_ros.core.physics.scene import Scene, from_mapping
from eol_ros.errors import UsageError
from eol_ros.verbs.progress import track

HELP = 'the first events of scenes in the plane against 50 digits: ours, and SciPy as a reference'
EXAMPLES = ['eol bench digits', 'eol bench digits --scenes S3G --markdown']
DIGITS = 50
KICK_MPS, STOP_MPS = '1e-28', '1e-26'
COLUMNS = 12  # of the extrapolation: order 24
LOCAL = '1e-32'  # error of a step, m and m/s
ROOT = '1e-34'  # of a force limit (its share) or a time (s)
SCAN_S = 0.02  # while nothing slides
TOLERANCES = (1e-9, 1e-11, 1e-13, 1e-15)
SCENES = {'S3L': 1.72, 'S3G': 2.2, 'S4L': 0.45, 'S4G': 0.72}  # s of each

Row = list[Any]  # of mpmath's numbers, as
Pair = tuple[Any, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--scenes', default=','.join(SCENES), help='separated by commas')
    parser.add_argument('--markdown', action='store_true', help='the table of docs/numerics')
    parser.add_argument('--json', action='store_true')


@dataclass
class Truth:
    """What the reference gives: u (n, 2) m at the end, events (s, block, 1 a break or 0 a stop)."""

    u: np.ndarray
    events: list[tuple[float, int, int]]
    steps: int


class Motion:
    """A scene in mpmath's numbers, as it moves."""

    def __init__(self, scene: Scene) -> None:
        number = np.vectorize(lambda value: mp.mpf(float(value)), otypes=[object])
        if scene.drive.kind not in (NONE, VELOCITY, CIRCLE) or scene.rotation is not None:
            raise UsageError('50 digits are for blocks that do not rotate, pulled or circled')
        self.n, self.geometric, self.kind = scene.n, scene.geometric, scene.drive.kind
        self.par = [mp.mpf(float(p)) for p in scene.drive.par]
        self.static = [mp.mpf(float(f)) for f in scene.static_limit]
        self.kinetic = [mp.mpf(float(f)) for f in scene.kinetic_force]
        self.mass = [mp.mpf(float(m)) for m in scene.mass]
        self.near: list[list[tuple[Any, ...]]] = [[] for _ in range(scene.n)]
        between, rim = scene.between, scene.to_frame
        for e in range(len(between.i)):
            i, j = int(between.i[e]), int(between.j[e])
            k, natural = number(between.k[e]).item(), number(between.natural[e]).item()
            x, y = number(between.rest[e])
            self.near[i].append((j, k, natural, x, y))
            self.near[j].append((i, k, natural, -x, -y))
        self.anchors = [tuple(number(a)) for a in rim.anchor]
        for e, i in enumerate(rim.i):
            k, natural = number(rim.k[e]).item(), number(rim.natural[e]).item()
            self.near[int(i)].append((scene.n + e, k, natural, *number(rim.rest[e])))
        self.u = [list(row) for row in number(scene.u0)]
        self.v = [list(row) for row in number(scene.v0)]
        self.on = [i for i in range(scene.n) if any(scene.v0[i] != 0)]
        self.t = mp.mpf(0)
        self.events: list[tuple[float, int, int]] = []
        self.steps = 0
        fastest = mp.sqrt(8 * max(k for row in self.near for _, k, *_ in row) / min(self.mass))
        self.clock = fastest / 2
        self.length = mp.mpf(1)  # of the next step, in s
        loose = []
        for i in range(self.n):
            fx, fy = self.pull(i, self.u, self.t, {})
            if i not in self.on and mp.sqrt(fx * fx + fy * fy) >= self.static[i]:
                loose.append(i)
        for i in loose:
            self.events.append((0.0, i, 1))
            self.set_off(i)

    def pull(self, i: int, u: Sequence[Row], t: Any, rim: dict[int, Pair]) -> Pair:
        """Return the force (N) of the springs on block i; `rim` keeps where anchors are at t."""
        fx = fy = 0
        x, y = u[i]
        for j, k, natural, rest_x, rest_y in self.near[i]:
            if j < self.n:
                dx, dy = u[j][0] - x, u[j][1] - y
            else:
                if j not in rim:
                    rim[j] = self.anchor(j - self.n, t)
                dx, dy = rim[j][0] - x, rim[j][1] - y
            if self.geometric:
                dx, dy = dx + rest_x, dy + rest_y
                k = k * (1 - natural / mp.sqrt(dx * dx + dy * dy))
            fx, fy = fx + k * dx, fy + k * dy
        return fx, fy

    def anchor(self, a: int, t: Any) -> Pair:
        """Return the displacement (m) of an anchor at t."""
        if self.kind == NONE:
            return 0, 0
        if self.kind == VELOCITY:
            return self.par[0] * t, self.par[1] * t
        radius, w, amplitude, w2 = self.par
        phi = amplitude * mp.sin(w2 * t)
        c, s = mp.cos(phi) - 1, mp.sin(phi)
        x, y = self.anchors[a]
        return (
            radius * mp.sin(w * t) + c * x - s * y,
            radius * (1 - mp.cos(w * t)) + s * x + c * y,
        )

    def slope(self, y: Row) -> Row:
        """Return dy/ds of y = (t, then x, y, vx, vy of each sliding block)."""
        u, t = list(self.u), y[0]
        rim: dict[int, Pair] = {}
        for c, i in enumerate(self.on):
            u[i] = y[4 * c + 1 : 4 * c + 3]
        rates, clock = [], self.clock**4
        for c, i in enumerate(self.on):
            vx, vy = y[4 * c + 3 : 4 * c + 5]
            hold = self.kinetic[i] / mp.sqrt(vx * vx + vy * vy)
            fx, fy = self.pull(i, u, t, rim)
            mass = self.mass[i]
            clock = clock + (hold / mass) ** 4
            rates += [vx, vy, (fx - hold * vx) / mass, (fy - hold * vy) / mass]
        pace = 1 / mp.sqrt(mp.sqrt(clock))
        return [pace, *(rate * pace for rate in rates)]

    def step(self, y: Row, begin: Row, length: Any) -> tuple[Row, Any]:
        """Return y after `length` and an estimate of its error; `begin` is the slope at y."""
        table: list[Row] = []
        for column in range(COLUMNS):
            count = 2 * (column + 1)
            h = length / count
            before, now = y, [a + h * b for a, b in zip(y, begin, strict=True)]
            for _ in range(count - 1):
                after = [a + 2 * h * b for a, b in zip(before, self.slope(now), strict=True)]
                before, now = now, after
            last = self.slope(now)
            row = [[(a + b + h * c) / 2 for a, b, c in zip(before, now, last, strict=True)]]
            for k in range(1, column + 1):
                share = mp.mpf(count) ** 2 / mp.mpf(2 * (column + 1 - k)) ** 2 - 1
                row.append(
                    [a + (a - b) / share for a, b in zip(row[-1], table[k - 1], strict=True)]
                )
            table = row
        return table[-1], max(abs(a - b) for a, b in zip(table[-1], table[-2], strict=True))

    def over(self, y: Row, until: Any) -> tuple[Any, int]:
        """Return by how much y is beyond the first limit that it meets, and whose: -1 is time's."""
        u, t = list(self.u), y[0]
        rim: dict[int, Pair] = {}
        for c, i in enumerate(self.on):
            u[i] = y[4 * c + 1 : 4 * c + 3]
        most, who = t - until, -1
        for i in range(self.n):
            if i not in self.on:
                fx, fy = self.pull(i, u, t, rim)
                share = mp.sqrt(fx * fx + fy * fy) / self.static[i] - 1
                if share > most:
                    most, who = share, i
        return most, who

    def state(self) -> Row:
        """Return y now."""
        return [self.t, *(part for i in self.on for part in (*self.u[i], *self.v[i]))]

    def advance(self, until: Any) -> None:
        """Go on to `until`, s."""
        while True:
            y = self.state()
            begin = self.slope(y) if self.on else []

            def after(length: Any, y: Row = y, begin: Row = begin) -> Row:
                return self.step(y, begin, length)[0] if begin else [y[0] + length]

            if begin:
                tried, error = self.step(y, begin, self.length)
                gain = (mp.mpf(LOCAL) / max(error, mp.mpf('1e-60'))) ** (mp.mpf(1) / 23)
                if error > mp.mpf(LOCAL):
                    self.length *= max(0.8 * gain, mp.mpf(0.2))
                    continue
                length, self.length = self.length, self.length * min(0.9 * gain, mp.mpf(2))
            else:
                length = mp.mpf(SCAN_S)
                tried = after(length)
            self.steps += 1
            who = None
            beyond, _ = self.over(tried, until)
            if beyond > 0:
                tried, who = self.first(y, length, beyond, until, after)
            self.t = tried[0]
            for c, i in enumerate(self.on):
                self.u[i], self.v[i] = tried[4 * c + 1 : 4 * c + 3], tried[4 * c + 3 : 4 * c + 5]
            self.stop()
            if who == -1:
                return
            if who is not None:
                self.events.append((float(self.t), who, 1))
                self.set_off(who)

    def first(
        self, y: Row, length: Any, beyond: Any, until: Any, after: Callable[[Any], Row]
    ) -> tuple[Row, int]:
        """Return y at the first limit, and whose it is, by regula falsi (Illinois)."""
        low, high = mp.mpf(0), length
        below = self.over(y, until)[0]
        side = 0
        while True:
            at = high - beyond * (high - low) / (beyond - below)
            tried = after(at)
            value, who = self.over(tried, until)
            if abs(value) < mp.mpf(ROOT) or high - low < mp.mpf(ROOT) * length:
                return tried, who
            if value > 0:
                high, beyond = at, value
                below = below / 2 if side > 0 else below
                side = 1
            else:
                low, below = at, value
                beyond = beyond / 2 if side < 0 else beyond
                side = -1

    def stop(self) -> None:
        """Let blocks rest that are as good as at rest, or set them off the other way."""
        for i in list(self.on):
            vx, vy = self.v[i]
            if mp.sqrt(vx * vx + vy * vy) > mp.mpf(STOP_MPS):
                continue
            fx, fy = self.pull(i, self.u, self.t, {})
            if fx * vx + fy * vy >= self.kinetic[i] * mp.sqrt(vx * vx + vy * vy):
                continue  # it has just set off
            self.on.remove(i)
            self.v[i] = [mp.mpf(0), mp.mpf(0)]
            if mp.sqrt(fx * fx + fy * fy) > self.static[i]:
                self.set_off(i)
            else:
                self.events.append((float(self.t), i, 0))

    def set_off(self, i: int) -> None:
        """Give block i the first speed along its pull."""
        fx, fy = self.pull(i, self.u, self.t, {})
        size = mp.sqrt(fx * fx + fy * fy)
        self.v[i] = [mp.mpf(KICK_MPS) * fx / size, mp.mpf(KICK_MPS) * fy / size]
        self.on.append(i)
        self.length = mp.mpf(1)


def follow(scene: Scene, digits: int = DIGITS) -> Truth:
    """Return a scene in so many digits at its end. Raises UsageError for what it does not know."""
    with mp.workdps(digits):
        motion = Motion(scene)
        motion.advance(mp.mpf(float(scene.duration_s)))
        return Truth(np.array(motion.u, float), motion.events, motion.steps)


def row(name: str) -> dict[str, Any]:
    """Return what ours and SciPy's miss of the first events of a scene."""
    stretch = SCENES[name]
    scene = from_mapping(presets.scene(name) | {'T': stretch})
    begin = time.process_time()
    truth = follow(scene)
    found: dict[str, Any] = {
        'scene': name,
        'stretch_s': stretch,
        'events': len(truth.events),
        'steps': truth.steps,
        'took_s': time.process_time() - begin,
        'ours': [],
    }
    grid = np.array([0.0, stretch])
    for tolerance in TOLERANCES:
        run = simulate(scene, stretch, tolerance=tolerance, path='event', ledger=False)
        same = same_events(run, truth.events)
        late = [abs(run.event_t[k] - truth.events[k][0]) for k in range(same)]
        found['ours'].append(
            {
                'tolerance': tolerance,
                'error_m': float(np.abs(run.u[-1] - truth.u).max()),
                'same_events': same,
                'events_off_s': max(late, default=0.0),
            }
        )
    u = peers.scipy_run(scene, grid, 3e-13, CAPTURE_MPS, ARM_S)[0][-1]
    found['scipy_error_m'] = float(np.abs(u - truth.u).max())
    return found


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    names = args.scenes.split(',')
    for name in names:
        if name not in SCENES:
            raise UsageError(f'--scenes {name}: not one of {", ".join(SCENES)}')
    rows = [row(name) for name in track(names, 'scenes', total=len(names))]
    tell({'rows': rows}, args.json, markdown if args.markdown else table)
    return 0


def table(result: dict[str, Any]) -> str:
    """Return the rows for a terminal."""
    return '\n'.join(
        f'{r["scene"]} first {r["stretch_s"]:g} s: {r["events"]} events, {r["took_s"]:.3g} s of'
        f' mpmath in {r["steps"]} steps; SciPy errs by {r["scipy_error_m"]:.0e} m\n'
        + '\n'.join(
            f'    tolerance {o["tolerance"]:g}: {o["error_m"]:.0e} m, {o["same_events"]} events'
            f' alike, their times differ by {o["events_off_s"]:.0e} s'
            for o in r['ours']
        )
        for r in result['rows']
    )


def markdown(result: dict[str, Any]) -> str:
    """Return the table of docs/numerics/physics.md."""
    at = ' | '.join(f'at {t:g}' for t in TOLERANCES)
    lines = [
        f'| scene | first | events alike | ours, m, {at} | times of events, s | SciPy, m |',
        f'| --- | --- | --- | {"--- | " * len(TOLERANCES)}--- | --- |',
    ]
    for r in result['rows']:
        errors = ' | '.join(f'{o["error_m"]:.0e}' for o in r['ours'])
        same = min(o['same_events'] for o in r['ours'])
        late = f'{r["ours"][0]["events_off_s"]:.0e} to {r["ours"][-1]["events_off_s"]:.0e}'
        lines.append(
            f'| {r["scene"]} | {r["stretch_s"]:g} s | {same} of {r["events"]} | {errors} | {late} |'
            f' {r["scipy_error_m"]:.0e} |'
        )
    return '\n'.join(lines)
