import { writeColours } from "./colours";
import { allocate } from "./memory";
import { Plane } from "./wavelet";

/** What of a plane is at a pixel of the plane of twice the size: this of the nearer value. */
const NEAR: f32 = 0.75;
const FAR: f32 = 0.25;

/** Write the pixels (height, width, 3) R, G, B float32 of three planes; weights: 0, or (height, width). */
export function writeImage(
  to: usize,
  luma: Plane,
  blues: Plane,
  reds: Plane,
  weights: usize,
  isMode: bool,
): void {
  const width = luma.width;
  const blueLine = allocate((width + 4) << 2);
  const redLine = allocate((width + 4) << 2);
  const half = allocate((blues.width + 2) << 2) + 16;
  const chroma: f32 = isMode ? 1 / <f32>0.3 : 1 / <f32>0.5;
  const offset: f32 = isMode ? 0 : 128;
  for (let i = 0; i < luma.height; i++) {
    enlargeRow(blueLine, half, blues, i);
    enlargeRow(redLine, half, reds, i);
    const start = (i * width) << 2;
    const ofRow = weights ? weights + start : 0;
    writeRow(to + 3 * start, luma.values + start, blueLine, redLine, ofRow, width, chroma, offset);
  }
}

function writeRow(
  to: usize,
  luma: usize,
  blueLine: usize,
  redLine: usize,
  weights: usize,
  width: i32,
  chroma: f32,
  offset: f32,
): void {
  const factor = f32x4.splat(chroma);
  const grey = f32x4.splat(offset);
  for (let at = 0, end = width << 2; at < end; at += 16, to += 48) {
    let y = v128.load(luma + at);
    let blue = v128.load(blueLine + at);
    let red = v128.load(redLine + at);
    if (weights) {
      const weight = v128.load(weights + at);
      y = f32x4.div(y, weight);
      blue = f32x4.div(blue, weight);
      red = f32x4.div(red, weight);
    }
    y = f32x4.add(y, grey);
    writeColours(
      to,
      y,
      f32x4.add(y, f32x4.mul(blue, factor)),
      f32x4.add(y, f32x4.mul(red, factor)),
    );
  }
}

/** Write a row of a plane enlarged to twice its size; half: room for a row, with a value in front. */
function enlargeRow(to: usize, half: usize, plane: Plane, i: i32): void {
  const width = plane.width;
  const near = plane.values + (((i >> 1) * width) << 2);
  const other = min(max((i >> 1) + (i & 1 ? 1 : -1), 0), plane.height - 1);
  const far = plane.values + ((other * width) << 2);
  const a = f32x4.splat(NEAR);
  const b = f32x4.splat(FAR);
  for (let at = 0, end = width << 2; at < end; at += 16) {
    const sum = f32x4.add(f32x4.mul(a, v128.load(near + at)), f32x4.mul(b, v128.load(far + at)));
    v128.store(half + at, sum);
  }
  const last = half + ((width - 1) << 2);
  store<f32>(half - 4, load<f32>(half));
  store<f32>(last + 4, load<f32>(last));
  for (let at = 0, end = width << 2; at < end; at += 16) {
    const own = f32x4.mul(a, v128.load(half + at));
    const left = f32x4.add(own, f32x4.mul(b, v128.load(half + at - 4)));
    const right = f32x4.add(own, f32x4.mul(b, v128.load(half + at + 4)));
    v128.store(to + 2 * at, v128.shuffle<i32>(left, right, 0, 4, 1, 5));
    v128.store(to + 2 * at, v128.shuffle<i32>(left, right, 2, 6, 3, 7), 16);
  }
}
