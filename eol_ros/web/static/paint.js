// SPDX-License-Identifier: Apache-2.0
// Colours and small helps that every drawing shares.

export const INK = '#e8e2d5';
export const QUIET = '#a3aba9';
export const EDGE = '#2a333b';
export const THREAD = '#f0c64a';
export const MOVE = '#ff8a5c';
export const WATER = '#7fd1c7';
export const GROUND = '#0b0d10';

export const calm = matchMedia('(prefers-reduced-motion: reduce)');

// Fit a canvas to its box in device pixels; returns its brush, scaled to CSS pixels, and its size.
export function fit(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const w = canvas.clientWidth;
  const h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const brush = canvas.getContext('2d');
  brush.setTransform(ratio, 0, 0, ratio, 0, 0);
  brush.clearRect(0, 0, w, h);
  return { brush, w, h };
}

export function fontPx(scale = 0.8) {
  return parseFloat(getComputedStyle(document.documentElement).fontSize) * scale;
}

// A colour scale from deep water over bone to ember; t in 0..1.
const STOPS = [[52, 92, 110], [116, 178, 172], [226, 218, 196], [240, 190, 96], [255, 122, 84]];
export function scale(t) {
  const at = Math.min(Math.max(t, 0), 1) * (STOPS.length - 1);
  const i = Math.min(Math.floor(at), STOPS.length - 2);
  const mix = STOPS[i].map((c, k) => Math.round(c + (STOPS[i + 1][k] - c) * (at - i)));
  return `rgb(${mix.join(',')})`;
}
