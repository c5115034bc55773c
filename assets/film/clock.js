// SPDX-License-Identifier: Apache-2.0
// Put before the scripts of a page that is filmed: its time stands still until the film goes on, and
// what it hears comes from the film in place of a server.

(() => {
  const pause = window.setTimeout.bind(window); // in the time of this machine
  let now = 0; // ms since the film began
  const timers = new Map(); // id -> {at, run, every}
  let number = 0;
  let frames = [];
  const begun = new WeakMap(); // transition -> now when it was first seen

  performance.now = () => now;
  const startMs = Number(new URLSearchParams(location.search).get('start'));
  Object.defineProperty(performance, 'timeOrigin', { get: () => startMs });
  Date.now = () => startMs + now;
  const later = (every) => (work, ms = 0, ...args) => {
    timers.set(++number, { at: now + ms, run: () => work(...args), every: every ? Math.max(ms, 1) : 0 });
    return number;
  };
  window.setTimeout = later(false);
  window.setInterval = later(true);
  window.clearTimeout = window.clearInterval = (id) => timers.delete(id);
  window.requestAnimationFrame = (draw) => frames.push(draw);
  window.WebSocket = class {
    static OPEN = 1;
    readyState = 1;
    constructor() {
      pause(() => this.onopen());
    }
    send() {}
    close() {}
  };

  // Go on to `to`: what is due runs in its order, then one image is drawn.
  function advance(to) {
    for (;;) {
      const [id, due] = [...timers].reduce((best, one) => (one[1].at < (best[1]?.at ?? Infinity) ? one : best), []);
      if (!due || due.at > to) break;
      now = Math.max(now, due.at);
      if (due.every) due.at += due.every;
      else timers.delete(id);
      due.run();
    }
    now = to;
  }

  function draw() {
    const due = frames;
    frames = [];
    for (const one of due) one(now);
    for (const one of document.getAnimations()) {
      if (!begun.has(one)) begun.set(one, now);
      one.pause();
      one.currentTime = now - begun.get(one);
      if (one.currentTime >= one.effect.getComputedTiming().endTime) one.finish();
    }
  }

  // Pictures that have been asked for are there.
  async function settled() {
    const { eol } = window;
    const views = [eol.view, ...(eol.walls ?? [])].filter(Boolean);
    const busy = () => eol.camera?.decoding || views.some((view) => [...view.pictures.values()].some((one) => !one.ready));
    while (busy()) await new Promise((done) => pause(done, 2));
  }

  window.film = { advance, draw, settled };
})();
