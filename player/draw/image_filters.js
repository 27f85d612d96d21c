// Filters of planes (height, width, channels), row by row, as OpenCV's of the same names.
import { linearPlaces } from "../format/pictures/linear_places.js";

/**
 * Values (height, width, channels).
 * @typedef {{height: number, width: number, channels: number, values: Float32Array}} Raster
 */

/** From these standard deviations on a blur works on a raster that is so much smaller. */
const REDUCTIONS = [
  { from: 8, by: 8 },
  { from: 4, by: 4 },
  { from: 1, by: 2 },
];

/**
 * @param {number} height
 * @param {number} width
 * @param {number} channels
 * @returns {Raster}
 */
export function emptyRaster(height, width, channels) {
  return { height, width, channels, values: new Float32Array(height * width * channels) };
}

/**
 * Blurred by a Gaussian of a standard deviation, pixels; mirrored at the edges.
 * @param {Raster} raster
 * @param {number} sigma
 * @returns {Raster}
 */
export function blurred(raster, sigma) {
  const isLarge = Math.min(raster.width, raster.height) >= 64;
  const { by } = REDUCTIONS.find(({ from }) => isLarge && sigma >= from) ?? { by: 1 };
  if (by === 1) return convolved(raster, sigma);
  // Reducing and enlarging blur by about these variances themselves.
  const own = (by ** 2 - 1) / 12 + by ** 2 / 6;
  const rest = Math.sqrt(sigma ** 2 - own) / by;
  return resized(convolved(reduced(raster, by), rest), raster.height, raster.width);
}

/**
 * The means of squares of pixels.
 * @param {Raster} raster
 * @param {number} by side of the squares
 */
function reduced({ height, width, channels, values }, by) {
  const result = emptyRaster(Math.ceil(height / by), Math.ceil(width / by), channels);
  for (let i = 0; i < result.height; i++) {
    for (let j = 0; j < result.width; j++) {
      const rows = Math.min(by, height - i * by);
      const columns = Math.min(by, width - j * by);
      const at = (i * result.width + j) * channels;
      for (let k = 0; k < rows; k++) {
        const from = ((i * by + k) * width + j * by) * channels;
        for (let l = 0; l < columns * channels; l++)
          result.values[at + (l % channels)] += values[from + l];
      }
      for (let c = 0; c < channels; c++) result.values[at + c] /= rows * columns;
    }
  }
  return result;
}

/**
 * @param {Raster} raster
 * @param {number} sigma
 */
function convolved(raster, sigma) {
  const kernel = gaussian(sigma, Math.round(sigma * 8 + 1) >> 1);
  return alongColumns(alongRows(raster, kernel), kernel);
}

/**
 * The weights (2 reach + 1) of a Gaussian, whose sum is 1.
 * @param {number} sigma
 * @param {number} reach
 */
export function gaussian(sigma, reach) {
  const weights = Array.from({ length: 2 * reach + 1 }, (_, i) =>
    Math.exp(-((i - reach) ** 2) / (2 * sigma ** 2)),
  );
  const sum = weights.reduce((total, weight) => total + weight);
  return Float64Array.from(weights, (weight) => weight / sum);
}

/**
 * The place within 0..count-1 that a place beyond the ends is mirrored to.
 * @param {number} place
 * @param {number} count
 */
function mirrored(place, count) {
  const last = Math.max(count - 1, 1);
  const at = Math.abs(place) % (2 * last);
  return Math.min(at > last ? 2 * last - at : at, count - 1);
}

/**
 * @param {Raster} raster
 * @param {Float64Array} kernel symmetric
 * @returns {Raster}
 */
function alongRows({ height, width, channels, values }, kernel) {
  const reach = kernel.length >> 1;
  const result = emptyRaster(height, width, channels);
  const line = new Float64Array((width + 2 * reach) * channels);
  const places = Int32Array.from({ length: line.length }, (_, k) => {
    const j = Math.floor(k / channels) - reach;
    return mirrored(j, width) * channels + (k % channels);
  });
  const size = width * channels;
  const far = 2 * reach * channels;
  for (let i = 0; i < height; i++) {
    for (let k = 0; k < line.length; k++) line[k] = values[i * size + places[k]];
    for (let k = 0; k < size; k++) {
      let sum = kernel[reach] * line[k + reach * channels];
      for (let t = 0, at = k, other = k + far; t < reach; t++, at += channels, other -= channels) {
        sum += kernel[t] * (line[at] + line[other]);
      }
      result.values[i * size + k] = sum;
    }
  }
  return result;
}

/**
 * @param {Raster} raster
 * @param {Float64Array} kernel symmetric
 * @returns {Raster}
 */
function alongColumns({ height, width, channels, values }, kernel) {
  const reach = kernel.length >> 1;
  const result = emptyRaster(height, width, channels);
  const size = width * channels;
  const sums = new Float64Array(size);
  for (let i = 0; i < height; i++) {
    for (let k = 0; k < size; k++) sums[k] = kernel[reach] * values[i * size + k];
    for (let t = 1; t <= reach; t++) {
      const weight = kernel[reach + t];
      const above = mirrored(i - t, height) * size;
      const below = mirrored(i + t, height) * size;
      for (let k = 0; k < size; k++) sums[k] += weight * (values[above + k] + values[below + k]);
    }
    result.values.set(sums, i * size);
  }
  return result;
}

/**
 * Resized, each value from the middles of the nearest ones linearly, edges repeated.
 * @param {Raster} raster
 * @param {number} height
 * @param {number} width
 * @returns {Raster}
 */
export function resized(raster, height, width) {
  if (raster.height === height && raster.width === width) return raster;
  const rows = linearPlaces(height, raster.height);
  const columns = linearPlaces(width, raster.width);
  const { channels, values } = raster;
  const across = emptyRaster(raster.height, width, channels);
  for (let i = 0, to = 0; i < raster.height; i++) {
    for (let j = 0; j < width; j++) {
      const left = (i * raster.width + columns.low[j]) * channels;
      const right = (i * raster.width + columns.high[j]) * channels;
      for (let c = 0; c < channels; c++, to++) {
        across.values[to] =
          values[left + c] + columns.part[j] * (values[right + c] - values[left + c]);
      }
    }
  }
  const result = emptyRaster(height, width, channels);
  const size = width * channels;
  for (let i = 0; i < height; i++) {
    const top = rows.low[i] * size;
    const bottom = rows.high[i] * size;
    for (let k = 0; k < size; k++) {
      const upper = across.values[top + k];
      result.values[i * size + k] = upper + rows.part[i] * (across.values[bottom + k] - upper);
    }
  }
  return result;
}

/**
 * The greatest values within a square of an odd side around each; of `sign` -1 the least ones.
 * @param {Raster} raster
 * @param {number} side
 * @param {1 | -1} sign
 * @returns {Raster}
 */
export function extremes({ height, width, channels, values }, side, sign) {
  const reach = side >> 1;
  const size = (width + 2 * reach) * channels;
  // Padded all around; each value becomes the greatest of those from it on, right, then down.
  const found = new Float32Array((height + 2 * reach) * size).fill(-Infinity);
  const start = reach * size + reach * channels;
  for (let i = 0, from = 0; i < height; i++) {
    for (let k = 0; k < width * channels; k++, from++)
      found[start + i * size + k] = sign * values[from];
  }
  greatestFrom(found, channels, side);
  greatestFrom(found, size, side);
  const result = emptyRaster(height, width, channels);
  for (let i = 0, to = 0; i < height; i++) {
    for (let k = 0; k < width * channels; k++, to++) result.values[to] = sign * found[i * size + k];
  }
  return result;
}

/**
 * Each value becomes the greatest of so many, a step apart, from it on.
 * @param {Float32Array} values changed
 * @param {number} step
 * @param {number} count
 */
function greatestFrom(values, step, count) {
  for (let known = 1; known < count; ) {
    const more = Math.min(known, count - known);
    const end = values.length - more * step;
    for (let k = 0; k < end; k++) {
      const other = values[k + more * step];
      if (other > values[k]) values[k] = other;
    }
    known += more;
  }
}
