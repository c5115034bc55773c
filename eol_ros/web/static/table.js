// SPDX-License-Identifier: Apache-2.0
// The virtual table: push it with mouse, fingers or keys, see and hear it answer.

import { Listener } from './audio.js';
import { Hands } from './hands.js';
import { addLanguages, language, say, speak } from './i18n.js';
import { BLOCK_M, CELLS, IDS } from './lattice.js';
import { Link, readBlocks, readLeds, readTruth } from './link.js';
import { caption, Modes, part } from './modes.js';
import { HUES, TableDrawing } from './tabledraw.js';
import { write } from './paint.js';
import { land } from './terrain.js';
import { WallView } from './wallview.js';

const STALE_S = 2.5;
const IDLE_S = 60; // without a hand of this page's: it shows once more what can be done
const $ = (id) => document.getElementById(id);

await speak(language());
const link = new Link([]);
const listener = new Listener(link);
const drawing = new TableDrawing($('table'));
const hands = new Hands($('table'), link, (x, y) => drawing.toTable(x, y));
const modes = new Modes({ captions: $('captions'), quiet: $('quiet') }, $('caption'));
const walls = ['left', 'right'].map((side) => new WallView($(side), side, link, true));
const counts = { drawings: 0, slips: 0, flashes: 0, flips: 0, packets: 0, cascade: 0 };
window.eol = { link, listener, hands, drawing, counts, walls, modes, state: () => state };
let state = null;
let playing = ''; // who has the table: people, visitors that are simulated, or nobody
let leds = new Uint8Array(CELLS);
let ledsAt = 0;

place();
land(Math.min(Math.max(drawing.tile, 64), 320)).then((picture) => drawing.setLand(picture));

link.want(['truth', 'blocks', 'slips', 'leds']);

let speed = 0; // of the rim, m/s, over a fifth of a second or so
link.on('truth', (packet) => {
  const before = state;
  state = readTruth(packet);
  if (before?.rim && state.stamp > before.stamp) {
    const far = Math.hypot(state.rim[0] - before.rim[0], state.rim[1] - before.rim[1]);
    const passed = state.stamp - before.stamp;
    speed += (far / passed - speed) * (1 - Math.exp(-passed / 0.2));
  }
  hands.pose = state.rim;
  counts.packets++;
  if (counts.packets === 1) link.want(['truth', 'slips', 'leds']);
});
link.on('blocks', (packet) => {
  if (link.age('truth') < STALE_S) return; // what the twin tells is newer than what the camera saw
  const { rows } = readBlocks(packet);
  const column = (i) => Float32Array.from({ length: CELLS }, (_, id) => rows[id * 8 + i]);
  state = { x: column(0), y: column(1), yaw: column(2), moving: state ? state.moving : new Uint8Array(CELLS) };
});
link.on('slip', (slip) => {
  if (state && !state.rim) state.moving[slip.block] = slip.start ? 1 : 0;
  if (!slip.start) return;
  if (!link.asleep) drawing.paths.slip(slip.block, slip.cascade, slip.onset, performance.now());
  counts.slips++;
});
link.on('leds', (packet) => {
  const { white } = readLeds(packet);
  if (white.some((level, id) => level > leds[id] + 40)) counts.flashes++;
  leds = white;
  ledsAt = performance.now();
});
let sounds = false; // whether the node of that name is there
link.on('health', (status) => {
  if (status.node === 'sound') sounds = true;
  if (status.node === 'twin') playing = status.values.playing ?? '';
  if (status.node === 'sound' || status.node === 'twin') tell();
});
link.on('work', tell);
let greatest = null; // of today's cascades
function offer() {
  $('replay').disabled = !greatest || link.asleep;
}
link.on('work', offer);
$('replay').onclick = () => {
  const [onset, nucleus, area, , , blocks] = greatest;
  const time = new Date(onset * 1000).toLocaleTimeString(document.documentElement.lang, { timeStyle: 'short' });
  modes.replay(say('caption_replay', { time, caption: caption(area, nucleus) }), drawing.paths.replay(blocks, performance.now()));
};
let told = null; // onset of the newest cascade; those of before this page are no news
link.on('cascades', (day) => {
  const [onset, nucleus, area] = day.recent[day.recent.length - 1] ?? [0, 0, 0];
  counts.cascade = area;
  greatest = day.greatest?.[2] > 1 ? day.greatest : null;
  offer();
  const drawn = drawing.paths.cascades.filter(({ number }) => number >= 0); // NaN is of a replay
  const greater = drawn.some(({ slips }) => slips.length > area); // its caption follows
  if (told !== null && onset !== told && !link.asleep && !greater) {
    modes.cascade(area, nucleus, HUES[drawn.findLast(({ slips }) => slips[0].block === nucleus)?.hue]);
  }
  told = onset;
});
for (const wall of walls) {
  wall.onflip = () => counts.flips++;
  wall.finish = (brush, w, h) => fadeOut(brush, w, h, wall.side === 'left' ? 1 : -1);
}

// The walls have the room that the table leaves: beside it, or above it on an upright screen.
function upright() {
  return matchMedia('(max-aspect-ratio: 11/10)').matches; // as table.css asks
}
function place() {
  drawing.resize();
  const free = (upright() ? innerHeight : innerWidth) - drawing.side;
  const { style } = document.documentElement;
  style.setProperty('--free', `${Math.ceil(free / 2)}px`);
  style.setProperty('--side', `${drawing.side}px`);
  drawing.dirty = true;
}

// They are dimmed, and fade towards the table. Painted into each picture once, so that it costs
// nothing at each drawing.
function fadeOut(brush, w, h, way) {
  const shade = upright() ? brush.createLinearGradient(0, way > 0 ? h : 0, 0, way > 0 ? 0 : h)
    : way > 0 ? brush.createLinearGradient(w, 0, 0, 0) : brush.createLinearGradient(0, 0, w, 0);
  shade.addColorStop(0, 'rgba(6,8,9,1)');
  shade.addColorStop(0.3, 'rgba(6,8,9,.38)');
  shade.addColorStop(1, 'rgba(6,8,9,.38)');
  brush.fillStyle = shade;
  brush.fillRect(0, 0, w, h);
}
link.on('hello', ({ pin, push }) => ($('pin-form').hidden = !pin || push));
link.on('trust', ({ push }) => ($('pin-form').hidden = push));
$('pin-form').onsubmit = async (event) => {
  event.preventDefault();
  write($('pin-answer'), await link.enter($('pin').value));
  $('pin').value = '';
};

$('listen').onclick = async () => {
  if (listener.on) await listener.stop();
  else await listener.start();
  tell();
};
// Why nothing is heard, in words; empty where it is. A sound card of the room is not needed here.
function silence() {
  if (!link.viewer) return '';
  if (listener.hindrance) return say(listener.hindrance);
  if (!['awake', 'no_sound_card', 'test', ''].includes(link.work.code)) return link.workWords(false);
  if (!sounds) return link.age('hello') > 2 * STALE_S ? say('sound_none') : '';
  return listener.on && listener.context.state !== 'running' ? say('sound_blocked') : '';
}
const fingers = matchMedia('(hover: none) and (pointer: coarse)'); // and neither mouse nor keys

// The block under the pointer, for who hears the page.
$('table').addEventListener('pointermove', ({ clientX, clientY }) => {
  if (!state || hands.holding) return;
  const [x, y] = drawing.toTable(clientX, clientY);
  const id = IDS.find((i) => Math.max(Math.abs(state.x[i] - x), Math.abs(state.y[i] - y)) < 0.54 * BLOCK_M) ?? -1;
  const moves = id >= 0 && state.moving[id];
  write($('under'), id < 0 ? '' : say('under_words', { block: id, where: say(`where_${part(id)}`), state: say(moves ? 'slipping' : 'at_rest') }));
});
addLanguages($('languages'), tell);

function tell() {
  const stale = link.age() > STALE_S;
  $('words').classList.toggle('stale', stale);
  const words = stale
    ? link.workWords(stale)
    : !link.viewer || performance.now() < 1000 * STALE_S ? ''
      : !link.mayPush ? say('table_locked')
        : link.age('truth') > STALE_S ? (link.work.code === 'starting' ? ''
          : !playing ? say('table_none') // no twin has been heard
            : state?.rim ? say('no_data', { seconds: link.age('truth').toFixed(0) }) : say('no_data_yet'))
          : counts.cascade && !modes.captions && !link.asleep ? say('table_cascade', { area: counts.cascade }) : '';
  write($('words'), words);
  if (hands.holding) playing = 'people'; // the twin says so a moment later
  $('work').hidden = stale || !link.work.code;
  write($('work'), link.workWords(stale));
  const alone = playing === 'visitors' && link.work.code === 'awake' && !stale && link.age('truth') < STALE_S;
  $('alone').hidden = !alone;
  $('table').classList.toggle('locked', Boolean(link.viewer) && !link.mayPush);
  if (alone) write($('alone'), `${say('table_alone')} ${link.mayPush ? say('table_touch') : ''}`);
  const limit = state?.rim && !stale ? hands.limit(state, speed) : '';
  $('limit').hidden = !limit;
  if (limit) write($('limit'), say(limit));
  const lonely = performance.now() - hands.heldAt > 1000 * IDLE_S;
  drawing.hint = lonely && !link.asleep && link.mayPush && !stale && Boolean(state?.rim) && link.age('truth') < STALE_S;
  $('invite').hidden = !drawing.hint;
  const touch = fingers.matches;
  if (drawing.hint) write($('invite'), say(touch ? 'invite_touch' : 'invite'));
  write($('help'), !link.mayPush || !state?.rim ? '' : say(touch ? 'table_help_touch' : 'table_help'));
  modes.show();
  const why = stale ? '' : silence();
  $('listen').disabled = Boolean(listener.hindrance) && !listener.on;
  $('listen').setAttribute('aria-pressed', listener.on);
  write($('listen'), !listener.on ? say($('listen').disabled ? 'table_sound_off' : 'table_sound_on')
    : listener.latency === null || why ? say('table_sound_is_on') : say('table_sound', { latency: Math.round(listener.latency * 1000) }));
  write($('sound-why'), listener.on || $('listen').disabled || why === say('sound_none') ? why : '');
  $('table').style.filter = stale ? 'grayscale(1) brightness(.5)' : '';
}
setInterval(tell, 250);
tell();

const DARK = new Uint8Array(CELLS);
let drawn = [null, null];
function draw(now) {
  requestAnimationFrame(draw);
  const light = now - ledsAt < 1000 ? leds : DARK;
  drawing.pulls = hands.pulls;
  if (!drawing.alive && !drawing.hintDue(now) && !stirred(...drawn, state, light)) return;
  drawing.draw(now, state, light);
  drawn = [state, light];
  counts.drawings++;
}
requestAnimationFrame(draw);
addEventListener('resize', place);

// Whether anything has gone by a tenth of a pixel, or shines otherwise.
function stirred(before, lightBefore, now, light) {
  if (before === now && lightBefore === light) return false;
  if (!before || !now || light.some((level, id) => level !== lightBefore[id])) return true;
  const far = 0.1 / drawing.perM;
  const apart = (a, b, scale = 1, which = IDS) => which.some((i) => !(Math.abs(a[i] - b[i]) * scale < far));
  return apart(now.x, before.x) || apart(now.y, before.y) || apart(now.yaw, before.yaw, 0.7 * BLOCK_M)
    || now.moving.some((moves, id) => moves !== before.moving[id])
    || Boolean(now.rim && apart(now.rim, before.rim ?? [NaN], 1, [0, 1, 2]));
}
