// SPDX-License-Identifier: Apache-2.0
// The live connection: packets and notices in, wants and hands out; reconnects by itself and knows
// how old what it has is. Packets are laid out in eol_ros/web/wire.py.

import { say, sentence } from './i18n.js';
import { CELLS, LATTICE } from './lattice.js';

const KINDS = ['', 'blocks', 'truth', 'image', 'meter', 'sound', 'leds'];
const RETRY_S = [1, 2, 4, 8, 10];
const SET_S = 1; // by which the server's clock departs only where somebody sets it

export class Link extends EventTarget {
  constructor(wants = [], pace = 0) {
    super();
    this.wanted = wants;
    this.pace = pace; // s between states, when that is enough for the page; events come at once
    this.viewer = 0;
    this.mayPush = false;
    this.pinNeeded = false;
    this.trusted = false;
    this.private = []; // channels that are kept from us until the PIN is given
    this.pin = '';
    // performance.now() of the newest packet of each kind; 'any' of whatever, at first of the page.
    this.heard = { any: performance.now() };
    this.offsets = []; // [round trip, server clock minus ours], s
    this.offset = 0;
    this.tries = 0;
    this.work = { code: '', said: [] }; // state of the whole work, as the panel publishes it
    this.open();
    setInterval(() => this.ping(), 4000);
    document.addEventListener('visibilitychange', () => this.tellWants());
    addEventListener('pagehide', () => this.socket.close()); // a page kept for "back" looks no more
    addEventListener('pageshow', (event) => event.persisted && this.retry());
  }

  open() {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    this.socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket.binaryType = 'arraybuffer';
    this.socket.onopen = () => {
      this.tries = 0;
      this.offsets = [];
      if (this.pace) this.send({ pace: this.pace });
      this.tellWants();
      if (this.pin) this.send({ pin: this.pin });
      for (const wait of [0, 60, 150, 300, 600]) setTimeout(() => this.ping(), wait);
      this.emit('up');
    };
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = () => {
      clearTimeout(this.retryTimer);
      const wait = RETRY_S[Math.min(this.tries++, RETRY_S.length - 1)];
      this.emit('down');
      this.retryTimer = setTimeout(() => this.open(), wait * 1000);
    };
  }

  retry() {
    clearTimeout(this.retryTimer);
    if (this.socket.readyState === WebSocket.CLOSED) this.open();
  }

  emit(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  on(name, handler) {
    this.addEventListener(name, (event) => handler(event.detail));
    return this;
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  want(channels) {
    this.wanted = channels;
    this.tellWants();
  }

  // A hidden page asks for nothing; sound has a connection of its own (soundwire.js).
  tellWants() {
    this.send({ wants: document.visibilityState === 'hidden' ? [] : this.wanted });
  }

  ping() {
    this.send({ ping: performance.now() });
  }

  // Seconds since the epoch on the server's clock.
  now() {
    return (performance.timeOrigin + performance.now()) / 1000 + this.offset;
  }

  // Seconds since anything (or one kind) was heard; Infinity when never.
  age(kind = 'any') {
    return this.heard[kind] === undefined ? Infinity : (performance.now() - this.heard[kind]) / 1000;
  }

  // Whether the work sleeps: nothing lights or sounds, so no page shows cascades.
  get asleep() {
    return this.work.code.startsWith('asleep');
  }

  // The state of the whole work in words, the same on every page; '' before anything is known.
  workWords(stale) {
    return stale && this.work.code !== 'stopped' ? this.silence() : sentence(this.work);
  }

  // For how long nothing has come, in words.
  silence() {
    return this.viewer ? say('no_data', { seconds: this.age().toFixed(0) }) : say('no_connection');
  }

  take(data) {
    const here = performance.now();
    this.heard.any = here;
    if (typeof data === 'string') {
      const notice = JSON.parse(data);
      if (notice.t === 'pong') this.learnClock(notice, here);
      if (notice.t === 'hello') {
        Object.assign(this, { viewer: notice.viewer, mayPush: notice.push, pinNeeded: notice.pin, private: notice.private });
        this.trusted = !notice.pin;
        // The panel was started again with another table.
        if (notice.lattice && JSON.stringify(notice.lattice) !== JSON.stringify(LATTICE)) location.reload();
        if (!this.offsets.length) this.offset = notice.now - (performance.timeOrigin + here) / 1000;
      }
      // Somebody set the server's clock: the pings before say nothing of it any more.
      if (notice.t === 'tick' && Math.abs(notice.now - this.now()) > SET_S) {
        this.offsets = [];
        this.offset = notice.now - (performance.timeOrigin + here) / 1000;
      }
      if (notice.t === 'trust') Object.assign(this, { trusted: notice.ok, mayPush: notice.push, private: notice.private });
      if (notice.t === 'work') this.work = notice;
      this.heard[notice.t] = here;
      this.emit(notice.t, notice);
      return;
    }
    const view = new DataView(data);
    const kind = KINDS[view.getUint8(0)];
    if (!kind) return;
    this.heard[kind] = here;
    this.emit(kind, { view, data, stamp: view.getFloat64(8, true) });
  }

  learnClock(pong, here) {
    const trip = (here - pong.ping) / 1000;
    const middle = (performance.timeOrigin + (here + pong.ping) / 2) / 1000;
    this.offsets.push([trip, pong.now - middle]);
    if (this.offsets.length > 16) this.offsets.shift();
    this.offset = this.offsets.reduce((best, o) => (o[0] < best[0] ? o : best))[1];
    this.trip = trip;
  }

  // Ask for a control; answers {ok} or {error}.
  async control(name, body = {}) {
    try {
      const answer = await fetch(`/control/${name}`, {
        method: 'POST',
        headers: { 'Content-Type': 'application/json', 'X-Pin': this.pin },
        body: JSON.stringify(body),
      });
      return { status: answer.status, ...(await answer.json()) };
    } catch {
      return { status: 0, error: say('no_connection') };
    }
  }

  // Try a PIN; answers in words what came of it.
  async enter(pin) {
    let answer;
    try {
      answer = await fetch('/pin', { method: 'POST', headers: { 'X-Pin': (pin = plain(pin)) } });
    } catch {
      return say('no_connection');
    }
    if (answer.status === 429) return say('pin_locked', { seconds: answer.headers.get('Retry-After') });
    if (!answer.ok) return say('pin_wrong');
    this.pin = pin;
    this.send({ pin });
    return say('unlocked');
  }
}

// A PIN as a header can carry it: digits of a Chinese keyboard as plain ones; '' where it is none,
// since `panel.pin` is of plain characters.
export function plain(pin) {
  const found = pin.normalize('NFKC');
  return /^[ -~]*$/.test(found) ? found : '';
}

export function readBlocks({ view, data, stamp }) {
  return { stamp, state: view.getUint8(1), ambiguous: view.getUint8(2), rows: new Float32Array(data, 16, 8 * CELLS) };
}

export function readTruth({ data, stamp }) {
  const body = new Float32Array(data, 16, 3 + 3 * CELLS);
  const column = (i) => body.subarray(3 + i * CELLS, 3 + (i + 1) * CELLS);
  return {
    stamp,
    rim: body.subarray(0, 3),
    x: column(0),
    y: column(1),
    yaw: column(2),
    moving: new Uint8Array(data, 16 + body.byteLength, CELLS),
  };
}

export function readMeter({ view, data, stamp }) {
  const count = view.getUint16(1, true);
  const bands = view.getUint16(3, true);
  const at = 16;
  const figures = JSON.parse(new TextDecoder().decode(new Uint8Array(data, at + 2 * count + bands)));
  return {
    stamp,
    low: new Int8Array(data, at, count),
    high: new Int8Array(data, at + count, count),
    bands: new Int8Array(data, at + 2 * count, bands),
    ...figures,
  };
}

export function readLeds({ view, data, stamp }) {
  return { stamp, infrared: view.getUint8(1), white: new Uint8Array(data, 16, CELLS) };
}
