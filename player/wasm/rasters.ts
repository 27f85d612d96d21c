// Filters of rasters, float32 row by row, as OpenCV's of the same names.
import { allocate, mark, release } from "./memory";

declare function exp(x: f64): f64;

/** Values (height, width) float32. */
@unmanaged
export class Raster {
  height: i32;
  width: i32;
  values: usize;

  /** Bytes of the values. */
  bytes(): usize {
    return (this.height * this.width) << 2;
  }
}

/** A raster with whatever is in memory. */
export function newRaster(height: i32, width: i32): Raster {
  const raster = changetype<Raster>(allocate(offsetof<Raster>()));
  raster.height = height;
  raster.width = width;
  raster.values = allocate(raster.bytes());
  return raster;
}

/** By how much smaller a raster is on which a blur of a standard deviation works. */
function reductionOf(raster: Raster, sigma: f64): i32 {
  if (min(raster.height, raster.width) < 64) return 1;
  if (sigma >= 8) return 8;
  if (sigma >= 4) return 4;
  return sigma >= 1 ? 2 : 1;
}

/** Write a raster blurred by a Gaussian of a standard deviation, pixels; mirrored at the edges. */
export function blur(raster: Raster, sigma: f64, result: Raster): void {
  const before = mark();
  const by = reductionOf(raster, sigma);
  if (by === 1) {
    convolve(raster, sigma, result);
  } else {
    // Reducing and enlarging blur by about these variances themselves.
    const own = <f64>(by * by - 1) / 12 + <f64>(by * by) / 6;
    const small = newRaster((raster.height + by - 1) / by, (raster.width + by - 1) / by);
    const soft = newRaster(small.height, small.width);
    reduce(raster, by, small);
    convolve(small, sqrt<f64>(sigma * sigma - own) / by, soft);
    resize(soft, result);
  }
  release(before);
}

/** Write the means of squares of pixels. */
function reduce(raster: Raster, by: i32, result: Raster): void {
  const width = raster.width;
  const sums = allocate(width << 2);
  for (let i = 0; i < result.height; i++) {
    const first = i * by;
    const rows = min(by, raster.height - first);
    const from = raster.values + ((first * width) << 2);
    memory.copy(sums, from, width << 2);
    for (let k = 1; k < rows; k++) addRow(sums, from + ((k * width) << 2), width, 1);
    const to = result.values + ((i * result.width) << 2);
    for (let j = 0; j < result.width; j++) {
      const columns = min(by, width - j * by);
      let sum: f32 = 0;
      for (let k = 0; k < columns; k++) sum += load<f32>(sums + ((j * by + k) << 2));
      store<f32>(to + (j << 2), sum / <f32>(rows * columns));
    }
  }
}

/** Add a row, times a weight, to another one. */
function addRow(to: usize, from: usize, width: i32, weight: f32): void {
  const weights = f32x4.splat(weight);
  for (let at = 0, end = width << 2; at < end; at += 16) {
    const more = f32x4.mul(weights, v128.load(from + at));
    v128.store(to + at, f32x4.add(v128.load(to + at), more));
  }
}

/** The weights of a Gaussian from its middle on to `reach`, of which all have the sum 1. */
function gaussian(sigma: f64, reach: i32): usize {
  const weights = allocate((reach + 1) << 2);
  let sum: f64 = 1;
  for (let k = 1; k <= reach; k++) sum += 2 * exp(-(<f64>(k * k)) / (2 * sigma * sigma));
  for (let k = 0; k <= reach; k++) {
    const weight = exp(-(<f64>(k * k)) / (2 * sigma * sigma)) / sum;
    store<f32>(weights + (k << 2), <f32>weight);
  }
  return weights;
}

/** The place within 0 to count - 1 that a place beyond the ends is mirrored to. */
function mirrored(place: i32, count: i32): i32 {
  const last = max(count - 1, 1);
  const at = abs(place) % (2 * last);
  return min(at > last ? 2 * last - at : at, count - 1);
}

function convolve(raster: Raster, sigma: f64, result: Raster): void {
  const reach = <i32>nearest<f64>(sigma * 8 + 1) >> 1;
  const weights = gaussian(sigma, reach);
  const across = newRaster(raster.height, raster.width);
  convolveRows(raster, weights, reach, across);
  convolveColumns(across, weights, reach, result);
}

function convolveRows(raster: Raster, weights: usize, reach: i32, result: Raster): void {
  const width = raster.width;
  const line = allocate((width + 2 * reach) << 2);
  const middle = line + (reach << 2);
  for (let i = 0; i < raster.height; i++) {
    const from = raster.values + ((i * width) << 2);
    const to = result.values + ((i * width) << 2);
    memory.copy(middle, from, width << 2);
    for (let k = 1; k <= reach; k++) {
      store<f32>(middle - (k << 2), load<f32>(from + (mirrored(-k, width) << 2)));
      const beyond = width - 1 + k;
      store<f32>(middle + (beyond << 2), load<f32>(from + (mirrored(beyond, width) << 2)));
    }
    for (let at = 0, end = width << 2; at < end; at += 16) {
      let sum = f32x4.mul(v128.load32_splat(weights), v128.load(middle + at));
      for (let k = 4; k <= reach << 2; k += 4) {
        const pair = f32x4.add(v128.load(middle + at - k), v128.load(middle + at + k));
        sum = f32x4.add(sum, f32x4.mul(v128.load32_splat(weights + k), pair));
      }
      v128.store(to + at, sum);
    }
  }
}

function convolveColumns(raster: Raster, weights: usize, reach: i32, result: Raster): void {
  const height = raster.height;
  const row = raster.width << 2;
  const from = raster.values;
  const sums = allocate(row);
  for (let i = 0; i < height; i++) {
    memory.fill(sums, 0, row);
    addRow(sums, from + i * row, raster.width, load<f32>(weights));
    for (let k = 1; k <= reach; k++) {
      const weight = load<f32>(weights + (k << 2));
      addRow(sums, from + mirrored(i - k, height) * row, raster.width, weight);
      addRow(sums, from + mirrored(i + k, height) * row, raster.width, weight);
    }
    memory.copy(result.values + i * row, sums, row);
  }
}

/** Where of `known` values in a line the middle of a sample of `count` ones is. */
function placeOf(sample: i32, count: i32, known: i32): f64 {
  const at = ((<f64>sample + 0.5) * <f64>known) / <f64>count - 0.5;
  return min(max(at, 0), <f64>(known - 1));
}

/** Write a raster in another size, each value from the middles of the nearest ones linearly. */
export function resize(raster: Raster, result: Raster): void {
  const before = mark();
  const width = result.width;
  const line = allocate((raster.width + 1) << 2);
  const lows = allocate(width << 2);
  const parts = allocate(width << 2);
  for (let j = 0; j < width; j++) {
    const at = placeOf(j, width, raster.width);
    store<i32>(lows + (j << 2), (<i32>at) << 2);
    store<f32>(parts + (j << 2), <f32>(at - floor<f64>(at)));
  }
  for (let i = 0; i < result.height; i++) {
    const at = placeOf(i, result.height, raster.height);
    mixRows(line, raster, <i32>at, <f32>(at - floor<f64>(at)));
    const to = result.values + ((i * width) << 2);
    for (let j = 0; j < width << 2; j += 4) {
      const left = line + load<i32>(lows + j);
      const value = load<f32>(left);
      store<f32>(to + j, value + load<f32>(parts + j) * (load<f32>(left + 4) - value));
    }
  }
  release(before);
}

/** Write a row between two of a raster, its last value twice. */
function mixRows(line: usize, raster: Raster, low: i32, part: f32): void {
  const width = raster.width;
  const upper = raster.values + ((low * width) << 2);
  const lower = raster.values + ((min(low + 1, raster.height - 1) * width) << 2);
  const parts = f32x4.splat(part);
  for (let at = 0, end = width << 2; at < end; at += 16) {
    const value = v128.load(upper + at);
    const more = f32x4.mul(parts, f32x4.sub(v128.load(lower + at), value));
    v128.store(line + at, f32x4.add(value, more));
  }
  store<f32>(line + (width << 2), load<f32>(line + ((width - 1) << 2)));
}

/** Write the greatest values within a square of an odd side around each; of `sign` -1 the least ones. */
export function extremes(raster: Raster, side: i32, sign: f32, result: Raster): void {
  const before = mark();
  const reach = side >> 1;
  // Padded all around; each value becomes the greatest of those from it on, right, then down.
  const padded = newRaster(raster.height + 2 * reach, raster.width + 2 * reach);
  const row = padded.width << 2;
  const least = f32x4.splat(-Infinity);
  for (let at = 0; <usize>at < padded.bytes() + 16; at += 16) v128.store(padded.values + at, least);
  const size = raster.width << 2;
  for (let i = 0; i < raster.height; i++) {
    const to = padded.values + (reach + i) * row + (reach << 2);
    scaleInto(to, raster.values + i * size, raster.width, sign);
  }
  greatestFrom(padded, 4, side);
  greatestFrom(padded, row, side);
  for (let i = 0; i < raster.height; i++) {
    const from = padded.values + i * row;
    for (let at = 0; at < size; at += 16)
      v128.store(result.values + i * size + at, f32x4.mul(f32x4.splat(sign), v128.load(from + at)));
  }
  release(before);
}

/** Write exactly so many values, times a factor. */
function scaleInto(to: usize, from: usize, count: i32, factor: f32): void {
  for (let at = 0; at < count << 2; at += 4) store<f32>(to + at, factor * load<f32>(from + at));
}

/** Each value becomes the greatest of so many, a step apart, from it on. */
function greatestFrom(raster: Raster, step: i32, count: i32): void {
  const first = raster.values;
  for (let known = 1; known < count; ) {
    const more = min(known, count - known);
    const end = first + raster.bytes() - more * step;
    for (let at = first; at < end; at += 16)
      v128.store(at, f32x4.pmax(v128.load(at), v128.load(at + more * step)));
    known += more;
  }
}
