// Filters of the textures of a caller as the player calls them.  What is handed out is valid until
// the next call.
import { cover, place } from "./atlas";
import { splitColours, writeColours } from "./colours";
import { allocate, mark, release } from "./memory";
import { blur, extremes, newRaster, Raster, resize } from "./rasters";

/** See `player/draw/local_colours.js`. */
const REACH: f64 = 1 / 12.0;
const NEAR: f64 = 1 / 48.0;
const MIN_LUMA: f32 = 12;
const BRIGHT: f32 = 0.6;
const SHARE: f32 = 0.6;
const BRIGHT_SHARE: f32 = 0.3;
const SENT_SHARE: f32 = 0.5;
const SENT_REACH: f64 = 2;
const COARSE: f64 = 1;
const FREE: f32 = 1e3;
const LEAST: f32 = 1e-3;
const PARTS: i32 = 2;

const NONE: Raster = changetype<Raster>(0);

let given: Raster = NONE;
/** The mean texture or the mode that has been given (size, size, 3), and which part a texel is of. */
let image: usize = 0;
let size: i32 = 0;
let parts: usize = 0;
/** The colour differences per unit of luma that the modes of a mean are expected to have. */
let expectedBlues: Raster = NONE;
let expectedReds: Raster = NONE;
/** End of what stays from one call to the next. */
let kept: usize = 0;

/** See `place` and `cover` of `atlas.ts`. */
export function cornersAt(count: i32, ofSize: i32): usize {
  if (!kept) kept = mark();
  release(kept);
  return place(count, ofSize);
}

export function covered(): usize {
  return cover();
}

/** Where a raster (height, width) has to be written. */
export function rasterOf(height: i32, width: i32): usize {
  if (!kept) kept = mark();
  release(kept);
  given = newRaster(height, width);
  return given.values;
}

/** Address of the raster blurred by a Gaussian of a standard deviation. */
export function blurred(sigma: f64): usize {
  const result = newRaster(given.height, given.width);
  blur(given, sigma, result);
  return result.values;
}

/** Address of the raster in another size. */
export function resized(height: i32, width: i32): usize {
  const result = newRaster(height, width);
  resize(given, result);
  return result.values;
}

/** Where a mean texture (ofSize, ofSize, 3) has to be written, float32; its modes come after it. */
export function meanOf(ofSize: i32): usize {
  if (!kept) kept = mark();
  release(first());
  size = ofSize;
  expectedBlues = newSquare();
  expectedReds = newSquare();
  memory.fill(expectedBlues.values, 0, expectedBlues.bytes());
  memory.fill(expectedReds.values, 0, expectedReds.bytes());
  kept = mark();
  return modeAt();
}

/** Where a mode (size, size, 3) has to be written, float32. */
export function modeAt(): usize {
  release(kept);
  image = allocate((3 * size * size) << 2);
  return image;
}

/** Where the parts (size, size) of a mean have to be written, uint8: 1 and 2 are coloured. */
export function partsAt(): usize {
  parts = allocate(size * size);
  return parts;
}

function first(): usize {
  return changetype<usize>(expectedBlues) ? changetype<usize>(expectedBlues) : kept;
}

function newSquare(): Raster {
  return newRaster(size, size);
}

/** Rasters of luma, blue difference and red difference. */
@unmanaged
class Planes {
  luma: Raster;
  blues: Raster;
  reds: Raster;
}

function newPlanes(): Planes {
  const planes = changetype<Planes>(allocate(offsetof<Planes>()));
  planes.luma = newSquare();
  planes.blues = newSquare();
  planes.reds = newSquare();
  return planes;
}

function split(): Planes {
  const planes = newPlanes();
  for (let at = 0, end = (size * size) << 2; at < end; at += 16) {
    const luma = planes.luma.values + at;
    splitColours(image + 3 * at, luma, planes.blues.values + at, planes.reds.values + at);
  }
  return planes;
}

function blurPlanes(planes: Planes, sigma: f64): Planes {
  const soft = newPlanes();
  blur(planes.luma, sigma, soft.luma);
  blur(planes.blues, sigma, soft.blues);
  blur(planes.reds, sigma, soft.reds);
  return soft;
}

/** Address of the least colour differences (size, size, 2) of the mean per unit of luma; the greatest follow. */
export function limits(): usize {
  const texels = size * size;
  const low = allocate((4 * texels) << 2);
  const high = low + ((2 * texels) << 2);
  for (let at = 0; at < (2 * texels) << 2; at += 4) {
    store<f32>(low + at, -FREE);
    store<f32>(high + at, FREE);
  }
  const planes = split();
  const coarse = blurPlanes(planes, COARSE);
  for (let part = 1; part <= PARTS; part++) enterPart(part, planes, coarse, low, high);
  return low;
}

/** Enter the colours around the texels of a part. */
function enterPart(part: i32, planes: Planes, coarse: Planes, low: usize, high: usize): void {
  const before = mark();
  const isPart = newSquare();
  const own = newPlanes();
  for (let k = 0; k < size * size; k++) {
    const at = k << 2;
    const is = <i32>load<u8>(parts + k) === part;
    store<f32>(isPart.values + at, is ? 1 : 0);
    store<f32>(own.luma.values + at, is ? load<f32>(planes.luma.values + at) : 0);
    store<f32>(own.blues.values + at, is ? load<f32>(planes.blues.values + at) : 0);
    store<f32>(own.reds.values + at, is ? load<f32>(planes.reds.values + at) : 0);
  }
  const around = blurPlanes(own, REACH * <f64>size);
  const count = newSquare();
  blur(isPart, REACH * <f64>size, count);
  const isSeen = findSeen(isPart, count, around, coarse);
  const shares = newSquare();
  for (let at: usize = 0; at < shares.bytes(); at += 4)
    store<f32>(shares.values + at, load<f32>(isSeen.values + at) > 0 ? BRIGHT_SHARE : SHARE);
  const share = newSquare();
  blur(shares, SENT_REACH, share);
  enterColour(
    isPart,
    isSeen,
    share,
    around.blues,
    coarse.blues,
    coarse.luma,
    expectedBlues,
    low,
    high,
  );
  enterColour(
    isPart,
    isSeen,
    share,
    around.reds,
    coarse.reds,
    coarse.luma,
    expectedReds,
    low + 4,
    high + 4,
  );
  release(before);
}

/** Where the colour of a part can be seen; sums around become colour differences per unit of luma. */
function findSeen(isPart: Raster, count: Raster, around: Planes, coarse: Planes): Raster {
  const isSeen = newSquare();
  for (let at: usize = 0; at < isPart.bytes(); at += 4) {
    const sum = max(load<f32>(count.values + at), LEAST);
    const luma = load<f32>(around.luma.values + at) / sum;
    const own = load<f32>(coarse.luma.values + at);
    const is = load<f32>(isPart.values + at) > 0 && own > BRIGHT * luma;
    store<f32>(isSeen.values + at, is ? 1 : 0);
    const unit = <f32>1 / (sum * max(luma, MIN_LUMA));
    store<f32>(around.blues.values + at, unit * load<f32>(around.blues.values + at));
    store<f32>(around.reds.values + at, unit * load<f32>(around.reds.values + at));
  }
  return isSeen;
}

/** Enter what a colour difference of a part is expected to be, and its limits, which are every other value. */
function enterColour(
  isPart: Raster,
  isSeen: Raster,
  share: Raster,
  around: Raster,
  coarse: Raster,
  luma: Raster,
  expected: Raster,
  low: usize,
  high: usize,
): void {
  const before = mark();
  const seen = newSquare();
  for (let at: usize = 0; at < seen.bytes(); at += 4) {
    const colour = load<f32>(coarse.values + at) / max(load<f32>(luma.values + at), MIN_LUMA);
    const usual = SHARE * load<f32>(around.values + at);
    store<f32>(seen.values + at, load<f32>(isSeen.values + at) > 0 ? colour : usual);
  }
  const side = 2 * <i32>nearest<f64>(NEAR * <f64>size) + 1;
  const least = newSquare();
  const most = newSquare();
  extremes(seen, side, -1, least);
  extremes(seen, side, 1, most);
  for (let at: usize = 0; at < seen.bytes(); at += 4) {
    if (load<f32>(isPart.values + at) === 0) continue;
    const own = load<f32>(around.values + at);
    store<f32>(expected.values + at, load<f32>(share.values + at) * own);
    store<f32>(low + 2 * at, min(load<f32>(least.values + at), SHARE * own));
    store<f32>(high + 2 * at, max(load<f32>(most.values + at), SHARE * own));
  }
  release(before);
}

/** Give the mode that has been written colour where none has been sent. */
export function complete(): void {
  const planes = split();
  const coarse = newSquare();
  blur(planes.luma, COARSE, coarse);
  // How strong the colour is that has been sent, and that which is expected.
  const sent = newSquare();
  const expected = newSquare();
  for (let at: usize = 0; at < sent.bytes(); at += 16) {
    const blue = v128.load(planes.blues.values + at);
    const red = v128.load(planes.reds.values + at);
    v128.store(sent.values + at, lengthOf(blue, red));
    const luma = v128.load(coarse.values + at);
    const wantedBlue = f32x4.mul(luma, v128.load(expectedBlues.values + at));
    const wantedRed = f32x4.mul(luma, v128.load(expectedReds.values + at));
    v128.store(expected.values + at, lengthOf(wantedBlue, wantedRed));
  }
  const sentAround = newSquare();
  const expectedAround = newSquare();
  blur(sent, SENT_REACH, sentAround);
  blur(expected, SENT_REACH, expectedAround);
  const none = f32x4.splat(0);
  const one = f32x4.splat(1);
  for (let at: usize = 0; at < sent.bytes(); at += 16) {
    const wanted = f32x4.mul(f32x4.splat(SENT_SHARE), v128.load(expectedAround.values + at));
    const known = f32x4.div(
      v128.load(sentAround.values + at),
      f32x4.max(wanted, f32x4.splat(LEAST)),
    );
    const share = f32x4.min(f32x4.max(f32x4.sub(one, known), none), one);
    const missing = f32x4.mul(share, v128.load(coarse.values + at));
    const y = v128.load(planes.luma.values + at);
    const moreBlue = f32x4.mul(missing, v128.load(expectedBlues.values + at));
    const moreRed = f32x4.mul(missing, v128.load(expectedReds.values + at));
    const blue = f32x4.add(f32x4.add(y, v128.load(planes.blues.values + at)), moreBlue);
    const red = f32x4.add(f32x4.add(y, v128.load(planes.reds.values + at)), moreRed);
    writeColours(image + 3 * at, y, blue, red);
  }
}

function lengthOf(x: v128, y: v128): v128 {
  return f32x4.sqrt(f32x4.add(f32x4.mul(x, x), f32x4.mul(y, y)));
}
