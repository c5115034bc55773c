// SPDX-License-Identifier: Apache-2.0
// What the monitor and the remote share: buttons and their answers, cues, the PIN, and the states of
// the work and of its nodes.

import { say, sentence } from './i18n.js';
import { NodeList } from './lists.js';
import { write } from './paint.js';

export const LOOK_MS = 250;
export const STALE_S = 2.2; // without data: with the time between looks, less than 3 s
export const SILENT_S = 3.2; // of a node, from here on nothing is known of it
const ANSWER_MS = 60000; // so long the answer to a request is news
const $ = (id) => document.getElementById(id);

export class Desk {
  // `learn` takes the values of a node, `lock` whether the PIN is missing; each as soon as it is known.
  constructor(link, learn, lock) {
    Object.assign(this, { link, learn, onlock: lock, hours: null, cues: '', locked: false });
    Object.assign(this, { asked: 0, answered: 0, sayAnswer: () => {} });
    this.nodes = new NodeList($('nodes'), $('faults'), $('node-state'));
    for (const button of document.querySelectorAll('[data-control]')) button.onclick = () => this.act(button.dataset.control);
    $('pin-form').onsubmit = (event) => this.enter(event);
    link.on('health', (status) => this.take(status));
    link.on('work', () => this.retell());
    link.on('hello', ({ pin }) => {
      $('pin-form').hidden = !pin || Boolean(link.pin);
      this.lock(pin && !link.pin);
    });
    link.on('trust', ({ ok }) => {
      this.lock(!ok);
      if (ok && $('pin-form').contains(document.activeElement)) document.querySelector('[data-control]').focus();
      $('pin-form').hidden = ok;
    });
  }

  take(status) {
    this.nodes.take(status, Math.max(0, this.link.now() - status.at));
    this.learn(status.node, status.values);
    if (status.node === 'hours') {
      this.hours = status;
      this.showCues(status.values.cues ?? []);
    }
    if (['twin', 'sound', 'montage', 'hours'].includes(status.node)) this.retell();
  }

  showCues(names) {
    if (this.cues === names.join()) return;
    this.cues = names.join();
    $('cues').hidden = !names.length;
    $('cues').replaceChildren(...names.map((name) => {
      const button = document.createElement('button');
      Object.assign(button, { textContent: name, disabled: this.locked, onclick: () => this.act('cue', { name }) });
      button.dataset.control = 'cue';
      return button;
    }));
  }

  // The states in words and buttons, again: what they are made of, or the language, has changed.
  retell() {
    this.sayState(false);
    // In the clock of the museum; not what the state of the work says already.
    const told = this.link.work.said.map((part) => JSON.stringify(part));
    const said = this.hours?.said.filter((part) => !told.includes(JSON.stringify(part)));
    write($('hours'), said ? sentence({ said }) : '');
  }

  // Which buttons are pressed. What a node said holds while it is heard, and no longer.
  sayState(stale) {
    const { nodes } = this;
    const known = (node, value) => (stale || !nodes.heard(node) || nodes.age(node) > SILENT_S ? null : value);
    const sleeps = known('montage', nodes.values('montage').asleep);
    const hands = known('twin', nodes.values('twin').hands);
    write($('work-state'), stale ? '' : this.link.workWords(false)); // else the bar above says it
    $('work-state').classList.toggle('loud', this.link.work.code !== 'awake');
    $('live').dataset.asleep = Boolean(sleeps);
    press('sleep', 'wake', sleeps);
    press('mute', 'unmute', known('sound', nodes.values('sound').muted));
    press('plays_itself', 'people_only', hands ? hands === 'visitors' : null);
    $('hours').classList.toggle('old', nodes.age('hours') > SILENT_S);
    if (performance.now() - this.answered > ANSWER_MS) this.forget();
  }

  // Silence must be seen. Returns whether nothing has come for some time.
  look() {
    const stale = this.link.age() > STALE_S;
    document.body.classList.toggle('stale', stale);
    $('stalebar').hidden = !stale;
    $('live').hidden = stale;
    this.sayState(stale);
    if (stale) $('stalebar').textContent = [...new Set([this.link.workWords(stale), this.link.silence()])].join(': ');
    this.nodes.draw();
    return stale;
  }

  lock(locked) {
    this.locked = locked;
    for (const button of document.querySelectorAll('[data-control]')) button.disabled = locked;
    this.onlock(locked);
  }

  forget() {
    this.sayAnswer = () => {};
    write($('answer'), '');
  }

  // `words` makes the answer in the language of the moment: it is said again in another one, and its
  // time goes on.
  tell(words, bad) {
    this.sayAnswer = () => {
      $('answer').textContent = words();
      $('answer').className = bad ? 'legend bad' : 'legend';
    };
    this.sayAnswer();
    this.answered = performance.now();
  }

  // What is shown is the answer to the newest request; until it comes, that it was asked.
  async act(name, body = {}) {
    const mine = ++this.asked;
    const show = (words, bad) => this.tell(() => `${say(name)}${body.name ? ` ${body.name}` : ''}: ${words()}`, bad);
    show(() => say('asked'), false);
    this.answered = Infinity; // not yet
    const answer = await this.link.control(name, body);
    if (answer.values) {
      Object.assign(this.nodes.values(answer.node), answer.values);
      this.learn(answer.node, answer.values);
      this.sayState(false);
    }
    if (mine === this.asked) {
      const { error, text, said } = answer;
      show(() => sentence({ text: error ?? text, said }) || say('done'), Boolean(error));
    }
    return answer;
  }

  async enter(event) {
    event.preventDefault();
    const words = await this.link.enter($('pin').value);
    this.tell(() => words, !this.link.pin);
    $('pin').value = '';
  }
}

// Which of two buttons is pressed; neither where `on` is null: it is not known.
function press(first, second, on) {
  for (const name of [first, second]) {
    document.querySelector(`[data-control=${name}]`)?.setAttribute('aria-pressed', on !== null && (name === first) === on);
  }
}
