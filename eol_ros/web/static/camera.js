// SPDX-License-Identifier: Apache-2.0
// The live infrared picture with the outlines, ids and states of the blocks over it.

import { BLOCK_M, COLUMNS, COUNT, IDS, place, PLATFORM_M, ROWS, stands } from './lattice.js';
import { fit, fontPx, INK, MOVE, QUIET, write } from './paint.js';
import { say } from './i18n.js';
import { part } from './modes.js';

const TABLE_M = Math.max(...PLATFORM_M) + 0.04; // of the image, across: the platform and a little of the floor
const STRAYS = 0.01; // of the image: by less the part that is shown does not follow

const REMEMBERED = 60; // places of the blocks, one an image: a second of them

const PREVIEW_SCALE = 0.5; // of the JPEG against the image whose pixels the blocks are told in

/** Size of the image behind a JPEG, from its start-of-frame segment (ITU T.81, B.2.2); null if none. */
function imageSize(bytes) {
  const word = (i) => (bytes[i] << 8) | bytes[i + 1];
  for (let i = 2; i + 9 < bytes.length && bytes[i] === 0xff; i += 2 + word(i + 2)) {
    if (bytes[i + 1] >= 0xc0 && bytes[i + 1] <= 0xc3) {
      return { width: word(i + 7) / PREVIEW_SCALE, height: word(i + 5) / PREVIEW_SCALE };
    }
  }
  return null;
}

export class CameraView {
  constructor(card) {
    this.canvas = card.querySelector('canvas');
    this.buttons = [...card.querySelectorAll('[data-view]')];
    this.size = { width: 1280, height: 800 };
    this.part = null; // of the image that shows the table: its middle and its side, pixels
    this.canvas.dataset.images = 0;
    this.outlines = true;
    this.labels = new Map();
    this.past = [];
    for (const button of this.buttons) button.onclick = () => this.show(button.dataset.view);
    const toggle = card.querySelector('#outlines');
    this.toggleOutlines = () => {
      this.outlines = !this.outlines;
      toggle.setAttribute('aria-pressed', this.outlines);
      this.dirty = true;
    };
    toggle.onclick = this.toggleOutlines;
    this.under = card.querySelector('#under');
    this.pointed = -1; // the block under the pointer, or that the arrows have come to
    this.canvas.onpointermove = ({ offsetX, offsetY }) => this.point(this.blockAt(offsetX, offsetY));
    this.canvas.onpointerleave = () => this.point(-1);
    this.canvas.onkeydown = (event) => this.key(event);
    this.onview = () => {};
    this.show('source');
  }

  show(view) {
    this.view = view;
    for (const button of this.buttons) button.setAttribute('aria-pressed', button.dataset.view === view);
    this.canvas.dataset.view = view;
    this.dirty = true;
    this.onview(view);
  }

  async take({ data, stamp }) {
    if (this.view === 'off' || this.decoding) return; // newest wins: one at a time
    this.decoding = true;
    try {
      const bytes = new Uint8Array(data, 16);
      this.size = imageSize(bytes) ?? this.size;
      const jpeg = new Blob([bytes], { type: 'image/jpeg' });
      const { width, height } = this.canvas; // cut and scaled once here, not at each drawing
      const cut = this.cut(width / height);
      const [x, y, w, h] = [cut.x, cut.y, cut.w, cut.h].map((pixels) => Math.round(pixels * PREVIEW_SCALE));
      const picture = await createImageBitmap(jpeg, x, y, w, h, { resizeWidth: Math.max(width, 64), resizeQuality: 'medium' });
      if (this.picture) this.picture.close();
      this.picture = picture;
      this.pictureCut = cut;
      this.stamp = stamp;
      this.canvas.dataset.images = Number(this.canvas.dataset.images || 0) + 1;
      this.dirty = true;
    } catch {
      // a picture cut off on its way: the next one comes in 0.1 s
    }
    this.decoding = false;
  }

  // The part of the image to show on a canvas of this aspect: the table, whole, and what is beside it.
  cut(aspect) {
    const { width, height } = this.size;
    const { u, v, side } = this.part ?? { u: width / 2, v: height / 2, side: height };
    const w = Math.min(side * Math.max(aspect, 1), width);
    const h = Math.min(side / Math.min(aspect, 1), height);
    const within = (middle, long, all) => Math.min(Math.max(middle - long / 2, 0), all - long);
    return { x: within(u, w, width), y: within(v, h, height), w, h };
  }

  // How the cut lies on a canvas: pixels of the screen for one of the image, and where its corner is.
  lie({ x, y, w: cw, h: ch }, w, h) {
    const k = Math.min(w / cw, h / ch);
    return { k, left: (w - k * cw) / 2 - k * x, top: (h - k * ch) / 2 - k * y };
  }

  blocks(blocks, moving) {
    const found = tableInImage(blocks.rows);
    const far = (a, b) => Math.abs(a - b) > STRAYS * this.size.width;
    if (found && (!this.part || far(found.u, this.part.u) || far(found.v, this.part.v) || far(found.side, this.part.side))) this.part = found;
    this.past.push({ blocks, moving: moving.slice() });
    if (this.past.length > REMEMBERED) this.past.shift();
  }

  // Arrows walk from block to block.
  key(event) {
    const step = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step) return;
    const ahead = Array.from({ length: Math.max(COLUMNS, ROWS) }, (_, n) => place(this.pointed).map((at, axis) => at + (n + 1) * step[axis]));
    const next = ahead.find((at) => stands(...at)); // beyond places without a block
    if (this.pointed < 0) this.point(IDS[0]);
    else if (next) this.point(next[1] * COLUMNS + next[0]);
    event.preventDefault();
  }

  // Say which block it is and how it stands, for who hears the page, and mark it.
  point(id) {
    if (id === this.pointed) return;
    this.pointed = id;
    this.dirty = true;
    const newest = this.past[this.past.length - 1];
    if (id < 0 || !newest) return write(this.under, '');
    const [x, y] = newest.blocks.rows.subarray(id * 8, id * 8 + 2);
    const state = say(!newest.blocks.rows[id * 8 + 7] ? 'unseen' : newest.moving[id] ? 'slipping' : 'at_rest');
    const words = say('under_words', { block: id, where: say(`where_${part(id)}`), state });
    write(this.under, Number.isFinite(x + y) ? `${words}, x ${Math.round(1000 * x)} mm, y ${Math.round(1000 * y)} mm` : words);
  }

  // Where the blocks were in the picture that is shown: it is older than the newest of them.
  atPicture() {
    const newest = this.past[this.past.length - 1];
    if (this.view === 'off' || !this.picture) return newest;
    return this.past.findLast(({ blocks }) => blocks.stamp <= this.stamp + 1e-3) ?? newest;
  }

  draw() {
    if (!this.dirty) return;
    this.dirty = false;
    const { brush, w, h } = fit(this.canvas, '#000');
    const shown = this.view !== 'off' && this.picture;
    const cut = shown ? this.pictureCut : this.cut(w / h);
    const { k, left, top } = (this.lies = this.lie(cut, w, h));
    if (shown) {
      const place = [left + k * cut.x, top + k * cut.y, k * cut.w, k * cut.h];
      brush.drawImage(this.picture, ...place);
    }
    if (this.view === 'off') {
      brush.fillStyle = QUIET;
      brush.font = `300 ${fontPx(1)}px system-ui`;
      brush.textAlign = 'center';
      brush.fillText(say('picture_off'), w / 2, 2 * fontPx(1));
    }
    if (this.outlines && this.past.length) this.drawBlocks(brush);
  }

  // The block whose cover lies under a place on the canvas; -1 for none.
  blockAt(x, y) {
    const newest = this.past[this.past.length - 1];
    if (!newest || !this.lies) return -1;
    const { k, left, top } = this.lies;
    const { rows } = newest.blocks;
    const half = (BLOCK_M * pixelsPerMetre(rows) * k) / 2;
    return IDS.find((id) => Math.max(
      Math.abs(left + k * rows[id * 8 + 3] - x), Math.abs(top + k * rows[id * 8 + 4] - y),
    ) < half) ?? -1;
  }

  drawBlocks(brush) {
    const { blocks: { rows }, moving } = this.atPicture();
    const { k, left, top } = this.lies;
    const side = BLOCK_M * pixelsPerMetre(rows) * k;
    const size = Math.max(fontPx(0.72), 9);
    for (const id of IDS) {
      const at = id * 8;
      const [u, v, seen] = [left + k * rows[at + 3], top + k * rows[at + 4], rows[at + 7]];
      if (!Number.isFinite(u + v)) continue;
      brush.save();
      brush.translate(u, v);
      brush.strokeStyle = moving[id] ? MOVE : seen ? INK : QUIET;
      brush.lineWidth = id === this.pointed ? 4 : moving[id] ? 2.5 : 1.2;
      brush.setLineDash(seen ? [] : [3, 3]);
      brush.save();
      brush.rotate(-rows[at + 2]);
      brush.strokeRect(-side / 2, -side / 2, side, side);
      brush.restore();
      brush.drawImage(this.label(id, brush.strokeStyle, size), side / 2 - 0.2 * size, -side / 2 - size, 2 * size, 2 * size);
      brush.restore();
    }
  }

  // An id with a dark edge: outlined letters are dear to draw, so each is kept as a picture.
  label(id, colour, size) {
    const key = `${id} ${colour} ${size}`;
    if (this.labels.has(key)) return this.labels.get(key);
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const picture = new OffscreenCanvas(Math.ceil(2 * size * ratio), Math.ceil(2 * size * ratio));
    const brush = picture.getContext('2d');
    brush.scale(ratio, ratio);
    brush.font = `400 ${size}px ui-monospace, monospace`;
    brush.textAlign = 'center';
    brush.textBaseline = 'middle';
    brush.lineWidth = 3;
    brush.strokeStyle = '#000c';
    brush.strokeText(id, size, size);
    brush.fillStyle = colour;
    brush.fillText(id, size, size);
    if (this.labels.size > 8 * COUNT) this.labels.clear(); // another size of window
    this.labels.set(key, picture);
    return picture;
  }
}

// From the blocks themselves: pixels against metres over the widest pair.
function pixelsPerMetre(rows) {
  let [metres, pixels] = [0, 0];
  for (const id of IDS) {
    const [a, b] = [id * 8, IDS[COUNT - 1] * 8];
    const far = Math.hypot(rows[a] - rows[b], rows[a + 1] - rows[b + 1]);
    if (far > metres) {
      metres = far;
      pixels = Math.hypot(rows[a + 3] - rows[b + 3], rows[a + 4] - rows[b + 4]);
    }
  }
  return metres > 0.05 ? pixels / metres : 545;
}

// Where the table's middle lies in the image and how long its side is there, pixels; null if unknown.
// u and v are taken for linear in x and y: least squares over the blocks.
function tableInImage(rows) {
  const seen = IDS.map((id) => rows.subarray(id * 8, id * 8 + 8)).filter((row) => row.subarray(0, 5).every(Number.isFinite));
  if (seen.length < Math.min(5, COUNT)) return null;
  const mean = (i) => seen.reduce((sum, row) => sum + row[i], 0) / seen.length;
  const [x, y, u, v] = [0, 1, 3, 4].map(mean);
  const product = (i, a, j, b) => seen.reduce((sum, row) => sum + (row[i] - a) * (row[j] - b), 0);
  const [xx, xy, yy] = [product(0, x, 0, x), product(0, x, 1, y), product(1, y, 1, y)];
  const det = xx * yy - xy * xy;
  if (!(det > 1e-6)) return null;
  const origin = (i, m) => {
    const [xm, ym] = [product(0, x, i, m), product(1, y, i, m)];
    return m - (x * (yy * xm - xy * ym) + y * (xx * ym - xy * xm)) / det;
  };
  return { u: origin(3, u), v: origin(4, v), side: TABLE_M * pixelsPerMetre(rows) };
}
