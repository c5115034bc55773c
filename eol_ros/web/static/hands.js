// SPDX-License-Identifier: Apache-2.0
// Hands on the rim: mouse, fingers and keys become velocities of the rim.
//
// A held point is pulled to the pointer as by a short stiff spring. One finger off the centre turns the
// rim as it would on a table: of all motions that bring the point along, the one of least effort,
// |v|^2 + (rho w)^2 with rho the rim's radius of gyration. Two fingers fix both place and angle.
// The rim has mass, springs and limits, and other people's hands on it: so it may stay behind.

import { BAR_M, BLOCK_M, IDS, PLATFORM_M, RIM_M } from './lattice.js';

const GAIN = 14; // 1/s, how fast the held point follows
const RHO = Math.hypot(...RIM_M) / Math.sqrt(12); // m, as of a thin plate: `Frame.gyration_m` of the twin
const NEAR_M = 0.003; // to a limit
const BEHIND_M = 0.02; // from here on a hand is told why the rim does not come
const STANDS_MPS = 0.01;
const KEY_MPS = 0.1;
const KEY_RADPS = 0.35;
const PERIOD_MS = 16;

export class Hands {
  constructor(canvas, link, toTable) {
    this.canvas = canvas;
    this.link = link;
    this.toTable = toTable; // client x, y -> metres
    this.pose = [0, 0, 0];
    this.fingers = new Map(); // id -> {x, y: where the pointer is, grip: point in the rim's own frame}
    this.keys = new Set();
    this.still = true;
    this.pushedAt = 0;
    this.heldAt = -Infinity; // when a hand was last on it, performance.now()
    canvas.onpointerdown = (event) => this.down(event);
    canvas.onpointermove = (event) => this.move(event);
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      canvas.addEventListener(name, (event) => this.up(event));
    }
    canvas.oncontextmenu = (event) => event.preventDefault();
    addEventListener('keydown', (event) => this.key(event, true));
    addEventListener('keyup', (event) => this.key(event, false));
    addEventListener('blur', () => this.keys.clear());
    setInterval(() => this.push(), PERIOD_MS);
  }

  get holding() {
    return this.fingers.size + this.keys.size > 0;
  }

  // Where each finger holds the rim and where it is, metres on the table.
  get pulls() {
    const [rx, ry, yaw] = this.pose;
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    return [...this.fingers.values()].map(({ x, y, grip: [gx, gy] }) => ({ from: [rx + c * gx - s * gy, ry + s * gx + c * gy], to: [x, y] }));
  }

  // How far the rim stays behind the hands, m.
  get lag() {
    return Math.max(0, ...this.pulls.map(({ from, to }) => Math.hypot(to[0] - from[0], to[1] - from[1])));
  }

  // Why it does not come: the words' key, empty where it does. `speed` is the rim's, m/s.
  limit({ x, y }, speed) {
    if (!this.holding || (!this.keys.size && this.lag < BEHIND_M)) return '';
    const [vx, vy] = this.velocity();
    const [rx, ry, yaw] = this.pose;
    const [c, s] = [Math.abs(Math.cos(yaw)), Math.abs(Math.sin(yaw))];
    const [wide, deep] = RIM_M.map((inner) => inner + 2 * BAR_M);
    const reach = [PLATFORM_M[0] - wide * c - deep * s, PLATFORM_M[1] - wide * s - deep * c].map((room) => room / 2 - NEAR_M);
    if ((vx * rx > 0 && Math.abs(rx) > reach[0]) || (vy * ry > 0 && Math.abs(ry) > reach[1])) return 'limit_edge';
    const gaps = IDS.map((id) => {
      const [u, v] = this.inRim(x[id], y[id]);
      return Math.min(RIM_M[0] / 2 - Math.abs(u), RIM_M[1] / 2 - Math.abs(v)) - BLOCK_M / 2;
    });
    if (Math.min(...gaps) < 2 * NEAR_M) return 'limit_block';
    return this.fingers.size && this.lag > 2 * BEHIND_M && speed < STANDS_MPS ? 'limit_force' : '';
  }

  inRim(x, y) {
    const [rx, ry, yaw] = this.pose;
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    return [c * (x - rx) + s * (y - ry), -s * (x - rx) + c * (y - ry)];
  }

  down(event) {
    if (this.fingers.size >= 2) return;
    const [x, y] = this.toTable(event.clientX, event.clientY);
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x, y, grip: this.inRim(x, y), turn: event.button === 2 || event.shiftKey });
    this.canvas.classList.add('held');
  }

  move(event) {
    const finger = this.fingers.get(event.pointerId);
    if (!finger) return;
    [finger.x, finger.y] = this.toTable(event.clientX, event.clientY);
    if (performance.now() - this.pushedAt > PERIOD_MS / 2) this.push(); // sooner than the next beat
  }

  up(event) {
    this.fingers.delete(event.pointerId);
    if (!this.fingers.size) this.canvas.classList.remove('held');
  }

  key(event, pressed) {
    const known = ['arrowleft', 'arrowright', 'arrowup', 'arrowdown', 'q', 'e', 'shift'];
    const name = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey || event.altKey || !known.includes(name)) return;
    if (/INPUT/.test(event.target.tagName)) return;
    if (pressed) this.keys.add(name);
    else this.keys.delete(name);
    if (name !== 'shift') event.preventDefault();
  }

  // The velocity that the hands want now, [vx, vy, yaw rate].
  velocity() {
    const [v, w] = [[0, 0], [0]];
    const fingers = [...this.fingers.values()];
    const [rx, ry, yaw] = this.pose;
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    const arms = fingers.map(({ grip: [gx, gy] }) => [c * gx - s * gy, s * gx + c * gy]);
    const pulls = fingers.map((f, i) => [f.x - rx - arms[i][0], f.y - ry - arms[i][1]]);
    if (fingers.length === 1) {
      const [[ax, ay]] = arms;
      const [[px, py]] = pulls;
      const along = -px * ay + py * ax;
      w[0] = fingers[0].turn ? along / Math.max(ax * ax + ay * ay, 0.01) : along / (RHO * RHO + ax * ax + ay * ay);
      if (!fingers[0].turn) [v[0], v[1]] = [px + w[0] * ay, py - w[0] * ax];
    } else if (fingers.length === 2) {
      const [a, b] = arms;
      const now = Math.atan2(b[1] - a[1], b[0] - a[0]);
      const want = Math.atan2(fingers[1].y - fingers[0].y, fingers[1].x - fingers[0].x);
      w[0] = Math.atan2(Math.sin(want - now), Math.cos(want - now));
      const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      v[0] = (pulls[0][0] + pulls[1][0]) / 2 + w[0] * middle[1];
      v[1] = (pulls[0][1] + pulls[1][1]) / 2 - w[0] * middle[0];
    }
    const fast = this.keys.has('shift') ? 2.5 : 1;
    const held = (name) => (this.keys.has(name) ? fast : 0);
    return [
      v[0] * GAIN + KEY_MPS * (held('arrowright') - held('arrowleft')),
      v[1] * GAIN + KEY_MPS * (held('arrowup') - held('arrowdown')),
      w[0] * GAIN + KEY_RADPS * (held('q') - held('e')),
    ];
  }

  push() {
    if (this.holding) this.heldAt = performance.now();
    if (!this.holding && this.still) return;
    const velocity = this.velocity();
    this.still = !this.holding;
    this.link.send({ rim: this.still ? [0, 0, 0] : velocity.map((value) => Number(value.toFixed(5))) });
    this.pushedAt = performance.now();
  }
}
