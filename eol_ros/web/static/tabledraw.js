// SPDX-License-Identifier: Apache-2.0
// The table seen from above, in metres: sandpaper, rim, springs, pieces of one land, light, cascades.

import { BAR_M, BLOCK_M, CELLS, COLUMNS, GAPS_M, IDS, place, PLATFORM_M, rest, RIM_M, ROWS, stands } from './lattice.js';
import { calm, MOVE, THREAD, WATER } from './paint.js';
import { KEEP_MS, Paths } from './paths.js';

const VIEW_M = Math.max(...PLATFORM_M) + 0.06;
const SIZE = BLOCK_M / 0.084; // of coils and marks, which were drawn for blocks of 84 mm
const WAVE_MS = 1100;
const MARK_FADE_MS = 1000; // at the end: the mark is whole for 2 s after the last slip
export const HUES = [THREAD, WATER, '#d9a0ff', '#6f9bff']; // of cascades at the same time
const COIL_M = 0.0085 * SIZE; // half the height of a spring's picture
const PULL_M = 0.018; // radius of a hand
const TAUT_M = 0.1; // of the line between a hand and what it holds
const TINTS = 8; // shades of strain, each way
const TAUT = 0.012 / 0.09; // strain of the last shade
const HINT_S = 3.2; // one gesture of the hand that shows what can be done, and as long a rest
const HINT_MS = 60; // between its drawings, each of which is one of the whole table
const HINT_M = 0.16;

// A table that nobody has touched.
export const REST = {
  x: Float32Array.from({ length: CELLS }, (_, id) => rest(id)[0]),
  y: Float32Array.from({ length: CELLS }, (_, id) => rest(id)[1]),
  yaw: new Float32Array(CELLS), moving: new Uint8Array(CELLS), rim: [0, 0, 0],
};

export class TableDrawing {
  constructor(canvas) {
    this.canvas = canvas;
    this.brush = canvas.getContext('2d', { alpha: false });
    this.dirty = true;
    this.glow = glowSprite();
    this.paths = new Paths();
    this.pulls = []; // {from: where a finger holds the rim, to: where it is}
    this.hint = false; // whether a hand shows what can be done
    this.hinted = false; // it is in the last drawing
    this.hintedAt = 0;
  }

  setLand(land) {
    this.land = land;
    this.dirty = true;
  }

  resize() {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    // For the words above and below; on a wide screen they stand beside it (table.css).
    const room = innerWidth >= 1.5 * innerHeight ? 0 : 0.045 * innerHeight + 32;
    const side = Math.max(Math.floor(Math.min(innerWidth, innerHeight - 2 * room)), 100);
    if (side === this.side && ratio === this.ratio) return;
    this.side = side;
    this.ratio = ratio;
    this.canvas.style.width = this.canvas.style.height = `${side}px`;
    this.canvas.width = this.canvas.height = this.w = this.h = Math.round(side * ratio);
    this.perM = this.w / VIEW_M;
    this.ground = platform(this.w, PLATFORM_M.map((size) => Math.round(size * this.perM)));
    this.coils = Array.from({ length: 2 * TINTS + 1 }, (_, i) => coil((i - TINTS) / TINTS, this.perM));
    this.dirty = true;
  }

  // Pixels along a cover in a picture of the land that is sharp here.
  get tile() {
    return Math.round(0.09 * SIZE * this.perM);
  }

  toTable(clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    const x = (clientX - box.left) * this.ratio;
    const y = (clientY - box.top) * this.ratio;
    return [(x - this.w / 2) / this.perM, (this.h / 2 - y) / this.perM];
  }

  draw(now, state, leds) {
    this.resize();
    const { brush, w, h, perM } = this;
    this.dirty = false;
    brush.setTransform(1, 0, 0, 1, 0, 0);
    brush.drawImage(this.ground, 0, 0);
    if (!state) return;
    brush.setTransform(perM, 0, 0, -perM, w / 2, h / 2); // metres, y away
    if (state.rim) this.drawSprings(state);
    if (state.rim) this.drawRim(state.rim);
    // Where flashes are unwelcome a slip is told by its block's outline alone.
    for (const id of IDS) this.drawBlock(id, state, calm.matches ? 0 : leds[id] / 255);
    if (!calm.matches) this.drawLight(state, leds);
    this.drawCascades(now, state);
    for (const pull of this.pulls) this.drawPull(pull);
    this.hinted = this.beckons(now) && Boolean(state.rim);
    this.hintedAt = now;
    if (this.hinted) this.drawHint(now, state.rim);
  }

  // Whether a hand is to be seen at `now`.
  beckons(now) {
    return this.hint && (calm.matches || Math.floor(now / 1000 / HINT_S) % 2 === 0);
  }

  // Whether the hand is to be drawn again.
  hintDue(now) {
    if (this.beckons(now) !== this.hinted) return true;
    return this.hinted && !calm.matches && now - this.hintedAt >= HINT_MS;
  }

  // Whether the next drawing would differ from the last: a table at rest costs nothing.
  get alive() {
    return this.dirty || this.paths.cascades.length > 0 || this.pulls.length > 0;
  }

  drawRim([x, y, yaw]) {
    const { brush } = this;
    const inner = RIM_M.map((size) => size / 2);
    const outer = inner.map((size) => size + BAR_M);
    brush.save();
    brush.translate(x, y);
    brush.rotate(yaw);
    brush.fillStyle = '#0008';
    frame(brush, 0.006, -0.01, outer, inner);
    const steel = brush.createLinearGradient(-outer[0], outer[1], outer[0], -outer[1]);
    steel.addColorStop(0, '#c9ccc9');
    steel.addColorStop(0.5, '#7d8487');
    steel.addColorStop(1, '#4a5054');
    brush.fillStyle = steel;
    frame(brush, 0, 0, outer, inner);
    brush.restore();
  }

  // First a finger that takes the near bar and pulls, then two that turn the rim. Nothing is moved by
  // them; where motion is unwelcome they stand still at the end of their way.
  drawHint(now, [x, y, yaw]) {
    const { brush } = this;
    const turns = !calm.matches && Math.floor(now / 2000 / HINT_S) % 2 === 1;
    const t = calm.matches ? 0.8 : ((now / 1000) % HINT_S) / HINT_S;
    const along = Math.min(Math.max((t - 0.2) / 0.5, 0), 1);
    const way = along * along * (3 - 2 * along);
    const [side, near] = RIM_M.map((size) => (size + BAR_M) / 2);
    const fingers = turns ? [[-side, 0], [side, 0]] : [[0, -near]];
    brush.save();
    brush.translate(x, y);
    brush.rotate(yaw);
    brush.globalAlpha = Math.min(t / 0.15, (1 - t) / 0.2, 1);
    brush.strokeStyle = brush.fillStyle = THREAD;
    brush.lineCap = 'round';
    for (const [fx, fy] of fingers) {
      const to = turns ? [fx, fy + Math.sign(fx) * HINT_M * way] : [fx + HINT_M * way, fy];
      brush.lineWidth = 0.008;
      brush.beginPath();
      brush.moveTo(fx, fy);
      brush.lineTo(...to);
      brush.stroke();
      brush.beginPath();
      brush.arc(...to, 0.024, 0, 7);
      brush.fill();
      brush.lineWidth = 0.004;
      brush.beginPath();
      brush.arc(...to, 0.036 + 0.01 * (1 - way), 0, 7);
      brush.stroke();
    }
    brush.restore();
  }

  // A hand and what it holds: the further the rim stays behind, the tauter and the redder the line.
  drawPull({ from: [x0, y0], to: [x1, y1] }) {
    const { brush } = this;
    const strain = Math.min(Math.hypot(x1 - x0, y1 - y0) / TAUT_M, 1);
    const mix = (a, b) => Math.round(a + (b - a) * strain);
    // As far as the picture reaches: the hand may be beyond it.
    const edge = VIEW_M / 2 - 1.2 * PULL_M;
    const shown = Math.min(1, ...[[x0, x1], [y0, y1]].map(([a, b]) => (Math.abs(b) > edge ? (Math.sign(b) * edge - a) / (b - a) : 1)));
    const [endX, endY] = [x0 + shown * (x1 - x0), y0 + shown * (y1 - y0)];
    brush.strokeStyle = brush.fillStyle = `rgb(${mix(232, 255)},${mix(226, 96)},${mix(213, 72)})`;
    brush.lineCap = 'round';
    brush.lineWidth = 0.007 - 0.004 * strain;
    brush.beginPath();
    brush.moveTo(x0, y0);
    brush.lineTo(endX, endY);
    brush.stroke();
    brush.beginPath();
    brush.arc(x0, y0, 0.009, 0, 7);
    brush.fill();
    brush.beginPath();
    brush.arc(endX, endY, PULL_M, 0, 7);
    brush.lineWidth = 0.003;
    brush.stroke();
  }

  drawSprings(state) {
    const { brush } = this;
    const point = (id, dx, dy) => {
      const [c, s] = [Math.cos(state.yaw[id]), Math.sin(state.yaw[id])];
      const r = BLOCK_M / 2;
      return [state.x[id] + r * (c * dx - s * dy), state.y[id] + r * (s * dx + c * dy)];
    };
    const [rx, ry, yaw] = state.rim;
    const onRim = (u, v) => [rx + Math.cos(yaw) * u - Math.sin(yaw) * v, ry + Math.sin(yaw) * u + Math.cos(yaw) * v];
    const [gapX, gapY] = GAPS_M;
    for (const id of IDS) {
      const [column, row] = place(id);
      const [u, v] = rest(id);
      if (stands(column + 1, row)) this.spring(point(id, 1, 0), point(id + 1, -1, 0), gapX);
      if (stands(column, row + 1)) this.spring(point(id, 0, 1), point(id + COLUMNS, 0, -1), gapY);
      if (column === 0) this.spring(onRim(-RIM_M[0] / 2, v), point(id, -1, 0), gapX);
      if (column === COLUMNS - 1) this.spring(point(id, 1, 0), onRim(RIM_M[0] / 2, v), gapX);
      if (row === 0) this.spring(onRim(u, -RIM_M[1] / 2), point(id, 0, -1), gapY);
      if (row === ROWS - 1) this.spring(point(id, 0, 1), onRim(u, RIM_M[1] / 2), gapY);
    }
    brush.setTransform(this.perM, 0, 0, -this.perM, this.w / 2, this.h / 2);
  }

  // A coil seen from the side; its colour tells the strain: blue short, ember long. Drawn once for
  // each shade of strain and then stretched: sixty zigzags at each drawing are dear without a GPU.
  spring([x0, y0], [x1, y1], gap) {
    const { brush } = this;
    const long = Math.hypot(x1 - x0, y1 - y0);
    const strain = Math.max(-1, Math.min(1, (long - gap) / (TAUT * gap)));
    const [ux, uy] = [(x1 - x0) / long, (y1 - y0) / long];
    const { perM, w, h } = this;
    brush.setTransform(perM * ux, -perM * uy, perM * uy, perM * ux, w / 2 + perM * x0, h / 2 - perM * y0);
    brush.drawImage(this.coils[Math.round(strain * TINTS) + TINTS], 0, -COIL_M, long, 2 * COIL_M);
  }

  drawBlock(id, state, light) {
    const { brush, land } = this;
    const half = BLOCK_M / 2;
    brush.save();
    brush.translate(state.x[id], state.y[id]);
    brush.fillStyle = '#0009';
    brush.fillRect(-half + 0.004, -half - 0.007, BLOCK_M, BLOCK_M);
    brush.rotate(state.yaw[id]);
    if (land) {
      const tile = land.width / COLUMNS;
      const [column, row] = place(id);
      brush.scale(1, -1);
      brush.drawImage(land, column * tile, (ROWS - 1 - row) * tile, tile, tile, -half, -half, BLOCK_M, BLOCK_M);
      brush.scale(1, -1);
    } else {
      brush.fillStyle = '#8b8a7c';
      brush.fillRect(-half, -half, BLOCK_M, BLOCK_M);
    }
    if (light > 0.02) {
      brush.globalAlpha = Math.min(light, 1) * 0.5;
      brush.fillStyle = '#fffaf0';
      brush.fillRect(-half, -half, BLOCK_M, BLOCK_M);
      brush.globalAlpha = 1;
    }
    brush.lineWidth = state.moving[id] ? 0.0036 : 0.0012;
    brush.strokeStyle = state.moving[id] ? MOVE : '#0b0d10';
    brush.strokeRect(-half, -half, BLOCK_M, BLOCK_M);
    brush.restore();
  }

  drawLight(state, leds) {
    const { brush } = this;
    brush.globalCompositeOperation = 'lighter';
    for (const id of IDS) {
      const level = leds[id] / 255;
      if (level <= 0.02) continue;
      brush.globalAlpha = level * 0.5;
      const r = BLOCK_M * 1.9;
      brush.drawImage(this.glow, state.x[id] - r, state.y[id] - r, 2 * r, 2 * r);
    }
    brush.globalAlpha = 1;
    brush.globalCompositeOperation = 'source-over';
  }

  // Of each cascade a bull's-eye where it began, and arrows along the springs in order of onset. They
  // fade with age; the bull's-eye does after the last slip.
  drawCascades(now, state) {
    const { brush } = this;
    this.paths.pass(now);
    const { cascades } = this.paths;
    const newest = new Map(cascades.map((cascade) => [cascade.slips[0].block, cascade])); // by origin
    for (const cascade of cascades) {
      const { hue, slips, joins, keep } = cascade;
      const bright = (at) => Math.min(Math.max(1.2 * (1 - (now - at) / keep), 0.4), 1);
      const begun = slips.filter(({ at }) => at <= now);
      if (!begun.length) continue;
      const [{ block }] = slips;
      const since = now - Math.max(...begun.map(({ at }) => at));
      const mark = Math.min((KEEP_MS - since) / MARK_FADE_MS, 1);
      brush.strokeStyle = brush.fillStyle = HUES[hue];
      for (const { path, at } of joins) {
        if (at > now) continue;
        // Arrows from the first block stay as bright as its mark: they show where the cascade went.
        brush.globalAlpha = path[0] === block ? mark : bright(at);
        const places = path.map((id) => [state.x[id], state.y[id]]);
        if (places.length > 1) this.drawArrow(places);
        else this.drawRing(...places[0], 0.012 * SIZE, 0.012 * SIZE, brush.globalAlpha);
      }
      brush.globalAlpha = mark;
      if (newest.get(block) !== cascade) continue;
      this.drawOrigin(state.x[block], state.y[block], begun.length > 1);
      if (calm.matches) continue;
      const t = (now - slips[0].at) / WAVE_MS;
      if (t < 1) this.drawRing(state.x[block], state.y[block], BLOCK_M * (0.9 + 1.5 * t), 0.003 * SIZE, (1 - t) ** 2);
    }
    brush.globalAlpha = 1;
  }

  drawOrigin(x, y, grown) {
    const { brush } = this;
    const alpha = brush.globalAlpha;
    this.drawRing(x, y, 0.024 * SIZE, 0.013 * SIZE, alpha);
    if (grown) this.drawRing(x, y, 0.056 * SIZE, 0.01 * SIZE, alpha);
  }

  drawRing(x, y, radius, wide, alpha) {
    const { brush } = this;
    brush.globalAlpha = alpha;
    brush.beginPath();
    brush.arc(x, y, radius, 0, 7);
    this.strokeOnDark(wide);
  }

  drawArrow(points) {
    const { brush } = this;
    const [[x0, y0], [x1, y1]] = points.slice(-2);
    const long = Math.hypot(x1 - x0, y1 - y0) || 1;
    const [ux, uy] = [(x1 - x0) / long, (y1 - y0) / long];
    const [tipX, tipY] = [x1 - 0.03 * SIZE * ux, y1 - 0.03 * SIZE * uy];
    const [footX, footY] = [tipX - 0.045 * SIZE * ux, tipY - 0.045 * SIZE * uy];
    brush.lineJoin = 'round';
    brush.lineCap = 'butt';
    brush.beginPath();
    for (const [x, y] of points.slice(0, -1)) brush.lineTo(x, y);
    brush.lineTo(footX, footY);
    this.strokeOnDark(0.012 * SIZE);
    brush.beginPath();
    brush.moveTo(tipX, tipY);
    for (const side of [1, -1]) brush.lineTo(footX - 0.028 * SIZE * side * uy, footY + 0.028 * SIZE * side * ux);
    brush.closePath();
    this.strokeOnDark(0.002 * SIZE);
    brush.fill();
  }

  // Over bright blocks and dark ground alike.
  strokeOnDark(wide) {
    const { brush } = this;
    const hue = brush.strokeStyle;
    brush.lineWidth = wide + 0.007 * SIZE;
    brush.strokeStyle = '#0b0d10';
    brush.stroke();
    brush.lineWidth = wide;
    brush.strokeStyle = hue;
    brush.stroke();
  }
}

function frame(brush, x, y, [ox, oy], [ix, iy]) {
  brush.beginPath();
  brush.rect(x - ox, y - oy, 2 * ox, 2 * oy);
  brush.rect(x + ix, y - iy, -2 * ix, 2 * iy);
  brush.fill('evenodd');
}

function glowSprite() {
  const sprite = new OffscreenCanvas(128, 128);
  const brush = sprite.getContext('2d');
  const light = brush.createRadialGradient(64, 64, 4, 64, 64, 64);
  light.addColorStop(0, 'rgba(255,250,235,.95)');
  light.addColorStop(0.35, 'rgba(255,236,200,.34)');
  light.addColorStop(1, 'rgba(255,220,170,0)');
  brush.fillStyle = light;
  brush.fillRect(0, 0, 128, 128);
  return sprite;
}

function coil(strain, perM) {
  const [w, h] = [Math.max(Math.round(Math.max(...GAPS_M) * perM), 8), Math.max(Math.round(2 * COIL_M * perM), 4)];
  const picture = new OffscreenCanvas(w, h);
  const brush = picture.getContext('2d');
  const mix = (a, b) => Math.round(a + (b - a) * Math.abs(strain));
  brush.strokeStyle = strain > 0
    ? `rgb(${mix(150, 255)},${mix(154, 138)},${mix(150, 92)})`
    : `rgb(${mix(150, 110)},${mix(154, 190)},${mix(150, 220)})`;
  brush.lineWidth = 0.0022 * SIZE * perM;
  const turns = 9;
  const wide = 0.006 * SIZE * perM;
  brush.beginPath();
  brush.moveTo(0, h / 2);
  for (let i = 0; i <= 2 * turns; i++) {
    const side = i === 0 || i === 2 * turns ? 0 : i % 2 ? wide : -wide;
    brush.lineTo(w * (0.12 + (0.76 * i) / (2 * turns)), h / 2 + side);
  }
  brush.lineTo(w, h / 2);
  brush.stroke();
  return picture;
}

// What stands still under everything: the platform on the dark floor.
function platform(side, [wide, deep]) {
  const canvas = new OffscreenCanvas(side, side);
  const brush = canvas.getContext('2d', { alpha: false });
  brush.fillStyle = '#060809';
  brush.fillRect(0, 0, side, side);
  brush.drawImage(sandpaper(wide, deep), Math.round((side - wide) / 2), Math.round((side - deep) / 2));
  return canvas;
}

// 120 grit: a dark ground with fine even grain, the same at each start.
function sandpaper(w, h) {
  const size = Math.max(w, h);
  const canvas = new OffscreenCanvas(Math.max(w, 1), Math.max(h, 1));
  const brush = canvas.getContext('2d');
  const tile = new OffscreenCanvas(128, 128);
  const pen = tile.getContext('2d');
  const picture = pen.createImageData(128, 128);
  let seed = 7;
  for (let i = 0; i < picture.data.length; i += 4) {
    seed = (seed * 1103515245 + 12345) % 2147483648;
    const grain = 21 + ((seed >> 16) % 15);
    picture.data.set([grain + 4, grain + 1, grain - 2, 255], i);
  }
  pen.putImageData(picture, 0, 0);
  brush.fillStyle = brush.createPattern(tile, 'repeat');
  brush.fillRect(0, 0, w, h);
  const dim = brush.createRadialGradient(w / 2, h / 2, size * 0.2, w / 2, h / 2, size * 0.75);
  dim.addColorStop(0, 'rgba(0,0,0,0)');
  dim.addColorStop(1, 'rgba(0,0,0,.62)');
  brush.fillStyle = dim;
  brush.fillRect(0, 0, w, h);
  brush.strokeStyle = '#3a3d3c';
  brush.lineWidth = 1.5;
  brush.strokeRect(1, 1, w - 2, h - 2);
  return canvas;
}
