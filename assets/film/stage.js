// SPDX-License-Identifier: Apache-2.0
// Four pages in one picture. The film gives them what the graph has told, image by image.

// Address, the part of the page that is shown (left, top, width, height), and where its corners come
// to lie: far left, far right, near right, near left.
const pages = {
  left: ['/wall/left', [0, 0, 800, 500], [[-6, -34], [480, 34], [480, 286], [-6, 350]]],
  right: ['/wall/right', [0, 0, 800, 500], [[480, 34], [966, -34], [966, 350], [480, 286]]],
  table: ['/table', [150, 0, 600, 600], [[146, 296], [464, 296], [580, 596], [30, 596]]],
  panel: ['/', [0, 0, 1120, 700], [[592, 372], [944, 372], [944, 592], [592, 592]]],
};
const start = new URLSearchParams(location.search).get('start');
const frames = Object.fromEntries(Object.entries(pages).map(([name, [path, part, corners]]) => {
  const frame = document.getElementById(name);
  const [left, top, width, height] = part;
  frame.style.width = `${width + 2 * left}px`;
  frame.style.height = `${height + 2 * top}px`;
  frame.style.clipPath = left || top ? `inset(${top}px ${left}px)` : '';
  frame.style.transform = projection(part, corners);
  frame.src = `${path}?start=${start}`;
  return [name, frame];
}));

// The projective map of a rectangle to four corners (Heckbert, Fundamentals of Texture Mapping, 1989).
function projection([left, top, width, height], [[x0, y0], [x1, y1], [x2, y2], [x3, y3]]) {
  const [dx1, dx2, dx3] = [x1 - x2, x3 - x2, x0 - x1 + x2 - x3];
  const [dy1, dy2, dy3] = [y1 - y2, y3 - y2, y0 - y1 + y2 - y3];
  const det = dx1 * dy2 - dx2 * dy1;
  const [g, h] = [(dx3 * dy2 - dx2 * dy3) / det, (dx1 * dy3 - dx3 * dy1) / det];
  const [a, b, d, e] = [x1 - x0 + g * x1, x3 - x0 + h * x3, y1 - y0 + g * y1, y3 - y0 + h * y3];
  return `matrix3d(${a},${d},0,${g},${b},${e},0,${h},0,0,1,0,${x0},${y0},0,1) scale(${1 / width},${1 / height}) translate(${-left}px,${-top}px)`;
}
const arms = document.getElementById('arms');
arms.style.transform = projection([0, 0, 600, 600], pages.table[2]);
const windows = () => Object.values(frames).map((frame) => frame.contentWindow);
const tick = () => new Promise((done) => setTimeout(done, 5));

function payload([text, packed]) {
  if (text) return text;
  return Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)).buffer;
}

// Tell all pages [[ms, text, base64], ...] in its order, then draw them as of `to` ms.
window.show = async (told, to, fingers) => {
  for (const page of windows()) while (!page.eol?.link) await tick();
  for (const [at, ...packet] of told) {
    const data = payload(packet);
    for (const page of windows()) {
      page.film.advance(at);
      page.eol.link.take(typeof data === 'string' ? data : data.slice(0));
    }
  }
  await Promise.all(windows().map((page) => page.film.settled()));
  const { hands } = frames.table.contentWindow.eol;
  hands.heldAt = to; // nobody has to be shown what can be done
  hands.fingers = new Map(fingers.map((finger, i) => [i, finger]));
  for (const page of windows()) {
    page.film.advance(to);
    page.film.draw();
  }
  document.getElementById('hands').replaceChildren(...hands.pulls.map(arm));
};

// An arm that reaches in from outside to where a hand is; y points away from the viewer.
function arm({ to: [x, y] }) {
  const use = document.createElementNS(arms.namespaceURI, 'use');
  use.setAttribute('href', '#arm');
  use.setAttribute('transform', `translate(${x} ${-y}) rotate(${(Math.atan2(-y, x) * 180) / Math.PI})`);
  return use;
}
