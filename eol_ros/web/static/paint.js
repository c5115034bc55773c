// SPDX-License-Identifier: Apache-2.0
// Colours and small helps that every drawing shares.

export const INK = '#e8e2d5';
export const QUIET = '#a3aba9';
export const EDGE = '#2a333b';
export const THREAD = '#f0c64a';
export const MOVE = '#ff8a5c';
export const WATER = '#7fd1c7';

// Whether flashes, waves and quick changes are unwelcome: the system says so, or a person on the page.
const reduced = matchMedia('(prefers-reduced-motion: reduce)');
export const calm = {
  quiet: false,
  get matches() {
    return this.quiet || reduced.matches;
  },
};

// Sizes are told by the browser when they change: asking for them at each drawing would make it lay
// the page out again each time.
const boxes = new WeakMap();
const watch = new ResizeObserver((entries) => {
  for (const { target, contentRect: { width, height } } of entries) boxes.set(target, [width, height]);
  document.dispatchEvent(new Event('fitted'));
});

// Fit a canvas to its box in device pixels and empty it; returns its brush, scaled to CSS pixels, and
// its size. A canvas with a ground is opaque, which spares the screen a blending.
export function fit(canvas, ground = '') {
  if (!boxes.has(canvas)) {
    boxes.set(canvas, [canvas.clientWidth, canvas.clientHeight]);
    watch.observe(canvas);
  }
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [w, h] = boxes.get(canvas);
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const brush = canvas.getContext('2d', { alpha: !ground });
  brush.setTransform(ratio, 0, 0, ratio, 0, 0);
  brush.fillStyle = ground;
  if (ground) brush.fillRect(0, 0, w, h);
  else brush.clearRect(0, 0, w, h);
  return { brush, w, h };
}

let rootPx = 0;
addEventListener('resize', () => (rootPx = 0));
export function fontPx(scale = 0.8) {
  rootPx ||= parseFloat(getComputedStyle(document.documentElement).fontSize);
  return rootPx * scale;
}

// Write a text only where it is another one.
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// A colour scale from deep water over bone to ember; t in 0..1.
const STOPS = [[52, 92, 110], [116, 178, 172], [226, 218, 196], [240, 190, 96], [255, 122, 84]];
export function scale(t) {
  const at = Math.min(Math.max(t, 0), 1) * (STOPS.length - 1);
  const i = Math.min(Math.floor(at), STOPS.length - 2);
  const mix = STOPS[i].map((c, k) => Math.round(c + (STOPS[i + 1][k] - c) * (at - i)));
  return `rgb(${mix.join(',')})`;
}
