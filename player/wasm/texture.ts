// The texture of a frame: a mean and modes times their coefficients, within the colours nearby.
import { greenOf, splitColours } from "./colours";
import { allocate, mark, release } from "./memory";

/** Of a model, see docs/format.md. */
const MAX_MODES: i32 = 64;
/** See `decoder/rendering/texture_colour.py`. */
const SLACK_GREY: f32 = 2;
const OPAQUE: i32 = 0xff000000;

let texels: i32 = 0;
let mean: usize = 0;
/** Colour differences (texels, 2) per unit of luma within which colours stay. */
let low: usize = 0;
let high: usize = 0;
let drawn: usize = 0;
let coefficients: usize = 0;
/** Addresses of the modes. */
let places: usize = 0;
let modes: i32 = 0;
/** Four texels, R, G, B each, then their luma and colour differences: 24 values. */
let four: usize = 0;
let start: usize = 0;

/** Where a mean (ofTexels, 3) has to be written, float32; there are no modes then. */
export function meanAt(ofTexels: i32): usize {
  if (!start) start = mark();
  release(start);
  texels = ofTexels;
  modes = 0;
  mean = allocate((3 * texels) << 2);
  low = allocate((4 * texels) << 2);
  high = low + ((2 * texels) << 2);
  drawn = allocate(texels << 2);
  coefficients = allocate(MAX_MODES << 2);
  places = allocate(MAX_MODES << 2);
  four = allocate(24 << 2);
  return mean;
}

/** Where the least colour differences (texels, 2) have to be written, float32, and then the greatest. */
export function limitsAt(): usize {
  return low;
}

/** Where the next mode (texels, 3) has to be written, float32. */
export function modeAt(): usize {
  const at = allocate((3 * texels) << 2);
  if (modes >= MAX_MODES) unreachable();
  store<usize>(places + (modes++ << 2), at);
  return at;
}

/** Where the coefficients of the modes have to be written, float32. */
export function coefficientsAt(): usize {
  return coefficients;
}

/** Address of the texture (texels, 4), R, G, B and alpha. */
export function synthesise(isLimited: bool): usize {
  for (let k = 0; k < texels; k += 4) {
    addModes(12 * k);
    const luma = four + 48;
    const blues = luma + 16;
    const reds = luma + 32;
    splitColours(four, luma, blues, reds);
    const y = v128.load(luma);
    let blue = v128.load(blues);
    let red = v128.load(reds);
    if (isLimited) {
      const bright = f32x4.max(y, f32x4.splat(0));
      const least = low + 8 * k;
      const most = high + 8 * k;
      blue = within(blue, bright, everySecond(least, false), everySecond(most, false));
      red = within(red, bright, everySecond(least, true), everySecond(most, true));
    }
    v128.store(drawn + 4 * k, bytesOf(y, blue, red));
  }
  return drawn;
}

/** Write the mean and the modes times their coefficients at four texels, R, G, B each. */
function addModes(at: usize): void {
  let a = v128.load(mean + at);
  let b = v128.load(mean + at, 16);
  let c = v128.load(mean + at, 32);
  for (let k = 0; k < modes; k++) {
    const coefficient = v128.load32_splat(coefficients + (k << 2));
    const mode = load<usize>(places + (k << 2)) + at;
    a = f32x4.add(a, f32x4.mul(coefficient, v128.load(mode)));
    b = f32x4.add(b, f32x4.mul(coefficient, v128.load(mode, 16)));
    c = f32x4.add(c, f32x4.mul(coefficient, v128.load(mode, 32)));
  }
  v128.store(four, a);
  v128.store(four, b, 16);
  v128.store(four, c, 32);
}

/** Four of eight values. */
function everySecond(at: usize, isOdd: bool): v128 {
  const a = v128.load(at);
  const b = v128.load(at, 16);
  return isOdd ? v128.shuffle<i32>(a, b, 1, 3, 5, 7) : v128.shuffle<i32>(a, b, 0, 2, 4, 6);
}

function within(difference: v128, bright: v128, least: v128, most: v128): v128 {
  const slack = f32x4.splat(SLACK_GREY);
  const lowest = f32x4.sub(f32x4.mul(least, bright), slack);
  const highest = f32x4.add(f32x4.mul(most, bright), slack);
  return f32x4.min(f32x4.max(difference, lowest), highest);
}

/** Four texels of luma and colour differences: R, G, B and alpha. */
function bytesOf(y: v128, blueLess: v128, redLess: v128): v128 {
  const blue = f32x4.add(y, blueLess);
  const red = f32x4.add(y, redLess);
  const green = greenOf(y, blue, red);
  const bytes = v128.or(rounded(red), i32x4.shl(rounded(green), 8));
  return v128.or(v128.or(bytes, i32x4.shl(rounded(blue), 16)), i32x4.splat(OPAQUE));
}

/** Grey levels, cut to 0..255. */
function rounded(values: v128): v128 {
  const whole = i32x4.trunc_sat_f32x4_u(f32x4.add(values, f32x4.splat(0.5)));
  return i32x4.min_u(whole, i32x4.splat(255));
}
