// SPDX-License-Identifier: Apache-2.0
// Waveform, spectrum on a logarithmic axis, and a dBFS meter with peak hold.

import { EDGE, fit, fontPx, QUIET, WATER, write } from './paint.js';
import { readMeter } from './link.js';
import { say } from './i18n.js';

const HOLD_S = 1.5;
const FALL_DB_S = 12;
const FLOOR_DB = -90;

export class SoundView {
  constructor(card) {
    this.wave = card.querySelector('#wave');
    this.spectrum = card.querySelector('#spectrum');
    this.level = card.querySelector('#level');
    this.bar = this.level.querySelector('i');
    this.peak = this.level.querySelector('b');
    this.words = card.querySelector('#dbfs');
    this.state = card.querySelector('#sound-state');
    this.held = FLOOR_DB;
    this.heldAt = 0;
  }

  take(packet) {
    this.meter = readMeter(packet);
    this.dirty = true;
  }

  draw(now) {
    if (!this.dirty) return;
    this.dirty = false;
    this.drawWave();
    this.drawSpectrum();
    this.drawLevel(now);
    const { sample_rate: rate, voices, underruns, latency } = this.meter;
    write(this.state, say('sound_words', {
      rate: rate / 1000, voices, underruns, latency: Math.round(latency * 1000),
    }));
  }

  drawWave() {
    const { brush, w, h } = fit(this.wave, '#0d1115');
    const { low, high } = this.meter;
    brush.fillStyle = EDGE;
    brush.fillRect(0, h / 2, w, 1);
    brush.strokeStyle = WATER;
    brush.lineWidth = Math.max(w / low.length, 1);
    brush.beginPath();
    for (let i = 0; i < low.length; i++) {
      const x = ((i + 0.5) * w) / low.length;
      brush.moveTo(x, h / 2 - (high[i] / 127) * (h / 2) - 0.4);
      brush.lineTo(x, h / 2 - (low[i] / 127) * (h / 2) + 0.4);
    }
    brush.stroke();
  }

  drawSpectrum() {
    const { brush, w, h } = fit(this.spectrum, '#0d1115');
    const { bands } = this.meter;
    const size = fontPx(0.7);
    const base = h - size * 1.4;
    brush.font = `300 ${size}px system-ui`;
    brush.textBaseline = 'bottom';
    for (const [hz, label] of [[50, '50'], [100, '100'], [500, '500'], [1000, '1 k'], [5000, '5 k'], [10000, '10 k Hz']]) {
      const x = (w * Math.log10(hz / 20)) / 3;
      brush.fillStyle = EDGE;
      brush.fillRect(x, 0, 1, base);
      brush.fillStyle = QUIET;
      brush.textAlign = 'center';
      brush.fillText(label, Math.min(x, w - size * 2.2), h);
    }
    brush.fillStyle = '#3f8f88';
    for (let i = 0; i < bands.length; i++) {
      const tall = base * Math.min(Math.max((bands[i] - FLOOR_DB) / -FLOOR_DB, 0), 1);
      brush.fillRect((i * w) / bands.length, base - tall, w / bands.length - 0.6, tall);
    }
  }

  drawLevel(now) {
    const peak = Math.max(this.meter.peak_dbfs ?? FLOOR_DB, FLOOR_DB);
    const fallen = this.held - Math.max((now - this.heldAt) / 1000 - HOLD_S, 0) * FALL_DB_S;
    if (peak >= fallen) [this.held, this.heldAt] = [peak, now];
    const place = (db) => Math.min(Math.max((db + 60) / 60, 0), 1) * 100;
    this.bar.style.clipPath = `inset(0 ${100 - place(peak)}% 0 0)`;
    this.peak.style.left = `calc(${place(Math.max(fallen, peak))}% - 2px)`;
    this.level.setAttribute('aria-valuenow', Math.round(Math.max(peak, -60)));
    const rms = Math.max(this.meter.rms_dbfs ?? FLOOR_DB, FLOOR_DB);
    write(this.words, `${say('peak')} ${peak.toFixed(1)}  rms ${rms.toFixed(1)} dBFS`);
  }
}
