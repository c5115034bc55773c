// SPDX-License-Identifier: Apache-2.0
// The monitor: wires the live connection to the views, and requests of people to the routes.

import { Listener } from './audio.js';
import { CameraView } from './camera.js';
import { CascadeView } from './cascades.js';
import { addLanguages, language, say, sentence, speak } from './i18n.js';
import { InstrumentView } from './instrument.js';
import { CELLS, COUNT, IDS } from './lattice.js';
import { Link, readBlocks } from './link.js';
import { CoordinateList, LightField, NodeList } from './lists.js';
import { write } from './paint.js';
import { SoundView } from './soundview.js';
import { SpaceView } from './space.js';

const STALE_S = 2.2; // without data: with the time between looks, less than 3 s
const LOOK_MS = 250;
const PACE_S = 0.033; // eyes that read figures need no more; a slip comes at once
const SILENT_S = 3.2; // of a node, from here on nothing is known of it
const ANSWER_MS = 60000; // so long the answer to a request is news
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
const instrument = new InstrumentView($('instrument'), $('instrument-open'), act);
const cascades = new CascadeView($('cascades'));
const coordinates = new CoordinateList($('coords'));
const lights = new LightField($('lights'));
const nodes = new NodeList($('nodes'), $('faults'), $('node-state'));
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
  const seen = blocks.rows.filter((value, i) => i % 8 === 7 && value).length;
  write($('camera-state'), say('camera_words', { seen, all: COUNT, state: say(`tracker_${blocks.state}`) }));
});
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
let hours = null; // what the node of that name said last
// Values of a node: all of its state, or those that a request has just set.
function learn(node, values) {
  if (['grains', 'sound'].includes(node)) instrument.take(node, values);
  if (node === 'grains') {
    showReach(values.radius);
    space.showBlend(values.blend);
  }
}
link.on('health', (status) => {
  nodes.take(status, Math.max(0, link.now() - status.at));
  learn(status.node, status.values);
  if (status.node === 'grains') space.setFolders(status.values.folders ?? []);
  if (status.node === 'twin' && status.values.hands) {
    $('ghosts').hidden = false;
  }
  if (['twin', 'sound', 'montage'].includes(status.node)) sayState(false);
  if (status.node === 'hours') {
    hours = status;
    sayHours();
  }
});
// In the clock of the museum. The state of the work says the same while it sleeps until they begin.
function sayHours() {
  write($('hours'), hours && sentence(hours) !== sentence(link.work) ? sentence(hours) : '');
}
link.on('work', () => {
  sayState(false);
  sayHours();
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
// Which of two buttons is pressed; neither where `on` is null: it is not known.
function press(first, second, on) {
  for (const name of [first, second]) {
    document.querySelector(`[data-control=${name}]`).setAttribute('aria-pressed', on !== null && (name === first) === on);
  }
}
// Which buttons are pressed. What a node said holds while it is heard, and no longer.
function sayState(stale) {
  const known = (node, value) => (stale || !nodes.heard(node) || nodes.age(node) > SILENT_S ? null : value);
  const sleeps = known('montage', nodes.values('montage').asleep);
  const muted = known('sound', nodes.values('sound').muted);
  const hands = known('twin', nodes.values('twin').hands);
  write($('work-state'), stale ? '' : link.workWords(false)); // else the bar above says it
  $('work-state').classList.toggle('loud', link.work.code !== 'awake');
  $('live').dataset.asleep = Boolean(sleeps);
  press('sleep', 'wake', sleeps);
  press('mute', 'unmute', muted);
  press('plays_itself', 'people_only', hands ? hands === 'visitors' : null);
  $('hours').classList.toggle('old', nodes.age('hours') > SILENT_S);
  if (performance.now() - answered > ANSWER_MS) forget();
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
link.on('trust', ({ ok }) => {
  lock(!ok);
  const form = $('pin-form');
  if (ok && form.contains(document.activeElement)) document.querySelector('[data-control]').focus();
  form.hidden = ok;
});
link.on('hello', ({ pin }) => {
  $('pin-form').hidden = !pin || Boolean(link.pin);
  lock(pin && !link.pin);
});
// What people ask for

function lock(locked) {
  for (const element of document.querySelectorAll('[data-control], #radius, #blend, #axis-x, #axis-y, #hover')) element.disabled = locked;
  space.lock(locked);
  instrument.lock(locked);
}

function forget() {
  sayAnswer = () => {};
  write($('answer'), '');
}
// What is shown is the answer to the newest request; until it comes, that it was asked.
let asked = 0;
let answered = 0; // when, performance.now()
let sayAnswer = () => {}; // again, in another language
async function act(name, body = {}) {
  const mine = ++asked;
  const show = (words, kind) => {
    sayAnswer = () => write($('answer'), `${say(name)}: ${words()}`);
    sayAnswer();
    $('answer').className = kind;
  };
  show(() => say('asked'), 'legend');
  answered = Infinity; // not yet
  const answer = await link.control(name, body);
  if (answer.values) {
    Object.assign(nodes.values(answer.node), answer.values);
    learn(answer.node, answer.values);
    sayState(false);
  }
  if (mine === asked) {
    answered = performance.now();
    const { error, text, said } = answer;
    show(() => sentence({ text: error ?? text, said }) || say('done'), error ? 'legend bad' : 'legend');
  }
  if (answer.error && ['move', 'axes', 'restore'].includes(name)) link.emit('corpus'); // show what really is
  return answer;
}

for (const button of document.querySelectorAll('[data-control]')) button.onclick = () => act(button.dataset.control);
$('radius').oninput = () => sayReach(sliderReach());
$('radius').onchange = () => act('radius', { value: Number(sliderReach().toPrecision(2)) });
$('pin-form').onsubmit = async (event) => {
  event.preventDefault();
  forget();
  $('answer').textContent = await link.enter($('pin').value);
  $('answer').className = link.pin ? 'legend' : 'legend bad';
  answered = performance.now();
  $('pin').value = '';
};
$('listen').onclick = async () => {
  if (listener.on) await listener.stop();
  else if (listener.hindrance) {
    forget();
    $('answer').textContent = say(listener.hindrance);
    $('answer').className = 'legend bad';
    answered = performance.now();
  } else await listener.start();
  $('listen').setAttribute('aria-pressed', listener.on);
};
function retell() {
  if (space.corpus) space.setCorpus(space.corpus);
  redraw();
  nodes.draw();
  instrument.retell();
  sayState(false);
  sayViewers();
  nameCorpus();
  sayHours();
  sayAnswer();
}

addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT/.test(event.target.tagName)) return;
  const views = { s: 'source', n: 'off' };
  if (views[event.key]) camera.show(views[event.key]);
  if (event.key === 'o') camera.toggleOutlines();
  if (event.key === 'l') $('listen').click();
  if (event.key === 'm') {
    const muted = document.querySelector('[data-control=mute]').getAttribute('aria-pressed') === 'true';
    act(muted ? 'unmute' : 'mute');
  }
});

// Silence must be seen

const STREAMS = { camera: ['image', 'blocks'], coords: ['blocks'], sound: ['meter'] };
// Where data come only when something happens, the node that gives them must still be heard once a second.
const SOURCES = { camera: ['tracker'], coords: ['tracker', 'motion'], space: ['grains'], sound: ['sound'], cascades: ['motion'], lights: ['leds'] };
setInterval(() => {
  const age = link.age();
  const stale = age > STALE_S;
  document.body.classList.toggle('stale', stale);
  $('stalebar').hidden = !stale;
  $('live').hidden = stale;
  sayState(stale);
  if (stale) $('stalebar').textContent = [...new Set([link.workWords(stale), link.silence()])].join(': ');
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
  nodes.draw();
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
