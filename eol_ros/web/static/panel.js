// SPDX-License-Identifier: Apache-2.0
// The monitor: wires the live connection to the views, and requests of people to the routes.

import { Listener } from './audio.js';
import { CameraView } from './camera.js';
import { CascadeView } from './cascades.js';
import { Desk, LOOK_MS, SILENT_S, STALE_S } from './desk.js';
import { addLanguages, language, say, speak } from './i18n.js';
import { InstrumentView } from './instrument.js';
import { CELLS, COUNT, IDS } from './lattice.js';
import { Link, readBlocks } from './link.js';
import { CoordinateList, LightField } from './lists.js';
import { write } from './paint.js';
import { SoundView } from './soundview.js';
import { SpaceView } from './space.js';

const PACE_S = 0.033; // eyes that read figures need no more; a slip comes at once
const STIR_M = 0.0004; // a fifth of a pixel of the camera
const $ = (id) => document.getElementById(id);

await speak(language());
const link = new Link([], PACE_S);
window.eol = { link, staleAfter: STALE_S + LOOK_MS / 1000 }; // for tests and the curious
const moving = new Uint8Array(CELLS);
const drawn = { slips: [], starts: 0, latencies: [] }; // stamps not drawn yet; s from stamp to screen
window.eol.drawn = drawn;

const camera = (window.eol.camera = new CameraView($('camera')));
const space = (window.eol.space = new SpaceView($('space'), act));
const sound = new SoundView($('sound'));
const instrument = new InstrumentView($('instrument'), $('instrument-open'), act, (...what) => space.askDrawing(...what));
const cascades = new CascadeView($('cascades'));
const coordinates = new CoordinateList($('coords'));
const lights = new LightField($('lights'));
const desk = new Desk(link, learn, lock);
const { nodes } = desk;
Object.assign(window.eol, { nodes, views: { sound, cascades, lights } });
const listener = new Listener(link);
window.eol.listener = listener;

function wants() {
  const channels = ['blocks', 'slips', 'triggers', 'meter', 'leds'];
  if (camera.view !== 'off') channels.push('image');
  link.want(channels);
}
camera.onview = wants;
wants();

link.on('blocks', (packet) => {
  const blocks = readBlocks(packet);
  camera.blocks(blocks, moving);
  space.blocks(blocks, moving);
  if (stirred(blocks.rows)) camera.dirty = space.dirty = true;
  coordinates.take(blocks, moving);
  sayCamera(blocks);
});
function sayCamera(blocks) {
  if (!blocks) return;
  const seen = blocks.rows.filter((value, i) => i % 8 === 7 && value).length;
  write($('camera-state'), say('camera_words', { seen, all: COUNT, state: say(`tracker_${blocks.state}`) }));
}
// Whether a block has gone far enough to be redrawn, or has been lost or found.
let shown = new Float32Array(8 * CELLS);
function stirred(rows) {
  for (const at of IDS.map((id) => 8 * id)) {
    const far = Math.max(Math.abs(rows[at] - shown[at]), Math.abs(rows[at + 1] - shown[at + 1]), Math.abs(rows[at + 2] - shown[at + 2]) * 0.06);
    if (!(far < STIR_M) || rows[at + 7] !== shown[at + 7]) {
      shown = rows.slice();
      return true;
    }
  }
  return false;
}
link.on('slip', (slip) => {
  moving[slip.block] = slip.start ? 1 : 0;
  camera.dirty = space.dirty = true;
  if (slip.start) drawn.slips.push(slip.stamp);
  ask();
});
link.on('up', () => moving.fill(0));
link.on('image', (packet) => camera.take(packet));
link.on('camera', (size) => Object.assign(camera.size, size));
link.on('meter', (packet) => sound.take(packet));
link.on('leds', (packet) => lights.take(packet));
link.on('trigger', ({ grain }) => space.hit(grain));
link.on('cascades', (day) => cascades.take(day));
// Values of a node: all of its state, or those that a request has just set.
function learn(node, values) {
  if (['grains', 'sound'].includes(node)) instrument.take(node, values);
  if (node === 'grains') {
    showReach(values.radius);
    space.showBlend(values.blend);
  }
}
link.on('health', (status) => {
  if (status.node === 'grains') {
    space.setFolders(status.values.folders ?? []);
    space.setPaths(status.values.paths ?? []);
  }
  if (status.node === 'twin' && status.values.hands) {
    $('ghosts').hidden = false;
  }
});
function nameCorpus() {
  const { corpus } = space;
  if (corpus) write($('corpus-name'), say('corpus_words', { name: corpus.name, count: corpus.x.length }));
}
link.on('corpus', async () => {
  const answer = await fetch('/corpus');
  if (!answer.ok) return;
  const corpus = await answer.json();
  space.setCorpus(corpus);
  instrument.setCorpus(corpus);
  nameCorpus();
});
// The slider is logarithmic over the range that the setting has.
let [least, most] = [0.001, 1];
const sliderReach = () => least * (most / least) ** $('radius').value;
function sayReach(metres) {
  const words = `${Number((metres * 1000).toPrecision(2))} mm`;
  $('radius').nextElementSibling.value = words;
  $('radius').setAttribute('aria-valuetext', words);
}
function showReach(metres) {
  if (!(metres > 0) || metres === space.reach) return; // the same: a hand may be on the slider
  $('radius').value = Math.log(metres / least) / Math.log(most / least);
  sayReach(metres);
  space.setReach(metres);
}
link.on('limits', ({ radius, network }) => {
  [least, most] = radius;
  $('open-network').hidden = network !== 'lan';
});
let viewers = 0; // of this and the other pages
const sayViewers = () => viewers && write($('visitors'), say('visitors', { count: viewers }));
link.on('tick', (tick) => {
  ({ viewers } = tick);
  sayViewers();
});
// What people ask for

function lock(locked) {
  for (const element of document.querySelectorAll('#radius, #blend, #axis-x, #axis-y, #hover')) element.disabled = locked;
  space.lock(locked);
  instrument.lock(locked);
}

async function act(name, body) {
  const answer = await desk.act(name, body);
  if (answer.error && ['move', 'axes', 'restore'].includes(name)) link.emit('corpus'); // show what really is
  return answer;
}

$('radius').oninput = () => sayReach(sliderReach());
$('radius').onchange = () => act('radius', { value: Number(sliderReach().toPrecision(2)) });
$('listen').onclick = async () => {
  if (listener.on) await listener.stop();
  else if (listener.hindrance) desk.tell(() => say(listener.hindrance), true);
  else await listener.start();
  $('listen').setAttribute('aria-pressed', listener.on);
};
function retell() {
  if (space.corpus) space.setCorpus(space.corpus);
  redraw();
  nodes.draw();
  coordinates.retell();
  instrument.retell();
  desk.retell();
  sayCamera(camera.past.at(-1)?.blocks);
  sayViewers();
  nameCorpus();
  desk.sayAnswer();
}

addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT/.test(event.target.tagName)) return;
  const views = { s: 'source', n: 'off' };
  if (views[event.key]) camera.show(views[event.key]);
  if (event.key === 'o') camera.toggleOutlines();
  if (event.key === 'l') $('listen').click();
  if (event.key === 'm') {
    const muted = document.querySelector('[data-control=mute]').getAttribute('aria-pressed') === 'true';
    desk.act(muted ? 'unmute' : 'mute');
  }
});

// Silence must be seen

const STREAMS = { camera: ['image', 'blocks'], coords: ['blocks'], sound: ['meter'] };
// Where data come only when something happens, the node that gives them must still be heard once a second.
const SOURCES = { camera: ['tracker'], coords: ['tracker', 'motion'], space: ['grains'], sound: ['sound'], cascades: ['motion'], lights: ['leds'] };
setInterval(() => {
  const stale = desk.look();
  for (const card of document.querySelectorAll('.card')) {
    const kinds = (STREAMS[card.id] || []).filter((kind) => kind !== 'image' || camera.view !== 'off');
    const ages = kinds.map((kind) => link.age(kind));
    const silent = Math.max(0, ...(SOURCES[card.id] || []).map((node) => nodes.age(node)));
    const oldest = Math.max(silent, ...ages);
    const old = (Math.max(0, ...ages) > STALE_S && performance.now() > 4000) || silent > SILENT_S;
    card.classList.toggle('old', old);
    card.dataset.old = Number.isFinite(oldest) && oldest > 0 ? say('no_data', { seconds: oldest.toFixed(0) }) : say('no_data_yet');
    if (card.id === 'camera' && link.private.includes('image')) card.dataset.old = say('private_image');
    if (stale && !old) card.dataset.old = $('stalebar').textContent;
  }
  if (nodes.age('motion') > SILENT_S) moving.fill(0); // whether they move is no longer known
  if (listener.on && listener.latency !== null) {
    $('listen').textContent = say('listening', { latency: Math.round(listener.latency * 1000) });
  } else $('listen').textContent = say('listen');
}, LOOK_MS);

// Drawing: when something has changed, at most every PACE_S; a slip with the next image of the screen.

const views = [camera, space, sound, cascades, lights];
setInterval(() => views.some((view) => view.dirty) && ask(), 1000 * PACE_S);

let drawing = false;
function ask() {
  if (!drawing) requestAnimationFrame(draw);
  drawing = true;
}

const painted = new MessageChannel(); // its messages come when the screen has been painted
painted.port1.onmessage = ({ data }) => {
  drawn.starts += data.length;
  drawn.latencies.push(...data.map((stamp) => link.now() - stamp));
  drawn.latencies.splice(0, drawn.latencies.length - 4000);
};

function draw(now) {
  drawing = false;
  for (const view of views) view.draw(now);
  if (drawn.slips.length) painted.port2.postMessage(drawn.slips.splice(0));
}

function redraw() {
  for (const view of [camera, space, cascades, lights]) view.dirty = true;
  sound.dirty = Boolean(sound.meter);
}
document.addEventListener('fitted', redraw);
addLanguages($('languages'), retell);
retell();
