// SPDX-License-Identifier: Apache-2.0
// What a sound artist plays: presets and the way between two, modes, the filter of grains, sounds.

import { descriptor, say, sentence } from './i18n.js';
import { write } from './paint.js';
import { soundsOf } from './space.js';

const MODES = ['fence', 'bow', 'beat', 'chain', 'continue'];
const FILTERS = ['off', 'low-pass', 'band-pass'];
const REGIONS = ['whole', 'left', 'right', 'near', 'far'];
const BY = ['nothing', 'area', 'centroid_mean_hz', 'periodicity_mean', 'pitch_hz', 'flatness', 'rolloff95_hz', 'rms_db', 'loudness_lufs', 'duration_s'];
// Ranges of the sliders that are logarithmic, and how their values are said.
const SLIDERS = {
  filter_hz: { low: 20, high: 20000, words: (v) => `${Number(v.toPrecision(3))} Hz` },
  filter_q: { low: 0.5, high: 20, words: (v) => `${Number(v.toPrecision(2))}` },
  filter_octaves: { words: (v) => say('octaves', { count: v }) },
};
const MORPH_MS = 100; // while the slider is dragged, no oftener

export class InstrumentView {
  constructor(dialog, opener, act, askDrawing) {
    Object.assign(this, { dialog, act, askDrawing, told: {}, names: [], sounds: [], morphed: -Infinity });
    const $ = (this.$ = (id) => dialog.querySelector(`#${id}`));
    opener.onclick = () => dialog.showModal();
    $('instrument-close').onclick = () => dialog.close();
    $('preset-save').onsubmit = (event) => {
      event.preventDefault();
      this.ask('save_preset', { preset: $('preset-name').value });
    };
    $('preset-recall').onclick = () => this.ask('recall_preset', { preset: $('preset').value, over_s: Number($('over').value) });
    $('morph').oninput = () => this.morph(MORPH_MS);
    $('morph').onchange = () => this.morph(0);
    for (const id of ['mode', 'filter', 'filter_by']) $(id).onchange = () => this.ask(id, { value: $(id).value });
    for (const id of Object.keys(SLIDERS)) {
      $(id).oninput = () => this.sayValue(id, this.value(id));
      $(id).onchange = () => this.ask(id, { value: Number(this.value(id).toPrecision(3)) });
    }
    $('path-draw').onclick = () => this.drawn('path', (path) => this.ask('paths', { value: [...(this.told.paths ?? []), path] }));
    $('paths-remove').onclick = () => this.ask('paths', { value: [] });
    this.retell();
  }

  // Let the user draw over the space, which the dialog covers; `take` gets the drawing as text.
  drawn(kind, take) {
    this.dialog.close();
    this.askDrawing(kind, (words) => {
      this.dialog.showModal(); // it shows the answer
      if (words) take(words);
    });
  }

  async ask(name, body) {
    write(this.$('instrument-answer'), `${say(name)}: ${say('asked')}`);
    const { error, text, said } = await this.act(name, body);
    write(this.$('instrument-answer'), `${say(name)}: ${sentence({ text: error ?? text, said }) || say('done')}`);
    this.$('instrument-answer').className = error ? 'legend bad' : 'legend';
    if (error) this.told = {}; // show what really is
  }

  morph(pause) {
    const share = Number(this.$('morph').value);
    this.sayMorph();
    if (performance.now() - this.morphed < pause) return;
    this.morphed = performance.now();
    this.ask('morph_presets', { from: this.$('morph-from').value, to: this.$('morph-to').value, share });
  }

  sayMorph() {
    const words = `${Math.round(100 * this.$('morph').value)} %`;
    this.$('morph').setAttribute('aria-valuetext', words);
    this.dialog.querySelector('output[for=morph]').value = words;
  }

  value(id) {
    const { low, high } = SLIDERS[id];
    const at = Number(this.$(id).value);
    return low ? low * (high / low) ** at : at;
  }

  sayValue(id, value) {
    const words = SLIDERS[id].words(value);
    this.$(id).nextElementSibling.value = words;
    this.$(id).setAttribute('aria-valuetext', words);
  }

  // What a node says of its settings; what has not changed is left alone: a hand may be on it.
  take(node, values) {
    const fresh = (name) => values[name] !== undefined && String(this.told[name]) !== String(values[name]);
    for (const id of node === 'grains' ? ['mode'] : ['filter', 'filter_by']) {
      if (fresh(id)) this.$(id).value = values[id];
    }
    for (const [id, { low, high }] of Object.entries(node === 'sound' ? SLIDERS : {})) {
      if (!fresh(id)) continue;
      const value = values[id];
      this.$(id).value = low ? Math.log(value / low) / Math.log(high / low) : value;
      this.sayValue(id, value);
    }
    if (fresh('presets')) this.showPresets(values.presets);
    const [sounds, folders] = [fresh('weights') || fresh('regions'), fresh('folders')];
    Object.assign(this.told, values);
    if (folders && this.corpus) this.setCorpus(this.corpus);
    if (sounds) this.showSounds();
  }

  showPresets(names) {
    const several = this.names.length > 1; // else nobody has chosen between them
    this.names = names;
    for (const [id, at] of [['preset', 0], ['morph-from', 0], ['morph-to', 1]]) {
      const before = this.$(id).value;
      const chosen = several && names.includes(before) ? before : names[Math.min(at, names.length - 1)];
      this.$(id).replaceChildren(...names.map((name) => new Option(name, name, false, name === chosen)));
    }
    this.$('preset-there').hidden = !names.length;
    this.$('morphing').hidden = names.length < 2;
  }

  setCorpus(corpus) {
    this.corpus = corpus;
    const known = this.told.folders ?? [];
    const names = [...new Set([...soundsOf(corpus, known).names, ...known])]; // a folder may get some yet
    if (names.join() === this.sounds.join()) return;
    this.sounds = names;
    this.showSounds();
  }

  // A row for each sound: how much of it, and where it lies.
  showSounds() {
    const said = (key) => Object.fromEntries((this.told[key] ?? []).map((line) => [line.slice(0, line.lastIndexOf(' ')), line.slice(line.lastIndexOf(' ') + 1)]));
    const [weights, regions] = [said('weights'), said('regions')];
    const rows = this.sounds.map((name) => {
      const row = document.createElement('div');
      row.className = 'row';
      const [title, weight, words, region] = ['span', 'input', 'output', 'select'].map((tag) => document.createElement(tag));
      title.textContent = name;
      Object.assign(weight, { type: 'range', min: 0, max: 1, step: 0.01, value: weights[name] ?? 1, ariaLabel: say('weight_of', { name }) });
      weight.oninput = () => (words.value = `${Math.round(100 * weight.value)} %`);
      weight.oninput();
      weight.onchange = () => this.ask('weights', { value: lines({ ...weights, [name]: weight.value }) });
      const places = [...new Set([...REGIONS, regions[name] ?? 'whole', 'drawn'])];
      region.ariaLabel = say('region_of', { name });
      region.replaceChildren(...places.map((place) => new Option(place === 'drawn' || REGIONS.includes(place) ? say(`region_${place}`) : place, place, false, place === (regions[name] ?? 'whole'))));
      const put = (place) => {
        const { [name]: _, ...others } = regions;
        this.ask('regions', { value: lines(place === 'whole' ? others : { ...regions, [name]: place }) });
      };
      region.onchange = () => {
        if (region.value !== 'drawn') return put(region.value);
        this.showSounds();
        this.drawn('region', put);
      };
      row.append(title, weight, words, region);
      return row;
    });
    this.$('sounds').replaceChildren(...rows);
    this.lock(this.locked);
  }

  lock(locked) {
    this.locked = locked;
    for (const element of this.dialog.querySelectorAll('input, select, button')) {
      if (element.id !== 'instrument-close') element.disabled = Boolean(locked);
    }
  }

  // Words that are not in the page itself, in its language.
  retell() {
    const fill = (id, names, word) => {
      const before = this.$(id).value;
      this.$(id).replaceChildren(...names.map((name) => new Option(word(name), name, false, name === before)));
    };
    fill('mode', MODES, (name) => say(`mode_${name}`));
    fill('filter', FILTERS, (name) => say(`filter_${name}`));
    fill('filter_by', BY, (name) => (['nothing', 'area'].includes(name) ? say(`by_${name}`) : descriptor(name)));
    for (const id of Object.keys(SLIDERS)) this.sayValue(id, this.value(id));
    this.sayMorph();
    this.showSounds();
    write(this.$('instrument-answer'), '');
  }
}

const lines = (map) => Object.entries(map).map(([name, word]) => `${name} ${word}`);
