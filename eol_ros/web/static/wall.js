// SPDX-License-Identifier: Apache-2.0
// A wall of the room. Never an error text: on a lost connection the last pair stays, and after a
// minute it fades to black.

import { Link } from './link.js';
import { WallView } from './wallview.js';

const LOST_S = Number(new URLSearchParams(location.search).get('lost')) || 60; // ?lost=5 to try it
const side = location.pathname.endsWith('right') ? 'right' : 'left';
const wall = document.getElementById('wall');
const caption = document.getElementById('caption');
const card = document.getElementById('card');
const keys = document.getElementById('keys');

const link = new Link([]);
const view = new WallView(wall, side, link);
document.title = `${side === 'left' ? 'Left' : 'Right'} wall`;

const flips = []; // [change, time of the image in which it was shown, ms since the epoch]
window.eol = { link, view, flips };

view.onflip = (next, now) => {
  flips.push([next.change, performance.timeOrigin + now]);
  if (flips.length > 500) flips.shift();
  link.send({ flipped: [side, next.change, link.now() * 1000] });
  const { caption: words, credit } = view.current;
  caption.textContent = [words, credit].filter(Boolean).join('  \u00b7  ');
  wall.dataset.change = next.change;
  wall.dataset.picture = next.name;
};

setInterval(() => wall.classList.toggle('lost', link.age() > LOST_S && performance.now() > LOST_S * 1000), 500);

let cardTimer = 0;
function testCard(on, forMs = 0) {
  clearTimeout(cardTimer);
  card.hidden = !on;
  if (on) drawCard();
  if (on && forMs) cardTimer = setTimeout(() => testCard(false), forMs);
}
link.on('test', () => testCard(true, 20000));

function drawCard() {
  const ratio = window.devicePixelRatio || 1;
  const w = (card.width = Math.round(innerWidth * ratio));
  const h = (card.height = Math.round(innerHeight * ratio));
  const brush = card.getContext('2d');
  const line = Math.max(Math.round(h / 540), 1);
  brush.fillStyle = '#101418';
  brush.fillRect(0, 0, w, h);
  brush.strokeStyle = '#4a5661';
  brush.lineWidth = line;
  const step = h / 12;
  brush.beginPath();
  for (let x = w / 2 % step; x <= w; x += step) brush.rect(x, 0, 0, h);
  for (let y = 0; y <= h; y += step) brush.rect(0, y, w, 0);
  brush.stroke();
  brush.strokeStyle = '#e8e2d5';
  brush.lineWidth = 2 * line;
  brush.strokeRect(line, line, w - 2 * line, h - 2 * line);
  for (const r of [0.46, 0.12]) {
    brush.beginPath();
    brush.arc(w / 2, h / 2, r * h, 0, 2 * Math.PI);
    brush.stroke();
  }
  brush.beginPath();
  for (const [x, y] of [[0, 0], [w, 0], [0, h], [w, h]]) {
    brush.moveTo(x, y);
    brush.lineTo(w / 2, h / 2);
  }
  brush.stroke();
  const word = side.toUpperCase();
  brush.textAlign = 'center';
  brush.textBaseline = 'middle';
  let size = h * 0.62;
  brush.font = `700 ${size}px system-ui, sans-serif`;
  size *= Math.min((0.92 * w) / brush.measureText(word).width, 1);
  brush.font = `700 ${size}px system-ui, sans-serif`;
  brush.lineWidth = 6 * line;
  brush.strokeStyle = '#101418';
  brush.strokeText(word, w / 2, h / 2);
  brush.fillStyle = side === 'left' ? '#f0c64a' : '#7fd1c7';
  brush.fillText(word, w / 2, h / 2);
  brush.fillStyle = '#e8e2d5';
  brush.font = `400 ${h / 32}px system-ui, sans-serif`;
  brush.fillText(`${w} x ${h}`, w / 2, h * 0.93);
}

addEventListener('resize', () => card.hidden || drawCard());
addEventListener('keydown', (event) => {
  if (event.key === 't') testCard(card.hidden);
  if (event.key === 'c') caption.hidden = !caption.hidden;
  if (event.key === '?') keys.hidden = !keys.hidden;
  if (event.key === 'f') {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen().catch(() => {});
  }
});

const stayAwake = () => navigator.wakeLock && navigator.wakeLock.request('screen').catch(() => {});
stayAwake();
document.addEventListener('visibilitychange', stayAwake);
