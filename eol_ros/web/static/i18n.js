// SPDX-License-Identifier: Apache-2.0
// Words in the reader's language: flat JSON files, the same keys in each.

import { COUNT } from './lattice.js';

export const LANGUAGES = { en: 'English', 'zh-Hant': '中文' };
let words = {};

export function language() {
  const saved = localStorage.getItem('language');
  if (saved in LANGUAGES) return saved;
  return navigator.language.toLowerCase().startsWith('zh') ? 'zh-Hant' : 'en';
}

export async function speak(name) {
  localStorage.setItem('language', name);
  words = await (await fetch(`/static/lang/${name}.json`)).json();
  document.documentElement.lang = name;
  for (const element of document.querySelectorAll('[data-say]')) element.textContent = say(element.dataset.say);
  for (const element of document.querySelectorAll('[data-label]')) {
    element.setAttribute('aria-label', say(element.dataset.label));
    if (element.tagName !== 'CANVAS') element.title = say(element.dataset.label);
  }
  document.dispatchEvent(new Event('language'));
}

// What a descriptor is called; its own name where the words do not know it.
export function descriptor(name) {
  return words[`descriptor_${name}`] ?? name.replaceAll('_', ' ');
}

// The words of a key, its {places} filled; {blocks} are those of the table unless it says others.
export function say(key, places = {}) {
  const text = words[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (_, name) => ({ blocks: COUNT, ...places })[name] ?? '');
}

// What a node says of itself, or answers: each clause in the reader's language where it has a code that
// the words know, else as it came. Places may hold clauses themselves.
export function sentence({ text, said }) {
  if (!said) return text;
  const clause = (part) => {
    if (!Array.isArray(part) || !(`said_${part[0]}` in words)) return part;
    const places = Object.entries(part[1]).map(([name, value]) => [name, Array.isArray(value) ? sentence({ said: value }) : value]);
    return say(`said_${part[0]}`, Object.fromEntries(places));
  };
  return said.map(clause).join(say('clause_mark'));
}

// A button for each language; `then` is called when another one is spoken.
export function addLanguages(place, then = () => {}) {
  const mark = () => {
    for (const button of place.children) button.setAttribute('aria-pressed', button.lang === document.documentElement.lang);
  };
  for (const [name, words] of Object.entries(LANGUAGES)) {
    const button = document.createElement('button');
    button.textContent = words;
    button.lang = name;
    button.dataset.language = name;
    button.onclick = () => speak(name);
    place.append(button);
  }
  document.addEventListener('language', () => {
    mark();
    then();
  });
  mark();
}
