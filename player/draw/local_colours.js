// The colour of a texture where what was sent does not tell; see
// `decoder/rendering/texture_colour.py`.
import { PARTS } from "../model/head.js";

/** @typedef {import("./atlas.js").Atlas} Atlas */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */
/**
 * Colour differences (size, size, 2) per unit of luma, within which a texture stays.
 * @typedef {{low: Float32Array, high: Float32Array}} ColourLimits
 */

const COLOURED_PARTS = [PARTS.SKIN, PARTS.SURROUND];

/**
 * The colours of a mean texture around each of its texels; its modes are completed from now on.
 * @param {ImageFilters} filters
 * @param {Uint8Array} mean (size, size, 3)
 * @param {Atlas} atlas
 * @returns {ColourLimits}
 */
export function colourLimits(filters, mean, atlas) {
  const { size } = atlas;
  const parts = new Uint8Array(size * size);
  for (let at = 0; at < parts.length; at++)
    parts[at] = 1 + COLOURED_PARTS.indexOf(atlas.partAt(at));
  return filters.colourLimits(mean, size, parts);
}

/**
 * A grey level, rounded and cut to 0..255.
 * @param {number} value
 */
export function toByte(value) {
  const rounded = value + 0.5;
  return rounded <= 0 ? 0 : rounded >= 255 ? 255 : Math.floor(rounded);
}
