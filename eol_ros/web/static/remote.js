// SPDX-License-Identifier: Apache-2.0
// The remote: what staff need on a phone, of the same server as the monitor.

import { Desk, LOOK_MS } from './desk.js';
import { addLanguages, language, speak } from './i18n.js';
import { Link } from './link.js';

const volume = document.getElementById('gain_db');
await speak(language());
const link = new Link();
const desk = new Desk(link, learn, lock);
window.eol = { link, desk }; // for tests and the curious

let told; // what the node said last: until it says another, a thumb may be on the slider
function learn(node, { gain_db: gain }) {
  if (node !== 'sound' || gain === undefined || gain === told) return;
  told = gain;
  volume.value = gain;
  lock(desk.locked);
  sayVolume(gain);
}

function sayVolume(gain) {
  const words = `${Number(gain.toPrecision(3))} dB`;
  volume.nextElementSibling.value = words;
  volume.setAttribute('aria-valuetext', words);
}

function lock(locked) {
  volume.disabled = locked || told === undefined;
}

volume.oninput = () => sayVolume(Number(volume.value));
volume.onchange = async () => {
  const { error } = await desk.act('gain_db', { value: Number(volume.value) });
  if (error && told !== undefined) sayVolume((volume.value = told));
};
addLanguages(document.getElementById('languages'), () => {
  desk.nodes.draw();
  desk.retell();
  desk.sayAnswer();
});
desk.retell();
setInterval(() => desk.look(), LOOK_MS);
