// SPDX-License-Identifier: Apache-2.0
// How the picture lies on this wall: its corners dragged to those of the projection, its edges soft
// where another projector's picture overlaps. The server keeps it for each screen.

import { say, sentence } from './i18n.js';
import { plain } from './link.js';

const WHOLE = { corners: [[0, 0], [1, 0], [1, 1], [0, 1]], edges: [0, 0, 0, 0] };
const STEP_PX = 1; // of an arrow key; with Shift ten times as far

export class Pin {
  constructor(name, link, picture, card, tools) {
    this.name = name;
    this.link = link;
    this.picture = picture;
    this.card = card;
    this.tools = tools;
    this.place = structuredClone(WHOLE);
    this.handles = [...tools.querySelectorAll('[data-corner]')];
    this.edges = [...tools.querySelectorAll('input[type=range]')];
    this.words = tools.querySelector('#pin-words');
    this.handles.forEach((handle, i) => {
      handle.onpointerdown = (event) => this.grab(event, i);
      handle.onpointermove = ({ pointerId, clientX, clientY }) => {
        if (handle.hasPointerCapture(pointerId)) this.move(i, clientX + this.held[0], clientY + this.held[1]);
      };
      handle.onkeydown = (event) => this.key(event, i);
    });
    this.edges.forEach((slider, i) => (slider.oninput = () => {
      this.place.edges[i] = Number(slider.value);
      this.apply();
    }));
    tools.querySelector('#pin-reset').onclick = () => {
      this.place = structuredClone(WHOLE);
      this.apply();
    };
    tools.querySelector('#pin-form').onsubmit = (event) => {
      event.preventDefault();
      this.keep();
    };
    link.on('up', () => this.load());
    addEventListener('resize', () => this.apply());
  }

  async load() {
    try {
      const answer = await fetch(`/screen/${this.name}`);
      const kept = answer.ok ? await answer.json() : {};
      if (kept.corners && this.tools.hidden) this.place = kept;
    } catch {
      // the server is away: the picture lies where it lay
    }
    this.apply();
  }

  async keep() {
    const pin = plain(this.tools.querySelector('#pin-pin').value);
    const headers = { 'Content-Type': 'application/json', 'X-Pin': pin };
    try {
      const answer = await fetch(`/screen/${this.name}`, { method: 'POST', headers, body: JSON.stringify(this.place) });
      this.words.textContent = answer.ok ? say('done') : answer.status === 401 ? say('pin_wrong') : sentence(await answer.json());
    } catch {
      this.words.textContent = say('no_connection');
    }
  }

  toggle() {
    this.tools.hidden = !this.tools.hidden;
    document.body.classList.toggle('pinning', !this.tools.hidden);
    this.tools.querySelector('#pin-pin').parentElement.hidden = !this.link.pinNeeded;
    this.words.textContent = '';
    this.apply();
  }

  // A corner does not jump to where its handle is taken, so that it can lie at the window's very edge.
  grab(event, i) {
    const [x, y] = this.place.corners[i];
    this.held = [x * innerWidth - event.clientX, y * innerHeight - event.clientY];
    event.target.setPointerCapture(event.pointerId);
    event.target.focus();
    event.preventDefault(); // a drag selects no words
  }

  move(i, x, y) {
    const within = (v) => Math.min(Math.max(v, 0), 1);
    const before = this.place.corners[i];
    this.place.corners[i] = [within(x / innerWidth), within(y / innerHeight)];
    if (!convex(this.place.corners)) this.place.corners[i] = before;
    this.apply();
  }

  key(event, i) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!way) return;
    const far = STEP_PX * (event.shiftKey ? 10 : 1);
    const [x, y] = this.place.corners[i];
    this.move(i, x * innerWidth + far * way[0], y * innerHeight + far * way[1]);
    event.preventDefault();
  }

  apply() {
    const { corners, edges } = this.place;
    const still = JSON.stringify(this.place) === JSON.stringify(WHOLE);
    for (const { style } of [this.picture, this.card]) {
      style.transformOrigin = '0 0';
      style.transform = still ? '' : `matrix3d(${homography(innerWidth, innerHeight, corners)})`;
    }
    const share = (v) => `${100 * v}%`;
    const [left, top, right, bottom] = edges;
    const fade = (way, from, to) => `linear-gradient(to ${way}, transparent, #000 ${share(from)}, #000 ${share(1 - to)}, transparent)`;
    const hard = !edges.some(Boolean);
    this.picture.style.maskImage = hard ? '' : `${fade('right', left, right)}, ${fade('bottom', top, bottom)}`;
    this.picture.style.maskComposite = 'intersect';
    this.handles.forEach(({ style }, i) => {
      [style.left, style.top] = corners[i].map((share) => `clamp(22px, ${100 * share}%, calc(100% - 22px))`);
    });
    this.edges.forEach((slider, i) => (slider.value = edges[i]));
  }
}

function convex(corners) {
  return corners.every(([x, y], i) => {
    const [[ax, ay], [bx, by]] = [corners[(i + 3) % 4], corners[(i + 1) % 4]];
    return (x - ax) * (by - y) - (y - ay) * (bx - x) > 0.01;
  });
}

// The projective map that brings a window's corners to those given (Heckbert 1989, 2.2.3), as the 16
// numbers of CSS, column by column.
export function homography(w, h, corners) {
  const [[x0, y0], [x1, y1], [x2, y2], [x3, y3]] = corners.map(([x, y]) => [x * w, y * h]);
  const [dx1, dx2, sx] = [x1 - x2, x3 - x2, x0 - x1 + x2 - x3];
  const [dy1, dy2, sy] = [y1 - y2, y3 - y2, y0 - y1 + y2 - y3];
  const det = dx1 * dy2 - dx2 * dy1;
  const g = (sx * dy2 - dx2 * sy) / det;
  const k = (dx1 * sy - sx * dy1) / det;
  const [a, b, d, e] = [x1 - x0 + g * x1, x3 - x0 + k * x3, y1 - y0 + g * y1, y3 - y0 + k * y3];
  return [a / w, d / w, 0, g / w, b / h, e / h, 0, k / h, 0, 0, 1, 0, x0, y0, 0, 1];
}
