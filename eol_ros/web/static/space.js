// SPDX-License-Identifier: Apache-2.0
// The descriptor space: every grain, the blocks as squares, their reach as circles.

import { IDS } from './lattice.js';
import { calm, fit, fontPx, INK, MOVE, QUIET, scale, THREAD, write } from './paint.js';
import { descriptor, say } from './i18n.js';

const FLASH_S = 0.5;
const PAD = 0.08;
const REST_MS = 80; // so long the pointer rests on a grain before its waveform is fetched
const HEARD_MS = 120; // hearing under the pointer: no grain sooner after the one before
const TICKS = [0, 0.25, 0.5, 0.75, 1];
const STEP = 0.02; // of the space: least side of a region, least step of a path
const MOST_POINTS = 40; // of a drawn path; beyond it, every second one is left out
const BY_SOUND = 'by_sound';
// One of its own for each sound, told apart by those who see few colours, too (Okabe, Ito).
const SOUNDS = ['#56b4e9', '#e69f00', '#009e73', '#f0e442', '#cc79a7', '#d55e00', '#0072b2', '#bbbbbb'];

// What people know a corpus by: its sounds, those of a folder (`folders` names these) as one.
// Of each file the number of its sound, and the names of the sounds.
export function soundsOf({ files, folders = [] }, known) {
  const of = files.map((file, i) => (known.includes(folders[i]) ? folders[i] : file.replace(/^ice-\d+-\d+$/, 'ice')));
  const names = [...new Set(of)];
  return { names, of: of.map((name) => names.indexOf(name)) };
}

export class SpaceView {
  constructor(card, act) {
    this.canvas = card.querySelector('canvas');
    this.legend = card.querySelector('#grain');
    this.menus = { x: card.querySelector('#axis-x'), y: card.querySelector('#axis-y'), colour: card.querySelector('#axis-colour') };
    this.act = act;
    this.flashes = new Map();
    this.picked = -1;
    this.reach = 0;
    this.folders = [];
    this.paths = []; // the points of each
    this.menus.colour.onchange = () => this.recolour();
    for (const axis of ['x', 'y']) {
      this.menus[axis].onchange = () => act('axes', { x: this.menus.x.value, y: this.menus.y.value });
    }
    this.hearing = card.querySelector('#hover');
    this.undoing = card.querySelector('#undo');
    this.list = card.querySelector('#moved');
    this.slider = card.querySelector('#blend');
    this.moves = []; // newest last: grain, and where it was; nowhere, if the layout had it there
    this.heard = -Infinity;
    this.hearing.onclick = () => this.hearing.setAttribute('aria-pressed', this.hearing.ariaPressed !== 'true');
    this.undoing.onclick = () => this.undo();
    this.slider.oninput = () => this.sayBlend();
    this.slider.onchange = () => act('blend', { value: Number(this.slider.value) });
    this.canvas.onpointermove = (event) => this.hover(event);
    this.canvas.onpointerleave = () => this.dragging || this.drawing || this.pick(-1);
    this.canvas.onpointerdown = (event) => this.grab(event);
    this.canvas.onpointerup = (event) => this.release(event);
    this.canvas.onpointercancel = () => this.answerDrawing('');
    this.canvas.onkeydown = (event) => this.key(event);
  }

  setCorpus(corpus) {
    if (corpus !== this.corpus) this.held = null;
    this.corpus = corpus;
    this.sounds = soundsOf(corpus, this.folders);
    // What is the same for all grains tells nothing of a place.
    const varied = corpus.descriptors.filter((_, i) => new Set(corpus.values[i]).size > 1);
    const options = (names, chosen) =>
      [...new Set([...names, chosen])].map((name) => new Option(name === BY_SOUND ? say(BY_SOUND) : descriptor(name), name, false, name === chosen));
    for (const axis of ['x', 'y']) {
      this.menus[axis].replaceChildren(...options(varied, corpus[`${axis}_name`]));
    }
    const names = this.sounds.names.length > 1 ? [BY_SOUND, ...varied] : varied;
    const before = this.menus.colour.value;
    this.menus.colour.replaceChildren(...options(names, names.includes(before) ? before : names[0]));
    this.showMoved();
    this.canvas.dataset.grains = corpus.x.length;
    this.recolour();
  }

  lock(locked) {
    this.locked = locked;
    this.canvas.style.cursor = locked ? 'not-allowed' : '';
    this.showMoved();
  }

  // What was moved by hand, each with a button that puts it back.
  showMoved() {
    const { moved = [] } = this.corpus ?? {};
    this.undoing.disabled = this.locked || !this.moves.length;
    this.list.hidden = !moved.length;
    write(this.list.querySelector('summary'), say('moved_words', { count: moved.length }));
    const rows = moved.map((grain) => {
      const button = document.createElement('button');
      button.textContent = say('restore_grain', { grain });
      button.disabled = this.locked;
      button.onclick = () => this.act('restore', { grain });
      button.onpointerenter = button.onfocus = () => this.pick(grain);
      const row = document.createElement('li');
      row.append(button);
      return row;
    });
    this.list.querySelector('ul').replaceChildren(...rows);
  }

  undo() {
    const last = this.moves.pop();
    if (!last) return;
    if (last.by_hand) this.act('move', { grain: last.grain, x: last.x, y: last.y });
    else this.act('restore', { grain: last.grain });
    this.showMoved();
  }

  showBlend(told) {
    if (told === undefined || told === this.told) return; // the same: a hand may be on it
    this.told = told;
    this.slider.value = told;
    this.sayBlend();
  }

  sayBlend() {
    const words = `${Math.round(100 * this.slider.value)} %`;
    this.slider.nextElementSibling.value = words;
    this.slider.setAttribute('aria-valuetext', words);
  }

  recolour() {
    this.dirty = true;
    this.still = null;
    if (this.menus.colour.value === BY_SOUND) {
      this.colours = this.corpus.file.map((file) => SOUNDS[this.sounds.of[file] % SOUNDS.length]);
      return;
    }
    const column = this.corpus.descriptors.indexOf(this.menus.colour.value);
    const values = this.corpus.values[column] ?? this.corpus.x;
    const order = values.map((_, i) => i).sort((a, b) => values[a] - values[b]);
    this.colours = [];
    order.forEach((grain, rank) => (this.colours[grain] = scale(rank / Math.max(values.length - 1, 1))));
  }

  blocks(blocks, moving) {
    this.seen = blocks;
    this.moving = moving;
  }

  hit(grain) {
    this.flashes.set(grain, performance.now());
    this.canvas.dataset.hits = Number(this.canvas.dataset.hits || 0) + 1;
    this.dirty = true;
  }

  at(x, y) {
    const { w, h } = this.box;
    return [w * (PAD + (1 - 2 * PAD) * x), h * (1 - PAD - (1 - 2 * PAD) * y)];
  }

  back(px, py) {
    const { w, h } = this.box;
    const within = (v) => Math.min(Math.max(v, 0), 1);
    return [within((px / w - PAD) / (1 - 2 * PAD)), within((1 - PAD - py / h) / (1 - 2 * PAD))];
  }

  nearest(px, py, within = 22) {
    let [best, least] = [-1, within];
    for (let i = 0; this.corpus && i < this.corpus.x.length; i++) {
      const [x, y] = this.at(this.corpus.x[i], this.corpus.y[i]);
      const far = Math.hypot(x - px, y - py);
      if (far < least) [best, least] = [i, far];
    }
    return best;
  }

  pick(grain) {
    if (grain === this.picked) return;
    this.picked = grain;
    this.dirty = true;
    this.wave = null;
    clearTimeout(this.resting);
    if (grain >= 0) this.resting = setTimeout(() => this.fetchWave(grain), REST_MS);
    if (grain < 0) return write(this.legend, '');
    const { corpus } = this;
    const column = corpus.descriptors.indexOf(this.menus.colour.value);
    const sound = corpus.files.length > 1 ? corpus.files[corpus.file[grain]] : '';
    const value = column < 0 ? sound : `${descriptor(this.menus.colour.value)} ${round(corpus.values[column][grain])}`;
    const words = say('grain_words', {
      grain, start: corpus.start[grain].toFixed(2), duration: corpus.duration[grain].toFixed(2), value,
    });
    const near = this.blocksOver(grain);
    this.legend.textContent = near.length ? `${words}${say('clause_mark')}${say('grain_reached', { blocks: near.join(', ') })}` : words;
  }

  async fetchWave(grain) {
    const answer = await fetch(`/grain/${grain}`).catch(() => null);
    const { peaks } = answer?.ok ? await answer.json() : { peaks: [] };
    if (grain !== this.picked) return;
    this.wave = peaks;
    this.canvas.dataset.wave = peaks.length;
    this.dirty = true;
  }

  // The waveform of the picked grain, in the upper corner away from it, scaled to its loudest.
  drawWave(brush, w, h) {
    if (!this.wave?.length) return;
    const [wide, high] = [Math.min(192, w / 3), Math.min(48, h / 6)];
    const left = this.at(this.corpus.x[this.picked], 0)[0] < w / 2 ? w - wide - 6 : 6;
    const step = wide / this.wave.length;
    const loudest = Math.max(...this.wave.flat().map(Math.abs), 1e-6);
    brush.fillStyle = '#0d1115e0';
    brush.fillRect(left, 6, wide, high);
    brush.fillStyle = THREAD;
    this.wave.forEach(([least, most], i) => {
      const top = 6 + (high / 2) * (1 - most / loudest);
      brush.fillRect(left + i * step, top, Math.max(step - 0.5, 0.5), Math.max((high / 2) * ((most - least) / loudest), 1));
    });
  }

  // Which blocks stand so near to a grain that they would play it.
  blocksOver(grain) {
    if (!this.seen || !this.reach) return [];
    const { bounds: [x0, y0, x1, y1], x, y } = this.corpus;
    return IDS.filter((id) => {
      const [bx, by] = this.place(id);
      return Math.hypot((x1 - x0) * (bx - x[grain]), (y1 - y0) * (by - y[grain])) < this.reach;
    });
  }

  // The place in the space, 0..1, where a block plays: clipped to the edges, or along the paths.
  place(id) {
    const [x0, y0, x1, y1] = this.corpus.bounds;
    const [x, y] = this.seen.rows.slice(id * 8, id * 8 + 2);
    const within = (v) => Math.min(Math.max(v, 0), 1);
    return along(this.paths, within((x - x0) / (x1 - x0)), within((y - y0) / (y1 - y0)));
  }

  setPaths(lines) {
    if (lines.join() === this.paths.lines) return;
    this.paths = lines.map((line) => line.split(' ').map((point) => point.split(',').map(Number)));
    this.paths.lines = lines.join();
    this.dirty = true;
  }

  // `answer` gets the `region` or `path` of the next drag as text, in 0..1, or '' if nothing was drawn.
  askDrawing(kind, answer) {
    this.drawing = { kind, answer, points: [] };
    write(this.legend, say(kind === 'path' ? 'path_ask' : 'region_ask'));
    this.canvas.focus(); // Escape ends it
  }

  answerDrawing(words) {
    const { drawing } = this;
    this.drawing = null;
    this.dirty = true;
    if (!drawing) return;
    write(this.legend, '');
    drawing.answer(words);
  }

  // Add a point to the drawing: the corner of a region at the pointer, or the next point of a path.
  drawTo(x, y) {
    const { kind, points } = this.drawing;
    const [px, py] = points.at(-1) ?? [-1, -1];
    if (kind === 'region') points.splice(1, 1, [x, y]);
    else if (Math.hypot(x - px, y - py) > STEP) points.push([x, y]);
    if (points.length > MOST_POINTS) this.drawing.points = points.filter((_, i) => i % 2 === 0);
    this.dirty = true;
  }

  endDrawing() {
    const { kind, points } = this.drawing;
    const across = (axis) => points.map((point) => point[axis]).sort((a, b) => a - b);
    const [x, y] = [across(0), across(1)];
    const words = (...numbers) => numbers.map((v) => v.toFixed(2)).join();
    if (kind === 'path') this.answerDrawing(points.length > 1 ? points.map((at) => words(...at)).join(' ') : '');
    else this.answerDrawing(x[1] - x[0] > STEP && y[1] - y[0] > STEP ? words(x[0], y[0], x[1], y[1]) : '');
  }

  hover(event) {
    if (!this.corpus) return;
    if (this.drawing) {
      if (this.canvas.hasPointerCapture(event.pointerId)) this.drawTo(...this.back(event.offsetX, event.offsetY));
      return;
    }
    if (this.dragging) {
      const moved = Math.hypot(event.offsetX - this.dragging.px, event.offsetY - this.dragging.py);
      if (moved > 6) this.dragging.moved = true;
      if (this.dragging.moved) this.put(this.picked, ...this.back(event.offsetX, event.offsetY));
      return;
    }
    const before = this.picked;
    this.pick(this.nearest(event.offsetX, event.offsetY));
    if (this.hearing.ariaPressed !== 'true' || this.picked < 0 || this.picked === before) return;
    if (performance.now() - this.heard < HEARD_MS) return;
    this.heard = performance.now();
    this.play(this.picked);
  }

  grab(event) {
    if (!this.corpus) return;
    if (this.drawing) {
      this.canvas.setPointerCapture(event.pointerId);
      this.drawing.points = [this.back(event.offsetX, event.offsetY)];
      return;
    }
    const grain = this.nearest(event.offsetX, event.offsetY);
    if (grain < 0) return;
    this.pick(grain);
    if (this.locked) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.dragging = { px: event.offsetX, py: event.offsetY, moved: false };
  }

  release() {
    const { dragging, drawing } = this;
    if (drawing?.points.length) this.endDrawing();
    this.dragging = null;
    if (!dragging) return;
    if (dragging.moved) this.send();
    else this.play(this.picked);
  }

  put(grain, x, y) {
    const { corpus } = this;
    if (this.held?.grain !== grain) {
      this.held = { grain, x: corpus.x[grain], y: corpus.y[grain], by_hand: corpus.moved.includes(grain) };
    }
    this.corpus.x[grain] = x;
    this.corpus.y[grain] = y;
    this.still = null;
    this.dirty = true;
  }

  send() {
    const { corpus, picked } = this;
    if (this.held) this.moves.push(this.held);
    this.held = null;
    this.showMoved();
    this.act('move', { grain: picked, x: corpus.x[picked], y: corpus.y[picked] });
  }

  play(grain) {
    if (grain >= 0 && !this.locked) this.act('play', { grain });
  }

  // Arrows walk to the next grain in their direction, Enter plays it, Shift + arrows move it.
  key(event) {
    const step = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!this.corpus || !this.corpus.x.length) return;
    if (event.key === 'Escape' && this.drawing?.kind === 'region') this.answerDrawing('');
    else if (event.key === 'Escape') this.drawing && this.endDrawing();
    else if (event.key === 'Enter' && this.drawing?.kind === 'path' && this.picked >= 0) this.drawTo(this.corpus.x[this.picked], this.corpus.y[this.picked]);
    else if (event.key === 'Enter' || event.key === ' ') this.play(this.picked);
    else if (step && event.shiftKey && this.picked >= 0 && !this.locked) {
      const within = (v) => Math.min(Math.max(v, 0), 1);
      this.put(this.picked, within(this.corpus.x[this.picked] + step[0] * 0.01), within(this.corpus.y[this.picked] + step[1] * 0.01));
      clearTimeout(this.soon);
      this.soon = setTimeout(() => this.send(), 400);
    } else if (step) this.pick(this.walk(step));
    else return;
    event.preventDefault();
  }

  walk([dx, dy]) {
    const { x, y } = this.corpus;
    if (this.picked < 0) return 0;
    let [best, least] = [this.picked, Infinity];
    for (let i = 0; i < x.length; i++) {
      const [ax, ay] = [x[i] - x[this.picked], y[i] - y[this.picked]];
      const along = ax * dx + ay * dy;
      const aside = Math.abs(ax * dy - ay * dx);
      if (along > 1e-6 && along + 2 * aside < least) [best, least] = [i, along + 2 * aside];
    }
    return best;
  }

  draw(now) {
    if (!this.dirty) return;
    this.dirty = this.flashes.size > 0; // they fade: draw again
    const { brush, w, h } = fit(this.canvas, '#0d1115');
    this.box = { w, h };
    const { corpus } = this;
    if (!corpus) return;
    const dot = Math.max(Math.min(w, h) / 170, 1.6);
    if (!this.still || this.still.width !== this.canvas.width || this.still.height !== this.canvas.height) {
      this.still = this.drawStill(w, h, dot);
    }
    brush.drawImage(this.still, 0, 0, w, h);
    if (this.picked >= 0) this.ring(brush, this.picked, dot * 3.4, INK, 1);
    for (const [grain, since] of this.flashes) {
      const age = (now - since) / 1000 / FLASH_S;
      if (age >= 1 || grain >= corpus.x.length) this.flashes.delete(grain);
      else if (calm.matches) this.ring(brush, grain, dot * 3, THREAD, 1);
      else this.ring(brush, grain, dot * (2 + 4 * age), THREAD, 1 - age, dot * 1.8 * (1 - age));
    }
    this.drawBlocks(brush);
    this.drawWave(brush, w, h);
    for (const points of this.paths) this.drawPath(brush, points, QUIET);
    const { kind, points = [] } = this.drawing ?? {};
    if (kind === 'path') this.drawPath(brush, points, INK);
    else if (points.length > 1) {
      const [[x0, y0], [x1, y1]] = points;
      this.drawPath(brush, [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]], INK);
    }
  }

  drawPath(brush, points, colour) {
    brush.strokeStyle = colour;
    brush.lineWidth = 1.6;
    brush.beginPath();
    points.forEach((point) => brush.lineTo(...this.at(...point)));
    brush.stroke();
  }

  // Axes and grains move only when a person moves them: drawn once, kept.
  drawStill(w, h, dot) {
    const still = new OffscreenCanvas(this.canvas.width, this.canvas.height);
    const brush = still.getContext('2d');
    brush.scale(still.width / w, still.height / h);
    this.drawAxes(brush, w, h);
    const { x, y } = this.corpus;
    for (let i = 0; i < x.length; i++) {
      const [px, py] = this.at(x[i], y[i]);
      brush.fillStyle = this.colours[i];
      brush.beginPath();
      brush.arc(px, py, dot, 0, 7);
      brush.fill();
    }
    return still;
  }

  ring(brush, grain, r, colour, alpha, dot = 0) {
    const [x, y] = this.at(this.corpus.x[grain], this.corpus.y[grain]);
    brush.globalAlpha = Math.max(alpha, 0);
    brush.strokeStyle = brush.fillStyle = colour;
    brush.lineWidth = 1.6;
    brush.beginPath();
    brush.arc(x, y, r, 0, 7);
    brush.stroke();
    if (dot) {
      brush.beginPath();
      brush.arc(x, y, dot, 0, 7);
      brush.fill();
    }
    brush.globalAlpha = 1;
  }

  drawAxes(brush, w, h) {
    const size = fontPx(0.76);
    brush.strokeStyle = '#1b2229';
    brush.lineWidth = 1;
    brush.beginPath();
    for (let i = 0; i <= 4; i++) {
      const [x0, y0] = this.at(i / 4, i / 4);
      brush.moveTo(x0, 0);
      brush.lineTo(x0, h);
      brush.moveTo(0, y0);
      brush.lineTo(w, y0);
    }
    brush.stroke();
    brush.fillStyle = QUIET;
    brush.font = `300 ${size}px system-ui`;
    brush.textAlign = 'right';
    brush.textBaseline = 'bottom';
    brush.fillText(`${descriptor(this.corpus.x_name)} \u2192`, w - 6, h - 3);
    brush.textAlign = 'left';
    brush.textBaseline = 'top';
    brush.fillText(`\u2191 ${descriptor(this.corpus.y_name)}`, 6, 4);
    const small = fontPx(0.66);
    brush.font = `300 ${small}px system-ui`;
    const under = Math.min(this.at(0, 0)[1] + 3, h - 3 - size - small);
    const [across, up] = [this.ticks('x'), this.ticks('y')];
    TICKS.forEach((at, i) => {
      const [px, py] = this.at(at, at);
      brush.textAlign = 'center';
      brush.textBaseline = 'top';
      brush.fillText(across[i], px, under);
      brush.textAlign = 'left';
      brush.textBaseline = 'middle';
      if (py > size + small && (at || h > 300)) brush.fillText(up[i], 4, py);
    });
    if (this.menus.colour.value === BY_SOUND) this.drawSounds(brush, w);
  }

  // What a grain at a tick would have, for any layout: the line through the tenth of the grains nearest
  // to it, the nearer the heavier (local regression: Cleveland, J. Am. Stat. Assoc. 74 (1979) 829), of
  // frequencies through their logarithms.
  // Where they do not rise, as over regions that have a scale each, there is none to show.
  ticks(axis) {
    const values = TICKS.map((at) => this.tick(axis, at));
    return values.every((value, i) => !i || value >= values[i - 1]) ? values.map(round) : TICKS.map(() => '');
  }

  tick(axis, at) {
    const { corpus } = this;
    const column = corpus.values[corpus.descriptors.indexOf(corpus[`${axis}_name`])];
    if (!column) return NaN;
    const near = [...column.keys()].filter((i) => Number.isFinite(corpus[axis][i]) && Number.isFinite(column[i]));
    near.sort((a, b) => Math.abs(corpus[axis][a] - at) - Math.abs(corpus[axis][b] - at));
    near.length = Math.min(near.length, Math.max(2, Math.round(near.length / 10)));
    const octaves = corpus[`${axis}_name`].endsWith('_hz') && near.every((i) => column[i] > 0);
    const far = 1.001 * Math.abs(corpus[axis][near[near.length - 1]] - at) + 1e-9;
    let [n, sx, sy, sxx, sxy] = [0, 0, 0, 0, 0];
    for (const i of near) {
      const x = corpus[axis][i] - at;
      const y = octaves ? Math.log(column[i]) : column[i];
      const weight = (1 - (Math.abs(x) / far) ** 3) ** 3;
      [n, sx, sy, sxx, sxy] = [n + weight, sx + weight * x, sy + weight * y, sxx + weight * x * x, sxy + weight * x * y];
    }
    const spread = n * sxx - sx * sx; // of one column of a lattice: none
    const level = spread > 1e-9 * n * n ? (sxx * sy - sx * sxy) / spread : sy / n;
    return octaves ? Math.exp(level) : level;
  }

  // Folders whose sounds are one here.
  setFolders(names) {
    if (names.join() === this.folders.join()) return;
    this.folders = names;
    if (this.corpus) this.setCorpus(this.corpus);
  }

  drawSounds(brush, w) {
    const size = fontPx(0.72);
    brush.font = `400 ${size}px system-ui`;
    brush.textAlign = 'right';
    brush.textBaseline = 'top';
    this.sounds.names.slice(0, SOUNDS.length).forEach((name, i) => {
      brush.fillStyle = SOUNDS[i];
      brush.fillText(`${name} \u25cf`, w - 6, 4 + i * size * 1.3);
    });
  }

  // The reach of a block, in metres.
  setReach(metres) {
    this.reach = metres;
    this.dirty = true;
  }

  drawBlocks(brush) {
    if (!this.seen) return;
    const [x0, y0, x1, y1] = this.corpus.bounds;
    const perM = (this.box.w * (1 - 2 * PAD)) / (x1 - x0);
    const tallM = (this.box.h * (1 - 2 * PAD)) / (y1 - y0);
    for (const id of IDS) {
      const [bx, by] = this.place(id);
      if (!Number.isFinite(bx + by)) continue;
      const [x, y] = this.at(bx, by);
      const live = this.moving[id];
      brush.strokeStyle = live ? MOVE : '#5d6972';
      brush.lineWidth = fontPx(live ? 0.13 : 0.07);
      const half = fontPx(live ? 0.45 : 0.26);
      brush.strokeRect(x - half, y - half, 2 * half, 2 * half);
      brush.globalAlpha = live ? 1 : 0.55;
      brush.beginPath();
      brush.ellipse(x, y, this.reach * perM, this.reach * tallM, 0, 0, 7);
      brush.stroke();
      brush.globalAlpha = 1;
    }
  }
}

// The place on the paths where a block at x, y plays, as in `eol_ros.core.sound.paths.along`.
function along(paths, x, y) {
  if (!paths.length || !Number.isFinite(x + y)) return [x, y]; // a block not found yet has no place
  const level = y * (paths.length - 1);
  const low = Math.max(Math.min(Math.floor(level), paths.length - 2), 0);
  const [a, b] = [low, Math.min(low + 1, paths.length - 1)].map((i) => on(paths[i], x));
  return a.map((v, axis) => v + (level - low) * (b[axis] - v));
}

function on(points, share) {
  const lengths = points.slice(1).map(([x, y], i) => Math.hypot(x - points[i][0], y - points[i][1]));
  let left = share * lengths.reduce((sum, v) => sum + v, 0);
  let i = 0;
  while (i < lengths.length - 1 && left > lengths[i]) left -= lengths[i++];
  return points[i].map((v, axis) => v + (left / Math.max(lengths[i], 1e-9)) * (points[i + 1][axis] - v));
}

function round(value) {
  if (!Number.isFinite(value)) return '';
  return Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3);
}
