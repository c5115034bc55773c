// SPDX-License-Identifier: Apache-2.0
// One wall: two layers, the next picture drawn and ready in the hidden one, changed at the told time.

import { calm } from './paint.js';

const CALM_GAP_MS = 4000; // where quick changes are unwelcome, and each is a slow cross-fade
const CALM_FADE_S = 1.5;
const HEAL_FADE_S = 2; // from one degree of damage of a picture to another
const SAFE_GAP_MS = 340; // WCAG 2.3.1; the server never asks for less, a bad network might

export class WallView {
  constructor(holder, side, link) {
    this.side = side;
    this.link = link;
    this.layers = [0, 1].map(() => {
      const canvas = document.createElement('canvas');
      canvas.className = 'layer';
      canvas.setAttribute('aria-hidden', 'true');
      holder.append(canvas);
      return canvas;
    });
    this.drawn = ['', '']; // name of what each layer holds, complete
    this.front = 0;
    this.pictures = new Map();
    this.looks = {}; // fit and focus of pictures that have any
    this.current = null;
    this.pending = null;
    this.lastFlip = -1e9;
    this.onflip = () => {};
    this.finish = () => {}; // a last stroke over each picture, when it is painted
    new ResizeObserver(() => this.resize()).observe(holder);
    this.holder = holder;
    this.resize();
    link.on('wall', (wall) => this.take(wall));
  }

  // Name of the picture that is shown; empty when black.
  get shows() {
    return this.drawn[this.front];
  }

  pick(list) {
    return list.filter((_, i) => i % 2 === (this.side === 'left' ? 0 : 1));
  }

  take(wall) {
    const name = wall[this.side];
    this.moving = wall.moving;
    this.fade = wall.fade;
    this.ahead = this.pick(wall.ahead);
    this.looks = { ...this.looks, ...wall.looks };
    for (const each of [name, ...this.ahead]) this.load(each);
    this.forget([name, ...this.ahead, ...this.drawn]);
    if (this.current && this.current.change === wall.change) return; // only the state changed
    this.current = wall;
    this.pending = { name, change: wall.change, at: wall.flip };
    this.watch();
  }

  load(name) {
    if (!name || this.pictures.has(name)) return;
    const image = new Image();
    const entry = { image, ready: false };
    this.pictures.set(name, entry);
    image.src = '/media/' + name.split('/').map(encodeURIComponent).join('/');
    image.decode().then(
      () => {
        entry.ready = true;
        this.prepare();
      },
      () => this.pictures.delete(name), // gone or broken: keep what is shown, try when it comes again
    );
  }

  forget(keep) {
    for (const name of this.pictures.keys()) if (!keep.includes(name)) this.pictures.delete(name);
  }

  // Draw what comes next into the hidden layer, so that a change is a change of layer only.
  prepare() {
    const name = this.pending ? this.pending.name : this.ahead && this.ahead[0];
    const back = 1 - this.front;
    if (this.fading || this.drawn[back] === name) return;
    this.paint(back, name);
  }

  paint(layer, name) {
    const canvas = this.layers[layer];
    const brush = canvas.getContext('2d', { alpha: false });
    const entry = this.pictures.get(name);
    if (name && !(entry && entry.ready)) return;
    brush.fillStyle = '#000';
    brush.fillRect(0, 0, canvas.width, canvas.height);
    if (name) {
      const { image } = entry;
      const [fit, x, y] = this.looks[name] ?? ['cover', 0.5, 0.5];
      const scales = [canvas.width / image.naturalWidth, canvas.height / image.naturalHeight];
      const scale = fit === 'contain' ? Math.min(...scales) : Math.max(...scales);
      const w = image.naturalWidth * scale;
      const h = image.naturalHeight * scale;
      // The focus comes to the middle, as far as the image reaches.
      const place = (all, long, focus) => (long <= all ? (all - long) / 2 : Math.min(Math.max(all / 2 - focus * long, all - long), 0));
      brush.drawImage(image, place(canvas.width, w, x), place(canvas.height, h, y), w, h);
      this.finish(brush, canvas.width, canvas.height);
    }
    this.drawn[layer] = name;
  }

  watch() {
    if (this.watching) return;
    this.watching = true;
    const step = (now) => {
      const next = this.pending;
      if (!next) {
        this.watching = false;
        return;
      }
      this.prepare();
      const gap = calm.matches && next.name ? CALM_GAP_MS : SAFE_GAP_MS;
      const due = this.link.now() >= next.at && now - this.lastFlip >= gap;
      if (due && this.drawn[1 - this.front] === next.name) this.flip(next, now);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  flip(next, now) {
    const [shown, hidden] = [this.layers[1 - this.front], this.layers[this.front]];
    const slow = calm.matches ? CALM_FADE_S : 0;
    const mends = next.name && whole(next.name) === whole(this.shows);
    const fade = Math.max(this.fade, mends ? HEAL_FADE_S : next.name ? slow : 2); // into sleep: softly
    this.front = 1 - this.front;
    this.lastFlip = now;
    this.pending = null;
    shown.style.transition = 'none';
    shown.style.zIndex = 2;
    hidden.style.zIndex = 1;
    if (fade > 0) {
      shown.style.opacity = 0;
      void shown.offsetWidth;
      shown.style.transition = `opacity ${fade}s linear`;
      this.fading = true;
      setTimeout(() => {
        this.fading = false;
        this.prepare();
      }, fade * 1000);
    }
    shown.style.opacity = 1;
    this.onflip(next, now);
    if (fade <= 0) setTimeout(() => this.prepare(), 30);
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const { clientWidth: w, clientHeight: h } = this.holder;
    for (const i of [0, 1]) {
      const canvas = this.layers[i];
      canvas.width = Math.max(Math.round(w * ratio), 1);
      canvas.height = Math.max(Math.round(h * ratio), 1);
      const name = this.drawn[i];
      this.drawn[i] = '';
      if (name) this.paint(i, name);
    }
  }
}

// The name of a picture without its degree of damage: dam.3.svg and dam.1.svg are the same dam.
function whole(name) {
  return name.replace(/\.\d(\.\w+)$/, '$1');
}
