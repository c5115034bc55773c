// SPDX-License-Identifier: Apache-2.0
// The live infrared picture with the outlines, ids and states of the blocks over it.

import { fit, fontPx, INK, MOVE, QUIET, THREAD } from './paint.js';
import { say } from './i18n.js';

const BLOCK_M = 0.084;

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
    this.histogram = card.querySelector('#histogram');
    this.slider = card.querySelector('#threshold');
    this.row = card.querySelector('#threshold-row');
    this.buttons = [...card.querySelectorAll('[data-view]')];
    this.size = { width: 1280, height: 800 };
    this.outlines = true;
    this.labels = new Map();
    this.past = [];
    this.level = Number(this.slider.value);
    for (const button of this.buttons) button.onclick = () => this.show(button.dataset.view);
    this.slider.oninput = () => {
      this.level = Number(this.slider.value);
      this.slider.nextElementSibling.value = this.level || say('threshold_none');
      this.dirty = true;
    };
    this.slider.oninput();
    const toggle = card.querySelector('#outlines');
    this.toggleOutlines = () => {
      this.outlines = !this.outlines;
      toggle.setAttribute('aria-pressed', this.outlines);
      this.dirty = true;
    };
    toggle.onclick = this.toggleOutlines;
    this.onview = () => {};
    this.show('source');
  }

  // What the tracker works with, unless somebody is trying another value here.
  showThreshold(value) {
    if (!Number.isFinite(Number(value ?? NaN)) || value === this.told) return;
    this.told = value;
    this.slider.value = value;
    this.slider.oninput();
  }

  show(view) {
    this.view = view;
    for (const button of this.buttons) button.setAttribute('aria-pressed', button.dataset.view === view);
    this.row.hidden = view !== 'threshold';
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
      const { width } = this.canvas; // scaled once here, not at each drawing
      const picture = await createImageBitmap(jpeg, { resizeWidth: Math.max(width, 64), resizeQuality: 'medium' });
      if (this.picture) this.picture.close();
      this.picture = picture;
      this.stamp = stamp;
      this.canvas.dataset.images = Number(this.canvas.dataset.images || 0) + 1;
      this.dirty = true;
    } catch {
      // a picture cut off on its way: the next one comes in 0.1 s
    }
    this.decoding = false;
  }

  blocks(blocks, moving) {
    this.past.push({ blocks, moving: moving.slice() });
    if (this.past.length > REMEMBERED) this.past.shift();
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
    if (this.view !== 'off' && this.picture) {
      if (this.view === 'threshold') this.drawThreshold(brush, w, h);
      else brush.drawImage(this.picture, 0, 0, w, h);
    }
    if (this.view === 'off') {
      brush.fillStyle = QUIET;
      brush.font = `300 ${fontPx(1)}px system-ui`;
      brush.textAlign = 'center';
      brush.fillText(say('picture_off'), w / 2, 2 * fontPx(1));
    }
    if (this.outlines && this.past.length) this.drawBlocks(brush, w, h);
  }

  drawThreshold(brush, w, h) {
    const small = (this.small ??= new OffscreenCanvas(1, 1));
    const of = `${this.stamp} ${this.level}`;
    if (this.smallOf === of) return brush.drawImage(small, 0, 0, w, h);
    this.smallOf = of;
    small.width = this.picture.width;
    small.height = this.picture.height;
    const pen = small.getContext('2d', { willReadFrequently: true });
    pen.drawImage(this.picture, 0, 0);
    const pixels = pen.getImageData(0, 0, small.width, small.height);
    const data = new Uint32Array(pixels.data.buffer);
    const counts = new Uint32Array(256);
    for (let i = 0; i < data.length; i++) {
      const grey = data[i] & 255;
      counts[grey]++;
      if (this.level) data[i] = grey >= this.level ? 0xffffffff : 0xff000000;
    }
    pen.putImageData(pixels, 0, 0);
    brush.drawImage(small, 0, 0, w, h);
    this.drawHistogram(counts);
  }

  drawHistogram(counts) {
    const brush = this.histogram.getContext('2d');
    const { width, height } = this.histogram;
    brush.clearRect(0, 0, width, height);
    const most = Math.log1p(Math.max(...counts));
    for (let i = 0; i < 256; i++) {
      const tall = (height * Math.log1p(counts[i])) / most;
      brush.fillStyle = i >= this.level ? INK : '#5d6972';
      brush.fillRect(i, height - tall, 1, tall);
    }
    brush.fillStyle = THREAD;
    brush.fillRect(this.level, 0, 1, height);
  }

  drawBlocks(brush, w, h) {
    const { blocks: { rows }, moving } = this.atPicture();
    const k = w / this.size.width;
    const side = BLOCK_M * pixelsPerMetre(rows) * k;
    const size = Math.max(fontPx(0.72), 9);
    for (let id = 0; id < 25; id++) {
      const at = id * 8;
      const [u, v, seen] = [rows[at + 3] * k, rows[at + 4] * k, rows[at + 7]];
      if (!Number.isFinite(u + v)) continue;
      brush.save();
      brush.translate(u, v);
      brush.strokeStyle = moving[id] ? MOVE : seen ? INK : QUIET;
      brush.lineWidth = moving[id] ? 2.5 : 1.2;
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
    if (this.labels.size > 200) this.labels.clear(); // another size of window
    this.labels.set(key, picture);
    return picture;
  }
}

// From the blocks themselves: pixels against metres over the widest pair.
function pixelsPerMetre(rows) {
  let [metres, pixels] = [0, 0];
  for (let i = 0; i < 24; i++) {
    const [a, b] = [i * 8, 24 * 8];
    const far = Math.hypot(rows[a] - rows[b], rows[a + 1] - rows[b + 1]);
    if (far > metres) {
      metres = far;
      pixels = Math.hypot(rows[a + 3] - rows[b + 3], rows[a + 4] - rows[b + 4]);
    }
  }
  return metres > 0.05 ? pixels / metres : 545;
}
