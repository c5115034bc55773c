// SPDX-License-Identifier: Apache-2.0
// How a person wants to be told of the work: without flashes, or in words and by the phone's motor.

import { COLUMNS, place, ROWS } from './lattice.js';
import { calm, write } from './paint.js';
import { say } from './i18n.js';

const DEFAULT = { captions: 'yes' };
const CAPTION_MS = 5000;
const HOLD_MS = 2000; // so long it can be read, unless a greater one comes

// Which part of the table a block stands in, 0..8 row by row from the near left.
export function part(block) {
  const third = (n, all) => Math.floor((3 * n + 1.5) / all);
  const [column, row] = place(block);
  return 3 * third(row, ROWS) + third(column, COLUMNS);
}

// A cascade in words; `nucleus` is the block in which it began.
export function caption(area, nucleus) {
  return say(area < 2 ? 'caption_slip' : 'caption_cascade', { area, where: say(`where_${part(nucleus)}`) });
}

export class Modes {
  constructor(buttons, line) {
    this.buttons = buttons; // by name
    this.line = line;
    this.said = null; // [area, nucleus, performance.now() when it was told, hue]
    for (const [name, button] of Object.entries(buttons)) {
      this[name] = (localStorage.getItem(name) ?? DEFAULT[name]) === 'yes';
      button.onclick = () => {
        this[name] = !this[name];
        localStorage.setItem(name, this[name] ? 'yes' : 'no');
        this.show();
      };
    }
    this.show();
  }

  // A phone vibrates longer for a larger cascade. hue: colour in which the page draws the cascade.
  cascade(area, nucleus, hue = '') {
    if (!this.captions) return;
    if (this.said && area <= this.said[0] && performance.now() - this.said[2] < HOLD_MS) return;
    this.said = [area, nucleus, performance.now(), hue];
    this.show();
    if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.(Math.min(20 + 25 * area, 600));
  }

  // Words that stay for so long, whatever else is told.
  replay(words, long) {
    this.replayed = { words, until: performance.now() + long };
    this.show();
  }

  show() {
    calm.quiet = this.quiet;
    for (const [name, button] of Object.entries(this.buttons)) button.setAttribute('aria-pressed', this[name]);
    const replayed = performance.now() < this.replayed?.until && this.replayed.words;
    const fresh = this.captions && this.said && performance.now() - this.said[2] < CAPTION_MS;
    this.line.hidden = !fresh && !replayed;
    if (fresh || replayed) write(this.line, replayed || caption(...this.said));
    this.line.style.borderColor = replayed || !fresh ? '' : this.said[3];
  }
}
