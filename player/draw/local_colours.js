// The colour of a texture where what was sent does not tell; see
// `decoder/rendering/texture_colour.py`.
import { BLUE, GREEN, RED } from "../format/pictures/picture.js";
import { PARTS } from "../model/head.js";
import { blurred, emptyRaster, extremes } from "./image_filters.js";

/** @typedef {import("../format/pictures/picture.js").Image} Image */
/** @typedef {import("./atlas.js").Atlas} Atlas */
/** @typedef {import("./image_filters.js").Raster} Raster */
/**
 * Colour differences (size, size, 2) per unit of luma, within which a texture stays.
 * @typedef {{low: Float32Array, high: Float32Array}} ColourLimits
 */

const COLOURED_PARTS = [PARTS.SKIN, PARTS.SURROUND];
const REACH = 1 / 12;
const NEAR = 1 / 48;
const MIN_LUMA = 12;
const BRIGHT = 0.6;
const SHARE = 0.6;
const BRIGHT_SHARE = 0.3;
const SENT_SHARE = 0.5;
const SENT_REACH = 2;
const COARSE = 1;
const SLACK_GREY = 2;
const FREE = 1e3;

/**
 * Luma and the colour differences of blue and red of colours R, G, B.
 * @param {Image} image
 * @returns {Raster}
 */
function toPlanes({ height, width, values }) {
  const planes = emptyRaster(height, width, 3);
  for (let i = 0; i < values.length; i += 3) {
    const y = RED * values[i] + GREEN * values[i + 1] + BLUE * values[i + 2];
    planes.values[i] = y;
    planes.values[i + 1] = values[i + 2] - y;
    planes.values[i + 2] = values[i] - y;
  }
  return planes;
}

/** The colours of a mean texture around each of its texels. */
export class LocalColours {
  /** (size, size, 2) colour differences around each texel of a part, per unit of luma */
  #around;

  /**
   * @param {Uint8Array} mean (size, size, 3) R, G, B
   * @param {Atlas} atlas
   */
  constructor(mean, atlas) {
    const { size } = atlas;
    this.size = size;
    const texels = size * size;
    this.#around = new Float32Array(2 * texels);
    /** (size, size, 2) colour differences per unit of luma that a mode is expected to have */
    this.expected = new Float32Array(2 * texels);
    this.low = new Float32Array(2 * texels).fill(-FREE);
    this.high = new Float32Array(2 * texels).fill(FREE);
    const planes = toPlanes({ height: size, width: size, values: Float32Array.from(mean) });
    const coarse = blurred(planes, COARSE);
    for (const part of COLOURED_PARTS) this.#enter(atlas, part, planes, coarse);
  }

  /**
   * Enter the colours around the texels of a part.
   * @param {Atlas} atlas
   * @param {number} part
   * @param {Raster} planes
   * @param {Raster} coarse
   */
  #enter(atlas, part, planes, coarse) {
    const { size } = this;
    const isPart = new Uint8Array(size * size);
    const weighted = emptyRaster(size, size, 4);
    for (let at = 0; at < isPart.length; at++) {
      if (atlas.partAt(at) !== part) continue;
      isPart[at] = 1;
      for (let c = 0; c < 3; c++) weighted.values[4 * at + c] = planes.values[3 * at + c];
      weighted.values[4 * at + 3] = 1;
    }
    const sums = blurred(weighted, REACH * size).values;
    const usual = new Float32Array(2 * size * size);
    const shares = emptyRaster(size, size, 1);
    const seen = emptyRaster(size, size, 2);
    for (let at = 0; at < isPart.length; at++) {
      const count = Math.max(sums[4 * at + 3], 1e-3);
      const luma = sums[4 * at] / count;
      const own = coarse.values[3 * at];
      const isSeen = isPart[at] && own > BRIGHT * luma;
      shares.values[at] = isSeen ? BRIGHT_SHARE : SHARE;
      for (let c = 0; c < 2; c++) {
        const around = sums[4 * at + 1 + c] / count / Math.max(luma, MIN_LUMA);
        this.#around[2 * at + c] = around;
        usual[2 * at + c] = SHARE * around;
        seen.values[2 * at + c] = isSeen
          ? coarse.values[3 * at + 1 + c] / Math.max(own, MIN_LUMA)
          : usual[2 * at + c];
      }
    }
    const share = blurred(shares, SENT_REACH).values;
    const side = 2 * Math.round(NEAR * size) + 1;
    const least = extremes(seen, side, -1).values;
    const most = extremes(seen, side, 1).values;
    for (let i = 0; i < 2 * size * size; i++) {
      if (!isPart[i >> 1]) continue;
      this.expected[i] = share[i >> 1] * this.#around[i];
      this.low[i] = Math.min(least[i], usual[i]);
      this.high[i] = Math.max(most[i], usual[i]);
    }
  }

  /**
   * Give a mode colour where none has been sent: it is changed.
   * @param {Image} mode (size, size, 3)
   */
  complete({ values }) {
    const { size, expected } = this;
    const luma = emptyRaster(size, size, 1);
    // How strong the colour is that has been sent, and that which is expected.
    const strengths = emptyRaster(size, size, 2);
    for (let at = 0, i = 0; at < size * size; at++, i += 3) {
      const y = RED * values[i] + GREEN * values[i + 1] + BLUE * values[i + 2];
      const [blue, red] = [values[i + 2] - y, values[i] - y];
      luma.values[at] = y;
      strengths.values[2 * at] = Math.sqrt(blue * blue + red * red);
    }
    const coarse = blurred(luma, COARSE).values;
    for (let at = 0, i = 0; at < size * size; at++, i += 2) {
      const [blue, red] = [expected[i] * coarse[at], expected[i + 1] * coarse[at]];
      strengths.values[2 * at + 1] = Math.sqrt(blue * blue + red * red);
    }
    const around = blurred(strengths, SENT_REACH).values;
    for (let at = 0, i = 0; at < size * size; at++, i += 3) {
      const share = 1 - around[2 * at] / Math.max(SENT_SHARE * around[2 * at + 1], 1e-3);
      if (share <= 0) continue;
      const missing = Math.min(share, 1) * coarse[at];
      const y = luma.values[at];
      const blue = values[i + 2] + missing * expected[2 * at];
      const red = values[i] + missing * expected[2 * at + 1];
      values[i] = red;
      values[i + 1] = (y - BLUE * blue - RED * red) / GREEN;
      values[i + 2] = blue;
    }
  }
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
