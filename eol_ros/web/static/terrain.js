// SPDX-License-Identifier: Apache-2.0
// The landscape of the covers as a picture: the same heights that `assets.covers` prints.

import { COLUMNS, ROWS } from './lattice.js';

const SQUARES = 32; // of heights along a cover
const [WIDE, DEEP] = [COLUMNS * SQUARES + 1, ROWS * SQUARES + 1];
const CONTOURS = 16;

// Fetches the heights and answers a canvas of the whole land, a cover of `tile` pixels for each place,
// the far edge on top.
export async function land(tile) {
  const heights = new Uint16Array(await (await fetch('/terrain')).arrayBuffer());
  const [w, h] = [tile * COLUMNS, tile * ROWS];
  const canvas = new OffscreenCanvas(w, h);
  const brush = canvas.getContext('2d');
  const picture = brush.createImageData(w, h);
  const height = (x, y) => {
    const [gx, gy] = [Math.min((x / w) * (WIDE - 1), WIDE - 1.001), Math.min((y / h) * (DEEP - 1), DEEP - 1.001)];
    const [i, j] = [Math.floor(gx), Math.floor(gy)];
    const [fx, fy] = [gx - i, gy - j];
    const at = j * WIDE + i;
    const low = heights[at] * (1 - fx) + heights[at + 1] * fx;
    const high = heights[at + WIDE] * (1 - fx) + heights[at + WIDE + 1] * fx;
    return (low * (1 - fy) + high * fy) / 65535;
  };
  const map = new Float32Array((w + 1) * (h + 1));
  for (let y = 0; y <= h; y++) for (let x = 0; x <= w; x++) map[y * (w + 1) + x] = height(x, y);
  const relief = tile * 0.42;
  for (let y = 0; y < h; y++) {
    for (let x = 0; x < w; x++) {
      const at = y * (w + 1) + x;
      const here = map[at];
      const [dx, dy] = [(map[at + 1] - here) * relief, (map[at + w + 1] - here) * relief];
      const light = (0.9 + 0.62 * (dx * 0.75 - dy * 0.55)) / Math.hypot(1, dx, dy);
      let colour = shade(here);
      let bright = here > 0 ? light : 1;
      if (here > 0 && Math.floor(here * CONTOURS) !== Math.floor(map[at + 1] * CONTOURS)) bright *= 0.8;
      else if (here > 0 && Math.floor(here * CONTOURS) !== Math.floor(map[at + w + 1] * CONTOURS)) bright *= 0.8;
      const out = 4 * ((h - 1 - y) * w + x);
      for (let k = 0; k < 3; k++) picture.data[out + k] = colour[k] * bright;
      picture.data[out + 3] = 255;
    }
  }
  brush.putImageData(picture, 0, 0);
  return canvas;
}

const TINTS = [[0, [30, 74, 88]], [0.001, [92, 108, 94]], [0.3, [150, 146, 120]], [0.6, [196, 184, 156]], [1, [250, 244, 230]]];

function shade(h) {
  let i = 1;
  while (i < TINTS.length - 1 && TINTS[i][0] < h) i++;
  const [[h0, a], [h1, b]] = [TINTS[i - 1], TINTS[i]];
  const t = Math.min(Math.max((h - h0) / (h1 - h0), 0), 1);
  return a.map((c, k) => c + (b[k] - c) * t);
}
