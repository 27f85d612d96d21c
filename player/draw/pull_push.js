import { emptyRaster } from "./image_filters.js";

/** @typedef {import("./image_filters.js").Raster} Raster */

/**
 * A raster whose unknown pixels are filled smoothly from those around them; see `pull_push_fill`
 * of `shared_model/appearance.py`.
 * @param {Raster} raster
 * @param {Uint8Array} known (height, width)
 * @returns {Raster}
 */
export function pullPushFill(raster, known) {
  const { height, width, channels, values } = raster;
  if (Math.min(height, width) <= 2 || known.every((is) => is)) return filledWithMean(raster, known);
  const { means, isKnown } = halved(raster, known);
  const coarse = pullPushFill(means, isKnown);
  const result = emptyRaster(height, width, channels);
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const at = i * width + j;
      for (let c = 0; c < channels; c++) {
        result.values[at * channels + c] = known[at]
          ? values[at * channels + c]
          : doubled(coarse, i, j, c);
      }
    }
  }
  return result;
}

/**
 * @param {Raster} raster
 * @param {Uint8Array} known
 * @returns {Raster}
 */
function filledWithMean(raster, known) {
  const { channels, values } = raster;
  const sums = new Float64Array(channels);
  let count = 0;
  for (const [at, is] of known.entries()) {
    if (!is) continue;
    count++;
    for (let c = 0; c < channels; c++) sums[c] += values[at * channels + c];
  }
  const filled = values.map((value, i) =>
    known[Math.floor(i / channels)] ? value : sums[i % channels] / Math.max(count, 1),
  );
  return { ...raster, values: filled };
}

/**
 * The means of the known pixels of 2 x 2, and where there are any.
 * @param {Raster} raster
 * @param {Uint8Array} known
 */
function halved({ height, width, channels, values }, known) {
  const means = emptyRaster(Math.ceil(height / 2), Math.ceil(width / 2), channels);
  const counts = new Uint8Array(means.height * means.width);
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const from = i * width + j;
      if (!known[from]) continue;
      const to = (i >> 1) * means.width + (j >> 1);
      counts[to]++;
      for (let c = 0; c < channels; c++)
        means.values[to * channels + c] += values[from * channels + c];
    }
  }
  means.values.forEach((sum, i) => {
    means.values[i] = sum / Math.max(counts[Math.floor(i / channels)], 1);
  });
  return { means, isKnown: counts.map((count) => (count ? 1 : 0)) };
}

/**
 * A value of a raster of twice the size: bilinear, edges repeated.
 * @param {Raster} coarse
 * @param {number} i
 * @param {number} j
 * @param {number} c
 */
function doubled({ height, width, channels, values }, i, j, c) {
  const row = i >> 1;
  const column = j >> 1;
  const otherRow = Math.min(Math.max(row + (i % 2 ? 1 : -1), 0), height - 1);
  const otherColumn = Math.min(Math.max(column + (j % 2 ? 1 : -1), 0), width - 1);
  const at = (/** @type {number} */ r, /** @type {number} */ k) =>
    values[(r * width + k) * channels + c];
  const near = 0.75 * at(row, column) + 0.25 * at(row, otherColumn);
  const far = 0.75 * at(otherRow, column) + 0.25 * at(otherRow, otherColumn);
  return 0.75 * near + 0.25 * far;
}
