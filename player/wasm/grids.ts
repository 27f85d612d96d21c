import { allocate, allocateZeros } from "./memory";

/** Zeros around the values of a grid, so that places around a place need no test. */
export const PAD: i32 = 2;
/** Side of the tiles of a subband. */
export const TILE: i32 = 4;
export const LEVELS: i32 = 5;
const BANDS: i32 = 1 + 3 * LEVELS;

/** Integers (height, width) of a subband, row by row, with zeros around them. */
@unmanaged
export class Grid {
  height: i32;
  width: i32;
  /** values from one row to the next */
  across: i32;
  cells: usize;
  /** false: all are 0 */
  hasValues: bool;

  /** Address of a value. */
  at(i: i32, j: i32): usize {
    return this.cells + (((i + PAD) * this.across + PAD + j) << 2);
  }

  /** Bytes of the cells. */
  bytes(): usize {
    return ((this.height + 2 * PAD) * this.across) << 2;
  }
}

/** Zeros in a size. */
export function newGrid(height: i32, width: i32): Grid {
  const grid = changetype<Grid>(allocate(offsetof<Grid>()));
  grid.height = height;
  grid.width = width;
  grid.across = width + 2 * PAD;
  grid.cells = allocateZeros(grid.bytes());
  grid.hasValues = false;
  return grid;
}

/** Add the magnitudes of a grid as far as it reaches. */
export function addMagnitudes(to: Grid, from: Grid): void {
  if (!from.hasValues) return;
  to.hasValues = true;
  const rows = min(to.height, from.height);
  const columns = min(to.width, from.width);
  for (let i = 0; i < rows; i++) {
    let own = to.at(i, 0);
    let other = from.at(i, 0);
    for (let j = 0; j < columns; j++, own += 4, other += 4)
      store<i32>(own, load<i32>(own) + abs(load<i32>(other)));
  }
}

/** Magnitudes of a grid cut, or filled with zeros, to a size; itself if it has that size. */
export function fitted(grid: Grid, height: i32, width: i32): Grid {
  if (grid.height === height && grid.width === width) return grid;
  const result = newGrid(height, width);
  addMagnitudes(result, grid);
  return result;
}

/** Sums of the magnitudes of each tile. */
export function tileSums(grid: Grid): Grid {
  const sums = newGrid((grid.height + TILE - 1) / TILE, (grid.width + TILE - 1) / TILE);
  if (!grid.hasValues) return sums;
  sums.hasValues = true;
  for (let i = 0; i < grid.height; i++) {
    const to = sums.at(i >> 2, 0);
    const from = grid.at(i, 0);
    for (let j = 0; j < grid.width; j++) {
      const sum = to + ((j >> 2) << 2);
      store<i32>(sum, load<i32>(sum) + abs(load<i32>(from + (j << 2))));
    }
  }
  return sums;
}

/** Sums of the tiles of a subband (height, width) that has each value of a coarser grid four times. */
export function enlargedTileSums(grid: Grid, height: i32, width: i32): Grid {
  const sums = newGrid((height + TILE - 1) / TILE, (width + TILE - 1) / TILE);
  if (!grid.hasValues) return sums;
  sums.hasValues = true;
  const rows = min(grid.height, (height + 1) >> 1);
  const columns = min(grid.width, (width + 1) >> 1);
  for (let i = 0; i < rows; i++) {
    const to = sums.at(i >> 1, 0);
    const from = grid.at(i, 0);
    const ownRows = min(height - 2 * i, 2);
    for (let j = 0; j < columns; j++) {
      const sum = to + ((j >> 1) << 2);
      const times = ownRows * min(width - 2 * j, 2);
      store<i32>(sum, load<i32>(sum) + times * load<i32>(from + (j << 2)));
    }
  }
  return sums;
}

/** Sums of the magnitudes of the eight neighbours of each value. */
export function ringSums(grid: Grid): Grid {
  const sums = newGrid(grid.height, grid.width);
  if (!grid.hasValues) return sums;
  sums.hasValues = true;
  const row = grid.across << 2;
  for (let i = 0; i < grid.height; i++) {
    let to = sums.at(i, 0);
    let from = grid.at(i, 0);
    for (let j = 0; j < grid.width; j++, to += 4, from += 4) store<i32>(to, ringSum(from, row));
  }
  return sums;
}

/** Sum of the magnitudes of the eight neighbours of a value; row: bytes from one row to the next. */
export function ringSum(at: usize, row: i32): i32 {
  const left = at - 4;
  const above = i32x4.abs(v128.load(left - row));
  const own = i32x4.abs(v128.load(left));
  const below = i32x4.abs(v128.load(left + row));
  const sums = i32x4.add(i32x4.add(above, below), own);
  const three = i32x4.extract_lane(sums, 0) + i32x4.extract_lane(sums, 1);
  return three + i32x4.extract_lane(sums, 2) - i32x4.extract_lane(own, 1);
}

/** The subbands of a plane: the lowpass grid, then three a level, the coarsest level first. */
export type Pyramid = usize;

/** The grid of a level and an orientation; level 0 is the lowpass grid. */
export function bandOf(pyramid: Pyramid, level: i32, orientation: i32): Grid {
  const index = level ? 1 + 3 * (level - 1) + orientation : 0;
  return changetype<Grid>(load<usize>(pyramid + (index << 2)));
}

/** Zeros in the shapes of the subbands of a plane. */
export function newPyramid(height: i32, width: i32): Pyramid {
  const pyramid = allocate(BANDS << 2);
  for (let level = LEVELS; level > 0; level--) {
    const rows = (height + 1) >> 1;
    const columns = (width + 1) >> 1;
    enter(pyramid, level, 0, newGrid(rows, width >> 1));
    enter(pyramid, level, 1, newGrid(height >> 1, columns));
    enter(pyramid, level, 2, newGrid(height >> 1, width >> 1));
    height = rows;
    width = columns;
  }
  store<usize>(pyramid, changetype<usize>(newGrid(height, width)));
  return pyramid;
}

function enter(pyramid: Pyramid, level: i32, orientation: i32, grid: Grid): void {
  store<usize>(pyramid + ((1 + 3 * (level - 1) + orientation) << 2), changetype<usize>(grid));
}

/** Make all values of a plane zeros. */
export function clear(pyramid: Pyramid): void {
  for (let band = 0; band < BANDS; band++) {
    const grid = changetype<Grid>(load<usize>(pyramid + (band << 2)));
    memory.fill(grid.cells, 0, grid.bytes());
    grid.hasValues = false;
  }
}

/** Add the magnitudes of all subbands of a plane. */
export function addPyramid(to: Pyramid, from: Pyramid): void {
  for (let band = 0; band < BANDS; band++) {
    const own = changetype<Grid>(load<usize>(to + (band << 2)));
    addMagnitudes(own, changetype<Grid>(load<usize>(from + (band << 2))));
  }
}
