// SPDX-License-Identifier: Apache-2.0
// Cascades of today: how many reached at least an area A, both axes logarithmic.

import { COUNT } from './lattice.js';
import { EDGE, fit, fontPx, INK, QUIET, THREAD, WATER, write } from './paint.js';
import { say } from './i18n.js';

const TICKS = [...[1, 2, 5, 10, 20, 50, 100].filter((area) => 2 * area < COUNT), COUNT];

export class CascadeView {
  constructor(card) {
    this.canvas = card.querySelector('canvas');
    this.count = card.querySelector('#cascade-count');
    this.last = card.querySelector('#last-cascade');
    this.words = card.querySelector('#law-words');
    this.dirty = true;
  }

  take(day) {
    this.day = day;
    this.law = day.law; // fitted by the panel, as `eol report` fits it
    this.dirty = true;
  }

  draw() {
    if (!this.dirty) return;
    this.dirty = false;
    const areas = this.day ? this.day.areas : [];
    const total = areas.reduce((sum, n) => sum + n, 0);
    const largest = areas.reduce((most, n, area) => (n ? area : most), 0);
    write(this.count, say('cascade_words', { total, largest }));
    write(this.words, this.lawWords());
    this.canvas.dataset.total = total;
    this.drawLaw(areas, total);
    const newest = this.day && this.day.recent[this.day.recent.length - 1];
    if (newest) {
      const [onset, nucleus, area, size, duration] = newest;
      const time = new Date(onset * 1000).toLocaleTimeString(document.documentElement.lang);
      this.last.textContent = say('last_cascade', { time, nucleus, area, size, duration: duration.toFixed(2) });
    }
  }

  lawWords() {
    if (!this.law) return '';
    const { b, error, from, count, fitted, fewest, rejected, ks, p, automaton } = this.law;
    if (b === undefined && !rejected) return say(fitted < fewest ? 'law_few' : 'law_none', { count: fitted, fewest });
    const words = rejected ? say('law_rejected', { ks: ks.toFixed(2), p: p.toPrecision(1), count })
      : say('law_words', { b: b.toFixed(2), error: error.toFixed(2), from, count });
    return automaton ? `${words}${say('clause_mark')}${say('law_automaton', { b: automaton.toFixed(2) })}` : words;
  }

  drawLaw(areas, total) {
    const { brush, w, h } = fit(this.canvas);
    const size = fontPx(0.74);
    const decades = Math.max(Math.ceil(Math.log10(Math.max(total, 2))), 1);
    brush.font = `300 ${size}px system-ui`;
    const left = brush.measureText(String(10 ** decades)).width + size;
    const [right, top, low] = [size, size * 2.3, h - size * 2.6];
    const x = (area) => left + ((w - left - right) * Math.log10(area)) / Math.log10(1.2 * COUNT);
    const y = (count) => low - ((low - top) * Math.log10(count)) / decades;
    brush.fillStyle = QUIET;
    brush.strokeStyle = EDGE;
    brush.lineWidth = 1;
    brush.textBaseline = 'middle';
    brush.textAlign = 'right';
    for (let d = 0; d <= decades; d++) {
      line(brush, left, y(10 ** d), w - right, y(10 ** d));
      brush.fillText(String(10 ** d), left - 6, y(10 ** d));
    }
    brush.textAlign = 'center';
    brush.textBaseline = 'top';
    for (const area of TICKS) {
      line(brush, x(area), top, x(area), low);
      brush.fillText(area, x(area), low + 4);
    }
    brush.fillText(say('law_x'), (left + w - right) / 2, low + 4 + size * 1.15);
    brush.textAlign = 'left';
    brush.fillText('N(\u2265A)', left, size * 0.2);
    if (!total) return;
    let above = total;
    const points = [];
    const { law } = this;
    for (let area = 1; area <= COUNT && above > 0; area++) {
      points.push([x(area), y(above)]);
      above -= areas[area];
    }
    if (law && law.b !== undefined) {
      const begin = areas.reduce((sum, n, area) => (area >= law.from ? sum + n : sum), 0);
      brush.strokeStyle = WATER;
      brush.lineWidth = fontPx(0.13);
      brush.setLineDash([fontPx(0.4), fontPx(0.3)]);
      brush.beginPath();
      for (let area = law.from; area <= COUNT; area++) {
        const height = begin * law.exceedance[area - law.from];
        if (height < 1) break;
        brush.lineTo(x(area), y(height));
      }
      brush.stroke();
      brush.setLineDash([]);
    }
    brush.strokeStyle = THREAD;
    brush.lineWidth = fontPx(0.1);
    brush.beginPath();
    points.forEach(([px, py], i) => {
      if (i) brush.lineTo(px, points[i - 1][1]);
      brush.lineTo(px, py);
    });
    brush.stroke();
    brush.fillStyle = INK;
    for (const [px, py] of points) {
      brush.beginPath();
      brush.arc(px, py, fontPx(0.15), 0, 7);
      brush.fill();
    }
  }
}

function line(brush, x0, y0, x1, y1) {
  brush.beginPath();
  brush.moveTo(x0, y0);
  brush.lineTo(x1, y1);
  brush.stroke();
}
