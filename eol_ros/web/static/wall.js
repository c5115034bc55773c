// SPDX-License-Identifier: Apache-2.0
// A wall of the room. Never an error text: on a lost connection the last pair stays, and after a
// minute it fades to black.

import { language, say, speak } from './i18n.js';
import { Link } from './link.js';
import { Pin } from './pin.js';
import { WallView } from './wallview.js';

const LOST_S = Number(new URLSearchParams(location.search).get('lost')) || 60; // ?lost=5 to try it
const side = location.pathname.endsWith('right') ? 'right' : 'left';
// Which projector this is, for its name on the test card and the corners that are kept for it.
const screenName = /^[a-z0-9-]{1,40}$/.exec(new URLSearchParams(location.search).get('screen') ?? '')?.[0] ?? side;
const wall = document.getElementById('wall');
const caption = document.getElementById('caption');
const card = document.getElementById('card');
const keys = document.getElementById('keys');

const link = new Link([]);
const view = new WallView(wall, side, link);
const pin = new Pin(screenName, link, wall, card, document.getElementById('pins'));

const flips = []; // [change, time of the image in which it was shown, ms since the epoch]
window.eol = { link, view, flips, pin };
speak(language());

view.onflip = (next, now) => {
  flips.push([next.change, performance.timeOrigin + now]);
  if (flips.length > 500) flips.shift();
  link.send({ flipped: [side, next.change, link.now() * 1000] });
  const { caption: words, caption_zh: chinese, credit } = view.current;
  for (const [part, text] of [['words', words], ['chinese', chinese], ['credit', credit]]) {
    document.getElementById(part).textContent = text ?? '';
  }
  wall.dataset.change = next.change;
  wall.dataset.picture = next.name;
};

setInterval(() => wall.classList.toggle('lost', link.age() > LOST_S && performance.now() > LOST_S * 1000), 500);

function testCard(on) {
  card.hidden = !on;
  if (on) {
    drawCard();
    requestAnimationFrame(flash);
  }
}
// The state of the work is in the title and among the keys; on the wall itself only a test shows.
let testing = false;
function tellWork() {
  const words = link.workWords(link.age() > LOST_S);
  document.title = `${say(`${side}_wall`)}: ${words}`;
  document.getElementById('work').textContent = words;
  const tests = link.work.code === 'test' && link.age() < LOST_S;
  if (tests !== testing) testCard((testing = tests));
}
link.on('work', tellWork);
setInterval(tellWork, 1000);

// A tenth of a second of each, on the server's clock: a camera before both walls sees them apart.
const FLASH_S = 0.1;
const sync = document.getElementById('sync');
function flash() {
  sync.hidden = card.hidden || link.now() % 1 > FLASH_S;
  if (!card.hidden) requestAnimationFrame(flash);
}

const OVERSCAN = [0.025, 0.05]; // of the width and the height, on each side
const GREYS = 16;

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
  brush.font = `400 ${h / 54}px system-ui, sans-serif`;
  brush.textAlign = 'left';
  brush.textBaseline = 'middle';
  for (const share of OVERSCAN) {
    brush.lineWidth = line;
    brush.strokeRect(share * w, share * h, (1 - 2 * share) * w, (1 - 2 * share) * h);
    brush.fillStyle = '#101418'; // words on a line of their own mark, and clear of the diagonals
    brush.fillRect(w / 4 - h / 100, (1 - share) * h - h / 90, h / 12, h / 45);
    brush.fillStyle = '#e8e2d5';
    brush.fillText(`${100 * share} %`, w / 4, (1 - share) * h);
  }
  for (let i = 0; i < GREYS; i++) { // the darkest and the lightest steps must be told apart
    const grey = Math.round((255 * i) / (GREYS - 1));
    brush.fillStyle = `rgb(${grey},${grey},${grey})`;
    brush.fillRect(w * (0.1 + (0.8 * i) / GREYS), 0.78 * h, (0.8 * w) / GREYS + 1, 0.08 * h);
  }
  const word = side.toUpperCase();
  brush.textAlign = 'center';
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
  brush.font = `400 ${Math.min(h / 32, w / 20)}px system-ui, sans-serif`;
  brush.fillText(`${screenName}  ${w} x ${h}  ${link.workWords(false)}`, w / 2, h * 0.91);
}

// The greatest cascade of today, slowly, on a table at rest in place of the pictures.
let greatest = [];
link.on('cascades', (day) => (greatest = day.greatest));
async function replay() {
  const box = document.getElementById('replay');
  const blocks = greatest[5] ?? [];
  if (!box.hidden || blocks.length < 2) return;
  box.hidden = false;
  const [{ REST, TableDrawing }, { land }] = await Promise.all([import('./tabledraw.js'), import('./terrain.js')]);
  const drawing = (window.eol.replay = new TableDrawing(box.firstChild));
  drawing.resize();
  land(drawing.tile).then((picture) => drawing.setLand(picture), () => {});
  drawing.paths.replay(blocks, performance.now());
  const draw = (now) => {
    drawing.draw(now, REST, REST.moving);
    box.hidden = !drawing.paths.cascades.length;
    if (!box.hidden) requestAnimationFrame(draw);
  };
  requestAnimationFrame(draw);
}

addEventListener('resize', () => card.hidden || drawCard());
addEventListener('keydown', (event) => {
  if (event.target.tagName === 'INPUT') return;
  if (event.key === 'k') pin.toggle();
  if (event.key === 'g') replay();
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
