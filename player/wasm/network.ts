import { allocate } from "./memory";

const MAX_LOGIT: i32 = 2048;
const MAX_HIDDEN: i32 = 16384;
const MOST_HIDDEN: i32 = 40;
const MOST_FEATURES: i32 = 24;
/** First row of each class, see docs/format.md, Probabilities. */
const PLANE: i32 = 3;
const LEVEL: i32 = 6;
const ORIENTATION: i32 = 12;
const PASS: i32 = 16;
const ROW: i32 = 20;
const COLUMN: i32 = 36;
const CLASSES: i32 = 52;
const CELLS: i32 = 16;
const MAX_MAGNITUDE: i32 = 1023;

/** A network that gives the probabilities of decisions. */
@unmanaged
export class Network {
  /** of a position; two more are of the pass */
  inputs: i32;
  hidden: i32;
  outputs: i32;
  /** (inputs + 2, hidden) int32 */
  features: usize;
  /** (52, hidden) int32 */
  classes: usize;
  /** (outputs, hidden + 2) float64: the one before the last is what is added to all */
  last: usize;
}

/** What all positions of a band have in common: kind of picture, place among the subbands. */
@unmanaged
export class BandPlace {
  kind: i32;
  plane: i32;
  level: i32;
  orientation: i32;
  /** modes before this one */
  pictures: i32;
}

/** 16 log2(1 + x), rounded: uint8 each. */
export const logarithms: usize = memory.data(MAX_MAGNITUDE + 1);
/** Probabilities of a zero, of the logits from -2048 to 2048: int32 each. */
export const probabilities: usize = memory.data(4 * (2 * MAX_LOGIT + 1));
const shared: usize = memory.data(4 * MOST_HIDDEN, 16);
const units: usize = memory.data(4 * MOST_HIDDEN, 16);
/** Of each feature that is not zero: its row of weights, and its value. */
const rows: usize = memory.data(4 * MOST_FEATURES);
const values: usize = memory.data(4 * MOST_FEATURES);
let features: i32 = 0;
let network: Network = changetype<Network>(0);
let rowClass: usize = 0;
let columnClass: usize = 0;

/** A network whose weights have not been written yet. */
export function newNetwork(inputs: i32, hidden: i32, outputs: i32): Network {
  const made = changetype<Network>(allocate(offsetof<Network>()));
  made.inputs = inputs;
  made.hidden = hidden;
  made.outputs = outputs;
  made.features = allocate(((inputs + 2) * hidden) << 2);
  made.classes = allocate((CLASSES * hidden) << 2);
  made.last = allocate((outputs * (hidden + 2)) << 3);
  return made;
}

function logOf(magnitude: i32): i32 {
  return load<u8>(logarithms + min(magnitude, MAX_MAGNITUDE));
}

/** Begin a pass of a grid of a height. */
export function startPass(own: Network, band: BandPlace, pass: i32, height: i32): void {
  network = own;
  const row = own.hidden << 2;
  const before = logOf(band.pictures);
  const tall = logOf(height);
  for (let j = 0; j < row; j += 4) {
    const ofClass = own.classes + j;
    let sum = before * load<i32>(own.features + own.inputs * row + j);
    sum += tall * load<i32>(own.features + (own.inputs + 1) * row + j);
    sum += load<i32>(ofClass + band.kind * row);
    sum += load<i32>(ofClass + (PLANE + band.plane) * row);
    sum += load<i32>(ofClass + (LEVEL + band.level) * row);
    sum += load<i32>(ofClass + (ORIENTATION + band.orientation) * row);
    sum += load<i32>(ofClass + (PASS + pass) * row);
    store<i32>(shared + j, sum);
  }
}

/** Begin a position of a grid (height, width). */
export function startPosition(row: i32, column: i32, height: i32, width: i32): void {
  const across = network.hidden << 2;
  rowClass = network.classes + (ROW + (row * CELLS) / height) * across;
  columnClass = network.classes + (COLUMN + (column * CELLS) / width) * across;
  features = 0;
}

/** Add a feature of the position. */
export function add(index: i32, value: i32): void {
  if (!value) return;
  const log = logOf(abs(value));
  store<i32>(values + (features << 2), value < 0 ? -log : log);
  store<usize>(rows + (features << 2), network.features + ((index * network.hidden) << 2));
  features++;
}

/** Compute the hidden units of the position. */
export function finishPosition(): void {
  const most = i32x4.splat(MAX_HIDDEN);
  const none = i32x4.splat(0);
  const end = features << 2;
  for (let j = 0, size = network.hidden << 2; j < size; j += 32) {
    let a = i32x4.add(v128.load(shared + j), v128.load(rowClass + j));
    let b = i32x4.add(v128.load(shared + j, 16), v128.load(rowClass + j, 16));
    a = i32x4.add(a, v128.load(columnClass + j));
    b = i32x4.add(b, v128.load(columnClass + j, 16));
    for (let k = 0; k < end; k += 4) {
      const value = v128.load32_splat(values + k);
      const row = load<usize>(rows + k) + j;
      a = i32x4.add(a, i32x4.mul(value, v128.load(row)));
      b = i32x4.add(b, i32x4.mul(value, v128.load(row, 16)));
    }
    a = i32x4.max_s(i32x4.min_s(i32x4.shr_s(a, 9), most), none);
    b = i32x4.max_s(i32x4.min_s(i32x4.shr_s(b, 9), most), none);
    v128.store(units + j, a);
    v128.store(units + j, b, 16);
  }
}

/** The probability of a zero, in 1 / 65536, of an output.  All sums are integers below 2^53. */
export function probability(output: i32): i32 {
  const hidden = network.hidden;
  const row = network.last + ((output * (hidden + 2)) << 3);
  let sums = v128.load(row + (hidden << 3));
  for (let j = 0; j < hidden; j += 4) {
    const four = v128.load(units + (j << 2));
    const others = v128.shuffle<i32>(four, four, 2, 3, 2, 3);
    const at = row + (j << 3);
    sums = f64x2.add(sums, f64x2.mul(f64x2.convert_low_i32x4_s(four), v128.load(at)));
    sums = f64x2.add(sums, f64x2.mul(f64x2.convert_low_i32x4_s(others), v128.load(at, 16)));
  }
  const sum = f64x2.extract_lane(sums, 0) + f64x2.extract_lane(sums, 1);
  const logit = <i32>floor<f64>(sum / 8192);
  return load<i32>(probabilities + ((min(max(logit, -MAX_LOGIT), MAX_LOGIT) + MAX_LOGIT) << 2));
}
