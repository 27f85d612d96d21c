// The opacity of the person in a picture, from their mask.
import { emptyRaster, gaussian } from "./image_filters.js";

/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */

/** Of a background with layers, see `shared_model/layers/soft_mask.py`. */
const FEATHER_SIGMA = 1.5;
const FEATHER_REACH = 4;
const OPACITY_RANGE = [0.45, 0.9];
/** Of a background with a mask alone, see `decoder/scene/background_layers.py`. */
const ALPHA_RANGE = [0.02, 0.3];

/**
 * @param {Uint8Array} mask (side, side)
 * @param {number} side
 * @returns {import("./image_filters.js").Raster}
 */
function rasterOf(mask, side) {
  return { ...emptyRaster(side, side, 1), values: Float32Array.from(mask) };
}

/**
 * The opacity (height, width), 0..1, of the person of a background with layers.
 * @param {ImageFilters} filters
 * @param {Uint8Array} mask
 * @param {number} side
 * @param {number} height
 * @param {number} width
 */
export function layerOpacity(filters, mask, side, height, width) {
  const { values } = filters.resized(feathered(mask, side), height, width);
  setWithin(values, OPACITY_RANGE);
  return values;
}

/**
 * Values as shares of a range, cut to 0..1.
 * @param {Float32Array} values changed
 * @param {number[]} range
 */
function setWithin(values, [low, high]) {
  for (let i = 0; i < values.length; i++)
    values[i] = Math.min(Math.max((values[i] - low) / (high - low), 0), 1);
}

/**
 * A mask blurred by a short kernel; beyond the ends the last value is repeated.
 * @param {Uint8Array} mask
 * @param {number} side
 */
function feathered(mask, side) {
  const weights = gaussian(FEATHER_SIGMA, FEATHER_REACH);
  const raster = rasterOf(mask, side);
  const line = new Float32Array(side + 2 * FEATHER_REACH);
  for (const [step, next] of [
    [side, 1],
    [1, side],
  ]) {
    for (let i = 0; i < side; i++) featherLine(raster.values, i * next, step, weights, line);
  }
  return raster;
}

/**
 * Blur a row or a column.
 * @param {Float32Array} values changed
 * @param {number} start of the line in them
 * @param {number} step from one of its values to the next
 * @param {Float64Array} weights
 * @param {Float32Array} line room for it, with the last values repeated beyond its ends
 */
function featherLine(values, start, step, weights, line) {
  const side = line.length - 2 * FEATHER_REACH;
  for (let k = 0; k < line.length; k++) {
    const place = Math.min(Math.max(k - FEATHER_REACH, 0), side - 1);
    line[k] = values[start + place * step];
  }
  for (let k = 0; k < side; k++) {
    let sum = 0;
    for (let i = 0; i < weights.length; i++) sum += weights[i] * line[k + i];
    values[start + k * step] = sum;
  }
}

/**
 * Of a background with a mask alone: the opacity (height, width), 0..1, of what moves with the
 * head, and where nothing of it is.
 * @param {ImageFilters} filters
 * @param {Uint8Array} mask
 * @param {number} side
 * @param {number} height
 * @param {number} width
 */
export function maskOpacity(filters, mask, side, height, width) {
  const soft = filters.resized(
    filters.blurred(rasterOf(mask, side), FEATHER_SIGMA),
    height,
    width,
  ).values;
  const isClear = Uint8Array.from(soft, (value) => (value <= ALPHA_RANGE[0] ? 1 : 0));
  setWithin(soft, ALPHA_RANGE);
  return { alpha: soft, isClear };
}
