// SPDX-License-Identifier: Apache-2.0
// Size and shape of the table, which the panel has from the scene (eol_ros/core/table.py): metres,
// pairs along x and along y.

export const LATTICE = await (await fetch('/lattice')).json();
export const { rows: ROWS, columns: COLUMNS, side: BLOCK_M, gaps: GAPS_M, bar: BAR_M, platform: PLATFORM_M } = LATTICE;
export const CELLS = ROWS * COLUMNS;
const absent = new Set(LATTICE.absent);
export const IDS = [...Array(CELLS).keys()].filter((id) => !absent.has(id)); // of places with a block
export const COUNT = IDS.length;
export const RIM_M = [COLUMNS, ROWS].map((n, i) => n * BLOCK_M + (n + 1) * GAPS_M[i]); // inside of it

// Whether a block stands in a column and row.
export function stands(column, row) {
  return column >= 0 && row >= 0 && column < COLUMNS && row < ROWS && !absent.has(row * COLUMNS + column);
}

// Column and row of an id.
export function place(id) {
  return [id % COLUMNS, Math.floor(id / COLUMNS)];
}

// Centre of a place at rest.
export function rest(id) {
  const [column, row] = place(id);
  return [(column - (COLUMNS - 1) / 2) * (BLOCK_M + GAPS_M[0]), (row - (ROWS - 1) / 2) * (BLOCK_M + GAPS_M[1])];
}
