// SPDX-License-Identifier: Apache-2.0
// Coordinates, light field and nodes: what is told in rows and squares.

import { CELLS, COLUMNS, COUNT, IDS, place, ROWS } from './lattice.js';
import { fit, fontPx, write } from './paint.js';
import { readLeds } from './link.js';
import { say, sentence } from './i18n.js';

const MARKS = { ok: '\u2713', warn: '\u25b2', error: '\u2716', silent: '\u25cb' };
const SILENT_S = 3;
const FIT = 25; // rows of the list that fit (style.css)
const LATENCIES = ['image_to_blocks', 'onset_to_light', 'onset_to_sound'];

export class CoordinateList {
  constructor(card) {
    this.sum = card.querySelector('#moving-count');
    this.rows = IDS.map((id) => {
      const row = card.querySelector('tbody').insertRow();
      row.insertCell().textContent = id;
      for (let i = 0; i < 4; i++) row.insertCell();
      return row;
    });
    const list = card.querySelector('.rows');
    list.classList.toggle('long', COUNT > FIT);
    if (COUNT > FIT) list.tabIndex = 0; // the keys scroll it
    this.before = null;
    this.count = 0;
  }

  retell() {
    if (this.before) write(this.sum, say('moving_words', { count: this.count }));
  }

  // Ten times a second is as fast as digits can be read.
  take(blocks, moving) {
    if (this.before && blocks.stamp - this.before.stamp < 0.1) return;
    const span = this.before ? blocks.stamp - this.before.stamp : Infinity;
    this.count = 0;
    IDS.forEach((id, k) => {
      const at = id * 8;
      const [x, y, yaw] = blocks.rows.subarray(at, at + 3);
      const old = this.before ? this.before.rows : blocks.rows;
      const speed = Math.hypot(x - old[at], y - old[at + 1]) / span;
      const { cells } = this.rows[k];
      write(cells[1], millimetres(x));
      write(cells[2], millimetres(y));
      write(cells[3], digits((yaw * 180) / Math.PI));
      write(cells[4], moving[id] ? (speed * 1000).toFixed(1) : '0.0');
      const state = moving[id] ? 'moving' : blocks.rows[at + 7] ? '' : 'unseen';
      if (this.rows[k].className !== state) this.rows[k].className = state;
      this.count += moving[id] ? 1 : 0;
    });
    this.before = { stamp: blocks.stamp, rows: blocks.rows.slice() };
    this.retell();
  }
}

function millimetres(metres) {
  return digits(metres * 1000);
}

function digits(value) {
  return Number.isFinite(value) ? (Math.abs(value) < 0.05 ? 0 : value).toFixed(1) : '-';
}

export class LightField {
  constructor(card) {
    this.canvas = card.querySelector('canvas');
    this.words = card.querySelector('#light-sum');
    this.levels = new Uint8Array(CELLS);
    this.dirty = true;
  }

  take(packet) {
    const { white, infrared } = readLeds(packet);
    this.levels = white;
    this.infrared = infrared;
    this.dirty = true;
  }

  draw() {
    if (!this.dirty) return;
    this.dirty = false;
    const { brush, w, h } = fit(this.canvas);
    const pitch = Math.min(w / COLUMNS, h / ROWS);
    const [left, top] = [(w - COLUMNS * pitch) / 2, (h - ROWS * pitch) / 2];
    let lit = 0;
    brush.textAlign = 'center';
    brush.textBaseline = 'middle';
    brush.font = `400 ${Math.min(fontPx(0.72), 0.5 * pitch)}px ui-monospace, monospace`;
    for (const id of IDS) {
      const [column, row] = place(id);
      const [x, y] = [left + column * pitch, top + (ROWS - 1 - row) * pitch];
      const level = this.levels[id] / 255;
      if (level > 0.02) lit++;
      const shade = (c) => Math.round(c[0] + (c[1] - c[0]) * level ** 0.6);
      brush.fillStyle = `rgb(${shade([24, 255])},${shade([30, 248])},${shade([36, 228])})`;
      brush.fillRect(x + pitch * 0.06, y + pitch * 0.06, pitch * 0.88, pitch * 0.88);
      // Black or white, of which one has a contrast of 4.5 on any shade; quieter where it is dark.
      brush.fillStyle = level > 0.22 ? '#000' : level > 0.04 ? '#fff' : '#a3aba9';
      brush.fillText(id, x + pitch / 2, y + pitch / 2);
    }
    write(this.words, say('light_words', { count: lit }));
  }
}

// What a node has measured of the last minute, in whole ms: rows keep their width.
function latencies(values) {
  const known = LATENCIES.filter((name) => `${name}_p50_ms` in values);
  return known.map((name) => `${say(name, { p50: values[`${name}_p50_ms`].toFixed(0), p99: values[`${name}_p99_ms`].toFixed(0) })}, `).join('');
}

export class NodeList {
  constructor(card, faults, summary) {
    this.summary = summary;
    this.list = card.querySelector('ul');
    this.sum = card.querySelector('#node-sum');
    this.faults = faults;
    this.nodes = new Map();
  }

  // `age` in seconds: a page that has just been opened is told of states that may be old.
  take(status, age = 0) {
    const old = this.nodes.get(status.node);
    this.nodes.set(status.node, { ...status, heard: performance.now() - 1000 * age });
    if (old && old.level === 'ok' && status.level !== 'ok') {
      this.faults.textContent = `${status.node}: ${say(`level_${status.level}`)}. ${sentence(status)}`;
    }
    this.draw();
  }

  // Seconds since a node was heard; 0 for one that never was: this scene may not have it.
  age(node) {
    const known = this.nodes.get(node);
    return known ? (performance.now() - known.heard) / 1000 : 0;
  }

  // Whether a node has said anything, and what values it told last.
  heard(node) {
    return this.nodes.has(node);
  }

  values(node) {
    return this.nodes.get(node)?.values ?? {};
  }

  draw() {
    const names = [...this.nodes.keys()].sort();
    if (this.list.children.length !== names.length) {
      this.list.replaceChildren(...names.map(() => {
        const item = document.createElement('li');
        for (const part of ['mark', 'name', 'state value', 'why value']) {
          const span = document.createElement('span');
          span.className = part;
          if (part === 'mark') span.setAttribute('aria-hidden', 'true');
          item.append(span);
        }
        return item;
      }));
    }
    let good = 0;
    names.forEach((name, i) => {
      const { level, rate } = this.nodes.get(name);
      const silent = this.age(name);
      const shown = silent > SILENT_S ? 'silent' : level;
      if (shown === 'ok') good++;
      const item = this.list.children[i];
      item.dataset.level = shown;
      item.dataset.node = name;
      const words = [MARKS[shown], name, say(`level_${shown}`)];
      const hz = rate >= 0.5 ? `${rate.toFixed(rate < 10 ? 1 : 0)} Hz, ` : '';
      words.push(shown === 'silent' ? say('silent_for', { seconds: silent.toFixed(0) }) : hz + latencies(this.values(name)) + sentence(this.nodes.get(name)));
      words.forEach((word, k) => write(item.children[k], word));
    });
    const words = say('nodes_words', { good, all: names.length });
    write(this.sum, words);
    const well = good === names.length;
    write(this.summary, names.length ? `${MARKS[well ? 'ok' : 'warn']} ${words}` : '');
    this.summary.dataset.well = well;
  }
}
