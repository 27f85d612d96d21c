// The colour of a texture where what was sent does not tell; see
// `decoder/rendering/texture_colour.py`.
import { BLUE, GREEN, RED } from "../format/pictures/picture.js";
import { PARTS } from "../model/head.js";

/** @typedef {import("./atlas.js").Atlas} Atlas */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */
/**
 * Colour differences (size, size, 2) per unit of luma, within which a texture stays.
 * @typedef {{low: Float32Array, high: Float32Array}} ColourLimits
 */

const COLOURED_PARTS = [PARTS.SKIN, PARTS.SURROUND];
const SLACK_GREY = 2;

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
 * Mean and what modes add, within the colours nearby.
 * @param {ColourLimits} limits
 * @param {Uint8Array} mean (size, size, 3)
 * @param {Float32Array} added (size, size, 3)
 * @param {Uint8ClampedArray} drawn (size, size, 4) R, G, B and alpha, written
 */
export function limitColours({ low, high }, mean, added, drawn) {
  for (let at = 0, i = 0, p = 0; i < added.length; at += 2, i += 3, p += 4) {
    let red = mean[i] + added[i];
    const green = mean[i + 1] + added[i + 1];
    let blue = mean[i + 2] + added[i + 2];
    const luma = BLUE * blue + GREEN * green + RED * red;
    const bright = Math.max(luma, 0);
    blue = luma + within(blue - luma, low[at] * bright, high[at] * bright);
    red = luma + within(red - luma, low[at + 1] * bright, high[at + 1] * bright);
    drawn[p] = toByte(red);
    drawn[p + 1] = toByte((luma - BLUE * blue - RED * red) / GREEN);
    drawn[p + 2] = toByte(blue);
  }
}

/**
 * @param {number} difference
 * @param {number} low
 * @param {number} high
 */
function within(difference, low, high) {
  if (difference < low - SLACK_GREY) return Math.min(low - SLACK_GREY, high + SLACK_GREY);
  return Math.min(difference, high + SLACK_GREY);
}

/**
 * A grey level, rounded and cut to 0..255.
 * @param {number} value
 */
export function toByte(value) {
  const rounded = value + 0.5;
  return rounded <= 0 ? 0 : rounded >= 255 ? 255 : Math.floor(rounded);
}
