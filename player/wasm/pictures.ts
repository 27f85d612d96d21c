// The decoder of pictures as the player calls it, see docs/format.md, Pictures.  One instance
// decodes pictures of one kind and size at a time, each in the context of those before.
import { beside, decodeBand, parents, setNetworks } from "./band_decoder";
import {
  addMagnitudes,
  addPyramid,
  bandOf,
  clear,
  fitted,
  Grid,
  LEVELS,
  newGrid,
  newPyramid,
  Pyramid,
  ringSums,
} from "./grids";
import { writeImage } from "./image";
import { readMask } from "./mask";
import { allocate, mark, release } from "./memory";
import { BandPlace, logarithms, Network, newNetwork, probabilities } from "./network";
import { integer, start, unread } from "./range_decoder";
import { planeOf } from "./wavelet";
import { cells, writeWeights } from "./weight_map";

const MODE: i32 = 2;
const LOWPASS: i32 = 3;
const PLANES: i32 = 3;
const ORIENTATIONS: i32 = 3;

const networks: usize = memory.data(12);
const place: usize = memory.data(20);
/** Of each plane: coefficients of this picture, of the one before, sums of magnitudes of all. */
let newest: usize = memory.data(12);
let last: usize = memory.data(12);
const totals: usize = memory.data(12);
let height: i32 = 0;
let width: i32 = 0;
let kind: i32 = 0;
let pictures: i32 = 0;
let weights: usize = 0;
let image: usize = 0;
let input: usize = 0;
/** Ends of what stays: the networks, and what a sequence has. */
let ofNetworks: usize = 0;
let ofSequence: usize = 0;

function pyramidIn(pyramids: usize, plane: i32): Pyramid {
  return load<usize>(pyramids + (plane << 2));
}

/** Address of a network whose weights have to be written: 0 of tile flags, 1 magnitudes, 2 signs. */
export function network(index: i32, inputs: i32, hidden: i32, outputs: i32): usize {
  const made = newNetwork(inputs, hidden, outputs);
  store<usize>(networks + (index << 2), changetype<usize>(made));
  ofNetworks = mark();
  ofSequence = ofNetworks;
  return changetype<usize>(made);
}

/** Address of a table that has to be written: the logarithms, or the probabilities. */
export function table(isOfProbabilities: bool): usize {
  return isOfProbabilities ? probabilities : logarithms;
}

/** Where the weights of a map have to be written, see `weight_map.ts`. */
export function weightsAt(): usize {
  return cells;
}

/** Begin pictures of a kind and size, with the weights that have been written, or without. */
export function begin(ofKind: i32, rows: i32, columns: i32, hasWeights: bool): void {
  release(ofNetworks);
  kind = ofKind;
  height = rows;
  width = columns;
  pictures = 0;
  for (let plane = 0; plane < PLANES; plane++) {
    const h = plane ? (rows + 1) >> 1 : rows;
    const w = plane ? (columns + 1) >> 1 : columns;
    store<usize>(newest + (plane << 2), newPyramid(h, w));
    if (kind !== MODE) continue;
    store<usize>(last + (plane << 2), newPyramid(h, w));
    store<usize>(totals + (plane << 2), newPyramid(h, w));
  }
  weights = hasWeights ? allocate((rows * columns) << 2) : 0;
  image = allocate((3 * rows * columns) << 2);
  if (hasWeights) writeWeights(weights, rows, columns);
  ofSequence = mark();
}

/** Where a picture of so many bytes has to be written. */
export function inputOf(bytes: i32): usize {
  release(ofSequence);
  input = allocate(bytes);
  return input;
}

/** Decode the mask (side, side) that has been written: its address, uint8; `left` says whether that was all. */
export function mask(bytes: i32, side: i32): usize {
  start(input, bytes);
  return readMask(side);
}

/** How many bytes of the newest mask were too many. */
export function left(): i32 {
  return unread();
}

/** Decode the picture that has been written: 0, or how many bytes are too many, or -1 if it is damaged. */
export function decode(bytes: i32, step: f32): i32 {
  const band = changetype<BandPlace>(place);
  setNetworks(
    changetype<Network>(load<usize>(networks)),
    changetype<Network>(load<usize>(networks, 4)),
    changetype<Network>(load<usize>(networks, 8)),
  );
  start(input, bytes);
  band.kind = kind;
  band.pictures = pictures;
  for (let plane = 0; plane < PLANES; plane++) {
    band.plane = plane;
    clear(pyramidIn(newest, plane));
    decodePlane(band, pyramidIn(newest, plane));
  }
  if (unread()) return unread();
  drawImage(step);
  advance();
  return 0;
}

function decodePlane(place: BandPlace, pyramid: Pyramid): void {
  if (kind === MODE) decodeIn(place, pyramid, 0, LOWPASS);
  else decodeLowpass(bandOf(pyramid, 0, 0), place.plane ? 1 : 0);
  for (let level = 1; level <= LEVELS; level++) {
    for (let orientation = 0; orientation < ORIENTATIONS; orientation++) {
      const band = bandOf(pyramid, level, orientation);
      if (band.height && band.width) decodeIn(place, pyramid, level, orientation);
    }
  }
}

function decodeLowpass(band: Grid, context: i32): void {
  const row = band.across << 2;
  for (let i = 0; i < band.height; i++) {
    let at = band.at(i, 0);
    for (let j = 0; j < band.width; j++, at += 4) {
      const known = load<i32>(at - 4) + load<i32>(at - row) - load<i32>(at - row - 4);
      store<i32>(at, known + integer(context));
    }
  }
  band.hasValues = true;
}

/** Decode a band in the context of what is known. */
function decodeIn(place: BandPlace, pyramid: Pyramid, level: i32, orientation: i32): void {
  const before = mark();
  const plane = place.plane;
  place.level = level;
  place.orientation = orientation;
  const band = bandOf(pyramid, level, orientation);
  setParents(pyramid, level, orientation);
  for (let g = 0; g < 6; g++) store<usize>(beside + (g << 2), 0);
  if (level) {
    if (orientation > 0) setBeside(0, bandOf(pyramid, level, orientation - 1), band);
    if (orientation > 1) setBeside(1, bandOf(pyramid, level, orientation - 2), band);
  }
  if (pictures) {
    setBeside(2, bandOf(pyramidIn(totals, plane), level, orientation), band);
    setBeside(3, bandOf(pyramidIn(last, plane), level, orientation), band);
  }
  if (plane && level > 1) setBeside(4, bandOf(pyramidIn(newest, 0), level - 1, orientation), band);
  if (plane > 1) setBeside(5, bandOf(pyramidIn(newest, 1), level, orientation), band);
  decodeBand(place, band);
  release(before);
}

function setBeside(index: i32, grid: Grid, band: Grid): void {
  const own = fitted(grid, band.height, band.width);
  store<usize>(beside + (index << 2), changetype<usize>(own));
}

/** What the coarser level tells: magnitudes, the sums of the eight around each, the other orientations. */
function setParents(pyramid: Pyramid, level: i32, orientation: i32): void {
  for (let g = 0; g < 3; g++) store<usize>(parents + (g << 2), 0);
  if (level < 2) return;
  const coarse = bandOf(pyramid, level - 1, orientation);
  const magnitudes = newGrid(coarse.height, coarse.width);
  addMagnitudes(magnitudes, coarse);
  const others = newGrid(coarse.height, coarse.width);
  for (let other = 0; other < ORIENTATIONS; other++) {
    if (other !== orientation) addMagnitudes(others, bandOf(pyramid, level - 1, other));
  }
  store<usize>(parents, changetype<usize>(magnitudes));
  store<usize>(parents, changetype<usize>(ringSums(magnitudes)), 4);
  store<usize>(parents, changetype<usize>(others), 8);
}

function drawImage(step: f32): void {
  const luma = planeOf(pyramidIn(newest, 0), step);
  const blues = planeOf(pyramidIn(newest, 1), step);
  const reds = planeOf(pyramidIn(newest, 2), step);
  writeImage(image, luma, blues, reds, weights, kind === MODE);
}

/** What has been decoded becomes the picture before. */
function advance(): void {
  if (kind !== MODE) return;
  for (let plane = 0; plane < PLANES; plane++)
    addPyramid(pyramidIn(totals, plane), pyramidIn(newest, plane));
  const before = last;
  last = newest;
  newest = before;
  pictures++;
}

/** Address of the newest image (height, width, 3) R, G, B float32. */
export function imageAt(): usize {
  return image;
}

/** Address of the grid of a band of the newest picture: height, width, across and address of the cells, int32 each. */
export function gridAt(plane: i32, level: i32, orientation: i32): usize {
  const pyramids = kind === MODE ? last : newest;
  return changetype<usize>(bandOf(pyramidIn(pyramids, plane), level, orientation));
}
