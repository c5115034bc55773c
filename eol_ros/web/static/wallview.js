// SPDX-License-Identifier: Apache-2.0
// One wall: two layers, the next picture drawn and ready in the hidden one, changed at the told time.

import { film, moves, place, source } from './film.js';
import { calm } from './paint.js';

const CALM_GAP_MS = 4000; // where quick changes are unwelcome, and each is a slow cross-fade
const CALM_FADE_S = 1.5;
const HEAL_FADE_S = 2; // from one degree of damage of a picture to another
const SLEEP_FADE_S = 2; // at least, into sleep and out of it; `sleep_fade_s` of leds asks for more
const SAFE_GAP_MS = 340; // WCAG 2.3.1; the server never asks for less, a bad network might

export class WallView {
  // still: videos are shown by their posters, or first images; only walls play them.
  constructor(holder, side, link, still = false) {
    this.side = side;
    this.still = still;
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
    this.films = new Map(); // the one that is shown and the one that comes next, by file
    this.looks = {}; // fit and focus of pictures that have any; how videos play, and their posters
    this.current = null;
    this.pending = null;
    this.lastFlip = -1e9;
    this.sleepFade = SLEEP_FADE_S;
    this.onflip = () => {};
    this.finish = () => {}; // a last stroke over each picture, when it is painted
    new ResizeObserver(() => this.resize()).observe(holder);
    this.holder = holder;
    this.resize();
    link.on('wall', (wall) => this.take(wall));
    link.on('health', ({ node, values }) => {
      if (node === 'leds') this.sleepFade = Math.max(values.sleep_fade_s ?? 0, SLEEP_FADE_S);
    });
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
    const news = !this.current || this.current.change !== wall.change; // else only the state changed
    this.current = wall;
    if (news) {
      this.pending = { name, change: wall.change, at: wall.flip + (name ? 0 : this.sleepFade) };
      this.holder.style.transition = `opacity ${this.sleepFade}s linear`;
      this.holder.style.opacity = name ? '' : 0;
    }
    this.load([name, ...this.ahead, ...this.drawn]);
    this.run(this.shows);
    if (news) this.watch();
  }

  look(name) {
    const [fit = 'cover', x = 0.5, y = 0.5, play = 'loop', poster = ''] = this.looks[name] ?? [];
    return { fit, x, y, play, poster };
  }

  // Have what will be shown decoded; of videos the posters, and those two that are shown and come next.
  load(names) {
    const films = [this.shows, this.pending ? this.pending.name : this.ahead[0]].filter(Boolean).filter(moves).map(source);
    const stills = names.map((name) => (moves(name) ? this.look(name).poster : name)).filter(Boolean);
    for (const [name, one] of this.films) {
      if (!films.includes(name)) {
        one.close();
        this.films.delete(name);
      }
    }
    for (const name of this.pictures.keys()) if (!stills.includes(name)) this.pictures.delete(name);
    for (const name of stills) if (!this.pictures.has(name)) this.loadImage(name);
    for (const name of films) if (!this.films.has(name)) this.loadFilm(name);
  }

  loadImage(name) {
    const image = new Image();
    const entry = { image, ready: false };
    this.pictures.set(name, entry);
    image.src = address(name);
    image.decode().then(
      () => {
        [entry.width, entry.height, entry.ready] = [image.naturalWidth, image.naturalHeight, true];
        this.prepare();
      },
      () => this.pictures.delete(name), // gone or broken: keep what is shown, try when it comes again
    );
  }

  loadFilm(name) {
    const shown = () => source(this.shows) === name;
    this.films.set(name, film(address(name), {
      ready: () => {
        const back = 1 - this.front;
        if (source(this.drawn[back]) === name) this.drawn[back] = ''; // its poster
        if (shown() && !this.pending) {
          this.paint(this.front, this.shows);
          this.run(this.shows);
        }
        this.prepare();
      },
      image: () => shown() && this.paint(this.front, this.shows),
      failed: () => this.films.delete(name),
    }));
  }

  get rests() {
    return this.still || calm.matches;
  }

  // Let the video that is shown play as it is asked to.
  run(name) {
    const one = this.films.get(source(name));
    if (!one || !one.ready || this.rests) return;
    const { play } = this.look(name);
    if (play === 'damage') one.play(false, place(name));
    else if (play === 'moving' && !this.moving) one.hold();
    else one.play(play !== 'once');
  }

  // What can be drawn of a picture now: its video, else its poster or the picture itself.
  picture(name) {
    const one = this.films.get(source(name));
    return one && one.ready ? one : this.pictures.get(moves(name) ? this.look(name).poster : name);
  }

  // Whether a picture is the video that is shown, and goes on from there.
  goesOn(name) {
    const same = this.films.has(source(name)) && source(name) === source(this.shows);
    return same && (this.look(name).play !== 'damage' || (!this.rests && place(name) >= place(this.shows)));
  }

  // Whether a video stands where it will begin; if not it is sent there, and tells when it is.
  poised(name) {
    const one = this.films.get(source(name));
    if (!one || !one.ready) return true;
    if (!this.pending && source(name) === source(this.shows)) return false; // it is needed where it is
    if (this.goesOn(name) || one.stands(place(name))) return true;
    one.seek(place(name));
    return false;
  }

  // Draw what comes next into the hidden layer, so that a change is a change of layer only.
  prepare() {
    const name = this.pending ? this.pending.name : this.ahead && this.ahead[0];
    const back = 1 - this.front;
    if (!this.fading && this.drawn[back] !== name && this.poised(name ?? '')) this.paint(back, name);
  }

  paint(layer, name) {
    const canvas = this.layers[layer];
    const brush = canvas.getContext('2d', { alpha: false });
    const entry = this.picture(name ?? '');
    if (name && !(entry && entry.ready)) return;
    const { width, height } = canvas;
    const black = (x0, y0, x1, y1) => brush.fillRect(x0, y0, Math.max(x1 - x0, 0), Math.max(y1 - y0, 0));
    brush.fillStyle = '#000';
    const video = entry && entry.image instanceof HTMLVideoElement;
    if (!video) black(0, 0, width, height);
    if (name) {
      const { fit, x, y } = this.look(name);
      const scales = [width / entry.width, height / entry.height];
      const scale = fit === 'contain' ? Math.min(...scales) : Math.max(...scales);
      const w = entry.width * scale;
      const h = entry.height * scale;
      // The focus comes to the middle, as far as the image reaches.
      const lie = (all, long, focus) => (long <= all ? (all - long) / 2 : Math.min(Math.max(all / 2 - focus * long, all - long), 0));
      const left = lie(width, w, x);
      const top = lie(height, h, y);
      if (video) {
        // Black beside the video alone: a browser that has no image of it at this moment draws
        // nothing, and then what was there stays.
        black(0, 0, left, height);
        black(left + w, 0, width, height);
        black(0, 0, width, top);
        black(0, top + h, width, height);
      }
      brush.drawImage(entry.image, left, top, w, h);
      this.finish(brush, width, height);
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
    const goesOn = this.goesOn(next.name);
    if (goesOn) this.paint(1 - this.front, next.name); // as it is now
    else this.films.get(source(this.shows))?.hold();
    const slow = calm.matches ? CALM_FADE_S : 0;
    const mends = next.name && whole(next.name) === whole(this.shows);
    const fade = goesOn ? 0 : Math.max(this.fade, mends ? HEAL_FADE_S : slow);
    this.front = 1 - this.front;
    this.lastFlip = now;
    this.pending = null;
    if (goesOn && this.look(next.name).play === 'once') this.films.get(source(next.name)).restart();
    this.load([next.name, ...this.ahead, ...this.drawn]);
    this.run(next.name);
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
  return source(name).replace(/\.\d(\.\w+)$/, '$1');
}

function address(name) {
  return '/media/' + name.split('/').map(encodeURIComponent).join('/');
}
