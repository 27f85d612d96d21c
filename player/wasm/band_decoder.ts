import { enlargedTileSums, Grid, newGrid, ringSum, TILE, tileSums } from "./grids";
import { allocate, mark, release } from "./memory";
import {
  add,
  BandPlace,
  finishPosition,
  Network,
  probability,
  startPass,
  startPosition,
} from "./network";
import { bit, expGolomb } from "./range_decoder";

/** Bands with no more values have no flags. */
const SMALL_BAND: i32 = 64;
/** A position of a pass is in two rows and two columns, at this one of them. */
const PASSES: i32 = 4;
const UNARY_LIMIT: i32 = 60;
/** First features of a magnitude, see docs/format.md, Context. */
const PARENTS: i32 = 6;
const BESIDE: i32 = 9;
const FLAGS: i32 = 15;
const AROUND: i32 = 16;
/** Of the grids beside the band these have the sums around a place as features as well. */
const WITH_AROUND: i32 = 5;
/** The first of those whose signs predict signs, and its feature. */
const SIGNED: i32 = 3;
const SIGNED_FEATURE: i32 = 11;
const GRIDS_BESIDE: i32 = 6;
const COARSER: i32 = 3;

let tiles: Network = changetype<Network>(0);
let sizes: Network = changetype<Network>(0);
let signs: Network = changetype<Network>(0);

/** Set the networks of tile flags, of magnitudes and of signs. */
export function setNetworks(ofTiles: Network, ofSizes: Network, ofSigns: Network): void {
  tiles = ofTiles;
  sizes = ofSizes;
  signs = ofSigns;
}

/** Grids 1 to 3 and 4 to 9 of docs/format.md of the band that is decoded; 0: zeros. */
export const parents: usize = memory.data(4 * COARSER);
export const beside: usize = memory.data(4 * GRIDS_BESIDE);
/** Those of its tile flags. */
const tileParents: usize = memory.data(4 * COARSER);
const tileBeside: usize = memory.data(4 * GRIDS_BESIDE);

/** Which grids are around a place: of a band, or of its flags. */
let own: Grid = changetype<Grid>(0);
let ownParents: usize = 0;
let ownBeside: usize = 0;
/** By which a place is coarser in the parents. */
let shift: i32 = 0;

function gridIn(grids: usize, index: i32): Grid {
  return changetype<Grid>(load<usize>(grids + (index << 2)));
}

function isThere(grid: Grid): bool {
  return changetype<usize>(grid) !== 0 && grid.hasValues;
}

function sum2(at: usize, step: i32): i32 {
  return abs(load<i32>(at - step)) + abs(load<i32>(at + step));
}

/** Sum of the magnitudes at distance 2. */
function outerSum(at: usize, row: i32): i32 {
  let sum = sum2(at - row, 8) + sum2(at, 8) + sum2(at + row, 8);
  for (let line = at - 2 * row; line <= at + 2 * row; line += 4 * row) {
    sum += sum2(line, 8) + sum2(line, 4) + abs(load<i32>(line));
  }
  return sum;
}

/** Give the network the features of a magnitude; flags: of the nine tiles around its tile. */
function addMagnitude(i: i32, j: i32, flags: i32): void {
  startPosition(i, j, own.height, own.width);
  const row = own.across << 2;
  const at = own.at(i, j);
  const mirrored = own.at(i, own.width - 1 - j);
  add(0, sum2(at, 4));
  add(1, sum2(at, row));
  add(2, sum2(at, row + 4) + sum2(at, row - 4));
  add(3, outerSum(at, row));
  add(4, abs(load<i32>(mirrored)));
  add(5, ringSum(mirrored, row));
  for (let g = 0; g < COARSER; g++) {
    const grid = gridIn(ownParents, g);
    if (isThere(grid)) add(PARENTS + g, load<i32>(grid.at(i >> shift, j >> shift)));
  }
  for (let g = 0; g < GRIDS_BESIDE; g++) {
    const grid = gridIn(ownBeside, g);
    if (!isThere(grid)) continue;
    const place = grid.at(i, j);
    add(BESIDE + g, abs(load<i32>(place)));
    if (g < WITH_AROUND) add(AROUND + g, ringSum(place, row));
  }
  add(FLAGS, flags);
  finishPosition();
}

/** Give the network the features of a sign. */
function addSign(i: i32, j: i32): void {
  startPosition(i, j, own.height, own.width);
  const row = own.across << 2;
  const at = own.at(i, j);
  const mirrored = own.at(i, own.width - 1 - j);
  add(0, load<i32>(at - 4));
  add(1, load<i32>(at + 4));
  add(2, load<i32>(at - row));
  add(3, load<i32>(at + row));
  add(4, load<i32>(at - row - 4));
  add(5, load<i32>(at - row + 4));
  add(6, load<i32>(at + row - 4));
  add(7, load<i32>(at + row + 4));
  add(8, load<i32>(mirrored));
  add(9, load<i32>(mirrored - 4));
  add(10, load<i32>(mirrored + 4));
  for (let g = SIGNED; g < GRIDS_BESIDE; g++) {
    const grid = gridIn(ownBeside, g);
    if (isThere(grid)) add(SIGNED_FEATURE + g - SIGNED, load<i32>(grid.at(i, j)));
  }
  finishPosition();
}

/** Decode a band, tile flags first, in the context of `parents` and `beside`, each of its size. */
export function decodeBand(place: BandPlace, band: Grid): void {
  const before = mark();
  const flags = newGrid((band.height + TILE - 1) / TILE, (band.width + TILE - 1) / TILE);
  let any = true;
  if (flags.height * flags.width * TILE * TILE > SMALL_BAND) {
    for (let g = 0; g < COARSER; g++) {
      const grid = gridIn(parents, g);
      const sums = isThere(grid) ? enlargedTileSums(grid, band.height, band.width) : null;
      store<usize>(tileParents + (g << 2), sums ? changetype<usize>(sums) : 0);
    }
    for (let g = 0; g < GRIDS_BESIDE; g++) {
      const grid = gridIn(beside, g);
      const sums = isThere(grid) ? tileSums(grid) : null;
      store<usize>(tileBeside + (g << 2), sums ? changetype<usize>(sums) : 0);
    }
    own = flags;
    ownParents = tileParents;
    ownBeside = tileBeside;
    shift = 0;
    any = decodeFlags(place, flags);
  } else {
    for (let i = 0; i < flags.height; i++) {
      for (let j = 0; j < flags.width; j++) store<i32>(flags.at(i, j), 1);
    }
  }
  if (any) {
    own = band;
    ownParents = parents;
    ownBeside = beside;
    shift = 1;
    decodeValues(place, flags);
  }
  release(before);
}

/** First row and column of a pass. */
function rowOf(pass: i32): i32 {
  return pass === 1 || pass === 3 ? 1 : 0;
}

function columnOf(pass: i32): i32 {
  return pass === 1 || pass === 2 ? 1 : 0;
}

/** Decode the flags; whether there are any. */
function decodeFlags(place: BandPlace, flags: Grid): bool {
  const decided = allocate(flags.height * flags.width);
  let any = false;
  for (let pass = 0; pass < PASSES; pass++) {
    startPass(tiles, place, pass, flags.height);
    let next = decided;
    for (let i = rowOf(pass); i < flags.height; i += 2) {
      for (let j = columnOf(pass); j < flags.width; j += 2) {
        addMagnitude(i, j, 0);
        store<u8>(next++, bit(probability(0)));
      }
    }
    next = decided;
    for (let i = rowOf(pass); i < flags.height; i += 2) {
      for (let j = columnOf(pass); j < flags.width; j += 2) {
        const flag: i32 = load<u8>(next++);
        if (!flag) continue;
        store<i32>(flags.at(i, j), 1);
        any = true;
      }
    }
    flags.hasValues = any;
  }
  return any;
}

/** Row, column and value of what is not zero in a pass. */
@unmanaged
class Found {
  i: i32;
  j: i32;
  value: i32;
}

function decodeValues(place: BandPlace, flags: Grid): void {
  const band = own;
  const size = offsetof<Found>();
  const most = ((band.height + 1) >> 1) * ((band.width + 1) >> 1);
  const first = allocate(size * most);
  for (let pass = 0; pass < PASSES; pass++) {
    startPass(sizes, place, pass, band.height);
    let end = first;
    for (let i = rowOf(pass); i < band.height; i += 2) {
      for (let j = columnOf(pass); j < band.width; j += 2) {
        const tile = flags.at(i >> 2, j >> 2);
        if (!load<i32>(tile)) continue;
        addMagnitude(i, j, ringSum(tile, flags.across << 2) + 1);
        const magnitude = decodeMagnitude();
        if (!magnitude) continue;
        const found = changetype<Found>(end);
        found.i = i;
        found.j = j;
        found.value = magnitude;
        end += size;
      }
    }
    decodeSigns(place, pass, first, end);
  }
  band.hasValues = true;
}

/** Decode the signs of a pass, then enter its values: none of them is known to the others. */
function decodeSigns(place: BandPlace, pass: i32, first: usize, end: usize): void {
  startPass(signs, place, pass, own.height);
  for (let at = first; at < end; at += offsetof<Found>()) {
    const found = changetype<Found>(at);
    addSign(found.i, found.j);
    if (bit(probability(0))) found.value = -found.value;
  }
  for (let at = first; at < end; at += offsetof<Found>()) {
    const found = changetype<Found>(at);
    store<i32>(own.at(found.i, found.j), found.value);
  }
}

function decodeMagnitude(): i32 {
  for (let reached = 0; reached < UNARY_LIMIT; reached++) {
    if (!bit(probability(outputOf(reached)))) return reached;
  }
  return UNARY_LIMIT + expGolomb();
}

/** The output of the network for a unary decision: the last one for all further ones. */
function outputOf(reached: i32): i32 {
  if (reached < 4) return reached;
  if (reached === 4) return 3;
  return reached < 9 ? 4 : 5;
}
