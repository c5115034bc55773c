// SPDX-License-Identifier: Apache-2.0
// Where cascades began and which way they went: for each a tree over the lattice, in order of onset.

import { COLUMNS, place, stands } from './lattice.js';

export const KEEP_MS = 3000; // of a slip, in which it fades; of a cascade, from its last slip on
const REPLAY_MS = 700; // from slip to slip
const HUES = 4;

// The tree of slips {block, onset, at} in order of onset: each block is joined to the nearest one that
// slipped before, of several to the latest. Returns [{path: blocks from spring to spring, at}]. A block
// without a neighbour that slipped before has a path of itself alone.
export function tree(slips) {
  return slips.flatMap(({ block, at }, i) => {
    const [column, row] = place(block);
    const steps = (other) => [Math.abs(place(other)[0] - column), Math.abs(place(other)[1] - row)];
    const far = slips.slice(0, i).map((other) => [steps(other.block), other.block]).filter(([[x, y]]) => Math.max(x, y) === 1);
    const least = Math.min(...far.map(([[x, y]]) => x + y));
    const cause = far.findLast(([[x, y]]) => x + y === least)?.[1];
    if (cause === undefined) return i ? [{ path: [block], at }] : [];
    if (least === 1) return [{ path: [cause, block], at }];
    // No spring runs across: by one of two corners, that which stays at rest if only one does.
    const [from, to] = place(cause);
    const corners = [[column, to], [from, row]].filter((one) => stands(...one)).map(([c, r]) => r * COLUMNS + c);
    const rests = corners.find((corner) => !slips.some((other) => other.block === corner));
    return [{ path: [cause, ...[rests ?? corners[0]].filter((corner) => corner !== undefined), block], at }];
  });
}

export class Paths {
  constructor() {
    this.cascades = []; // {number, hue, slips, joins, keep: ms for which a slip is shown}
  }

  slip(block, number, onset, now) {
    this.pass(now);
    const cascade = this.cascades.find((one) => one.number === number) ?? this.begin(number, KEEP_MS);
    const { slips, keep } = cascade;
    const before = slips.findIndex((slip) => slip.block === block);
    if (before === 0 || (before > 0 && now - slips[before].at < keep)) return;
    if (before > 0) slips.splice(before, 1);
    slips.push({ block, onset, at: now });
    slips.sort((a, b) => a.onset - b.onset);
    cascade.joins = tree(slips);
    this.pass(now);
  }

  begin(number, keep) {
    const used = this.cascades.map(({ hue }) => hue);
    const hue = [...Array(HUES).keys()].find((one) => !used.includes(one)) ?? this.cascades.length % HUES;
    const cascade = { number, hue, slips: [], joins: [], keep };
    this.cascades.push(cascade);
    return cascade;
  }

  // Show the blocks of a cascade once more, slowly; returns how long that takes, ms.
  replay(blocks, now) {
    const long = blocks.length * REPLAY_MS + KEEP_MS;
    const cascade = this.begin(NaN, long);
    cascade.slips = blocks.map((block, i) => ({ block, onset: i, at: now + i * REPLAY_MS }));
    cascade.joins = tree(cascade.slips);
    return long;
  }

  // Forget joins that have faded, and cascades whose last slip has.
  pass(now) {
    for (const cascade of this.cascades) cascade.joins = cascade.joins.filter(({ at }) => now - at < cascade.keep);
    this.cascades = this.cascades.filter(({ slips }) => now - Math.max(...slips.map(({ at }) => at)) < KEEP_MS);
  }
}
