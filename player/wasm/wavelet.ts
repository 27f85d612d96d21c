import { bandOf, Grid, LEVELS, Pyramid } from "./grids";
import { allocate } from "./memory";

const GAIN: f32 = 1.149604398860241;
/** The lifting steps: how much of its neighbours a value gets, low ones and high ones in turn. */
const STEPS: i32 = 4;
const factors: usize = memory.data<f32>([
  -0.443506852043971, -0.882911075530934, 0.052980118572961, 1.586134342059924,
]);
/** A value is reconstructed nearer to zero than the middle of its interval, by so many steps. */
const BIAS: f32 = 0.05;

/** Values (height, width) float32. */
@unmanaged
export class Plane {
  height: i32;
  width: i32;
  values: usize;
}

export function newPlane(height: i32, width: i32): Plane {
  const plane = changetype<Plane>(allocate(offsetof<Plane>()));
  plane.height = height;
  plane.width = width;
  plane.values = allocate((height * width) << 2);
  return plane;
}

/** The plane of quantised coefficients, see docs/format.md, Wavelets. */
export function planeOf(pyramid: Pyramid, step: f32): Plane {
  const lowpass = bandOf(pyramid, 0, 0);
  let plane = newPlane(lowpass.height, lowpass.width);
  for (let i = 0; i < plane.height; i++)
    enterRow(plane.values + ((i * plane.width) << 2), lowpass, i, step, 0);
  for (let level = 1; level <= LEVELS; level++) plane = finer(plane, pyramid, level, step);
  return plane;
}

/** The plane of the next level. */
function finer(coarse: Plane, pyramid: Pyramid, level: i32, step: f32): Plane {
  const across = bandOf(pyramid, level, 0);
  const down = bandOf(pyramid, level, 1);
  const both = bandOf(pyramid, level, 2);
  // A line of one sample alone has no high values, and is not scaled.
  const columnGain: f32 = across.width ? GAIN : 1;
  const rowGain: f32 = down.height ? GAIN : 1;
  const plane = newPlane(coarse.height + down.height, coarse.width + across.width);
  // Either half of a row, with a value in front.
  const low = allocate((coarse.width + 2) << 2) + 16;
  const high = allocate((across.width + 2) << 2) + 16;
  for (let i = 0; i < plane.height; i++) {
    if (i & 1) {
      enterRow(low, down, i >> 1, (step * rowGain) / columnGain, BIAS);
      enterRow(high, both, i >> 1, step * rowGain * columnGain, BIAS);
    } else {
      const from = coarse.values + (((i >> 1) * coarse.width) << 2);
      scaleRow(low, from, coarse.width, 1 / (rowGain * columnGain));
      enterRow(high, across, i >> 1, (step * columnGain) / rowGain, BIAS);
    }
    if (across.width) liftRow(low, coarse.width, high, across.width);
    interleave(plane.values + ((i * plane.width) << 2), low, high, coarse.width);
  }
  if (down.height) liftColumns(plane);
  return plane;
}

/** Write a row of a subband, times a step. */
function enterRow(to: usize, band: Grid, i: i32, step: f32, bias: f32): void {
  if (!band.hasValues) {
    memory.fill(to, 0, band.width << 2);
    return;
  }
  const none = i32x4.splat(0);
  const toZero = f32x4.splat(bias);
  const size = f32x4.splat(step);
  const from = band.at(i, 0);
  for (let at = 0, end = band.width << 2; at < end; at += 16) {
    const codes = v128.load(from + at);
    const above = v128.and(toZero, i32x4.gt_s(codes, none));
    const below = v128.and(toZero, i32x4.lt_s(codes, none));
    const values = f32x4.add(f32x4.sub(f32x4.convert_i32x4_s(codes), above), below);
    v128.store(to + at, f32x4.mul(size, values));
  }
}

function scaleRow(to: usize, from: usize, width: i32, gain: f32): void {
  const gains = f32x4.splat(gain);
  for (let at = 0, end = width << 2; at < end; at += 16)
    v128.store(to + at, f32x4.mul(gains, v128.load(from + at)));
}

/** Undo the lifting of a row in two halves; mirrored at the ends. */
function liftRow(low: usize, lows: i32, high: usize, highs: i32): void {
  const lastLow = low + ((lows - 1) << 2);
  const lastHigh = high + ((highs - 1) << 2);
  for (let step = 0; step < STEPS; step++) {
    const factor = load<f32>(factors + (step << 2));
    if (step & 1) {
      store<f32>(lastLow + 4, load<f32>(lastLow));
      lift(high, low, low + 4, highs, factor);
    } else {
      store<f32>(lastHigh + 4, load<f32>(lastHigh));
      store<f32>(high - 4, load<f32>(high));
      lift(low, high - 4, high, lows, factor);
    }
  }
}

/** Add to values the sums of two others, times a factor. */
function lift(to: usize, before: usize, after: usize, count: i32, factor: f32): void {
  const factors = f32x4.splat(factor);
  const whole = (count & ~3) << 2;
  for (let at = 0; at < whole; at += 16) {
    const sums = f32x4.add(v128.load(before + at), v128.load(after + at));
    v128.store(to + at, f32x4.add(v128.load(to + at), f32x4.mul(factors, sums)));
  }
  for (let at = whole; at < count << 2; at += 4) {
    const sum = load<f32>(before + at) + load<f32>(after + at);
    store<f32>(to + at, load<f32>(to + at) + factor * sum);
  }
}

/** Write a row of its halves; a vector beyond its end is written as well. */
function interleave(to: usize, low: usize, high: usize, lows: i32): void {
  for (let at = 0, end = lows << 2; at < end; at += 16) {
    const a = v128.load(low + at);
    const b = v128.load(high + at);
    v128.store(to + 2 * at, v128.shuffle<i32>(a, b, 0, 4, 1, 5));
    v128.store(to + 2 * at, v128.shuffle<i32>(a, b, 2, 6, 3, 7), 16);
  }
}

/** Undo the lifting of columns; mirrored at the ends. */
function liftColumns(plane: Plane): void {
  const height = plane.height;
  const width = plane.width;
  const values = plane.values;
  const row = width << 2;
  for (let step = 0; step < STEPS; step++) {
    const factor = load<f32>(factors + (step << 2));
    for (let i = step & 1; i < height; i += 2) {
      const before = (i ? i - 1 : 1) * row;
      const after = (i + 1 < height ? i + 1 : i - 1) * row;
      lift(values + i * row, values + before, values + after, width, factor);
    }
  }
}
