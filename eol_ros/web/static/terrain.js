// SPDX-License-Identifier: Apache-2.0
// The landscape of the covers as a picture: the same heights that `eol covers` prints.

const CELLS = 32;
const SIZE = 5 * CELLS + 1;
const CONTOURS = 16;

// Fetches the heights and answers a canvas of the whole land, 5 x 5 covers of `tile` pixels each, the
// far edge on top.
export async function land(tile) {
  const heights = new Uint16Array(await (await fetch('/terrain')).arrayBuffer());
  const side = tile * 5;
  const canvas = new OffscreenCanvas(side, side);
  const brush = canvas.getContext('2d');
  const picture = brush.createImageData(side, side);
  const height = (x, y) => {
    const [gx, gy] = [Math.min((x / side) * (SIZE - 1), SIZE - 1.001), Math.min((y / side) * (SIZE - 1), SIZE - 1.001)];
    const [i, j] = [Math.floor(gx), Math.floor(gy)];
    const [fx, fy] = [gx - i, gy - j];
    const at = j * SIZE + i;
    const low = heights[at] * (1 - fx) + heights[at + 1] * fx;
    const high = heights[at + SIZE] * (1 - fx) + heights[at + SIZE + 1] * fx;
    return (low * (1 - fy) + high * fy) / 65535;
  };
  const map = new Float32Array((side + 1) * (side + 1));
  for (let y = 0; y <= side; y++) for (let x = 0; x <= side; x++) map[y * (side + 1) + x] = height(x, y);
  const relief = tile * 0.42;
  for (let y = 0; y < side; y++) {
    for (let x = 0; x < side; x++) {
      const at = y * (side + 1) + x;
      const h = map[at];
      const [dx, dy] = [(map[at + 1] - h) * relief, (map[at + side + 1] - h) * relief];
      const light = (0.9 + 0.62 * (dx * 0.75 - dy * 0.55)) / Math.hypot(1, dx, dy);
      let colour = shade(h);
      let bright = h > 0 ? light : 1;
      if (h > 0 && Math.floor(h * CONTOURS) !== Math.floor(map[at + 1] * CONTOURS)) bright *= 0.8;
      else if (h > 0 && Math.floor(h * CONTOURS) !== Math.floor(map[at + side + 1] * CONTOURS)) bright *= 0.8;
      const out = 4 * ((side - 1 - y) * side + x);
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
