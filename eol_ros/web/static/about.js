// SPDX-License-Identifier: Apache-2.0
// What this is, and what is happening now, for who has just come in.

import { addLanguages, language, say, speak } from './i18n.js';
import { Link } from './link.js';
import { caption } from './modes.js';
import { write } from './paint.js';

const STALE_S = 2.5;
const SILENT_S = 5;
const $ = (id) => document.getElementById(id);

await speak(language());
const link = new Link(['slips']);
window.eol = { link };
const nodes = new Map(); // by name: what each said last, and when
const moving = new Set();
let day = null;
let wall = null;
let corpus = '';

link.on('health', (status) => nodes.set(status.node, { ...status, heard: performance.now() - 1000 * Math.max(0, link.now() - status.at) }));
link.on('slip', ({ block, start }) => (start ? moving.add(block) : moving.delete(block)));
link.on('up', () => moving.clear());
link.on('wall', (notice) => (wall = notice));
link.on('cascades', (notice) => (day = notice));
link.on('corpus', async () => {
  const answer = await fetch('/corpus');
  if (answer.ok) corpus = (await answer.json()).name;
});

// What a node said, while it is still heard.
function heard(name) {
  const found = nodes.get(name);
  return found && performance.now() - found.heard < 1000 * SILENT_S ? found : null;
}

function rows() {
  const [twin, motion, sound] = ['twin', 'motion', 'sound'].map(heard);
  const areas = day?.areas ?? [];
  const total = areas.reduce((sum, n) => sum + n, 0);
  const newest = day?.recent[day.recent.length - 1];
  const asleep = link.asleep && link.workWords(false);
  return {
    state: link.workWords(false),
    hands: asleep || (twin ? say(`playing_${twin.values.playing || 'nobody'}`) : motion && say('playing_real')),
    moving: motion && say('moving_words', { count: moving.size }),
    count: day && say('cascade_words', { total, largest: areas.reduce((most, n, area) => (n ? area : most), 0) }),
    last: day && !newest ? say('about_none') : newest && `${new Date(1000 * newest[0]).toLocaleTimeString(document.documentElement.lang)}  ${caption(newest[2], newest[1])}`,
    sound: !sound && link.work.code === 'awake' ? say('sound_none') : link.work.code === 'awake' ? say('about_sound') : link.workWords(false),
    walls: asleep || (wall && [document.documentElement.lang === 'zh-Hant' && wall.caption_zh ? wall.caption_zh : wall.caption, wall.credit].filter(Boolean).join('  \u00b7  ')),
  };
}

function tell() {
  const stale = link.age() > STALE_S;
  const unknown = stale ? link.workWords(stale) : say('about_unknown');
  for (const [name, words] of Object.entries(rows())) {
    const known = !stale && words;
    write($(name), known ? words : unknown);
    $(name).className = known ? '' : 'unknown';
  }
  write($('corpus'), corpus && say('about_corpus', { name: corpus }));
}
addLanguages($('languages'), tell);
setInterval(tell, 500);
tell();
