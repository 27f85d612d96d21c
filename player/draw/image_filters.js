// Filters of planes (height, width), row by row, as OpenCV's of the same names.
import { array } from "../data_file.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/**
 * Values (height, width, channels), row by row.
 * @typedef {{height: number, width: number, channels: number, values: Float32Array}} Raster
 */
/** Values (height, width), row by row. @typedef {{height: number, width: number, values: Float32Array}} Plane */
/**
 * What `player/wasm/filters.ts` exports; addresses are those of bytes in its memory.
 * @typedef {object} Exports
 * @property {WebAssembly.Memory} memory
 * @property {(height: number, width: number) => number} rasterOf
 * @property {(sigma: number) => number} blurred
 * @property {(height: number, width: number) => number} resized
 * @property {(size: number) => number} meanOf
 * @property {() => number} partsAt
 * @property {() => number} limits
 * @property {() => number} modeAt
 * @property {() => void} complete
 * @property {(triangles: number, size: number) => number} cornersAt
 * @property {() => number} covered
 */

/**
 * @param {number} height
 * @param {number} width
 * @param {number} channels
 * @returns {Raster}
 */
export function emptyRaster(height, width, channels) {
  return { height, width, channels, values: new Float32Array(height * width * channels) };
}

/** The compiled filters, see `player/wasm/filters.ts`. */
export class ImageFilters {
  /** @param {Exports} exports */
  constructor(exports) {
    this.exports = exports;
  }

  /**
   * Those of the player's data file.
   * @param {Arrays} data
   */
  static async load(data) {
    const bytes = /** @type {Uint8Array<ArrayBuffer>} */ (array(data, "filters_wasm"));
    const { instance } = await WebAssembly.instantiate(bytes, { rasters: { exp: Math.exp } });
    return new ImageFilters(/** @type {Exports} */ (/** @type {unknown} */ (instance.exports)));
  }

  /**
   * Blurred by a Gaussian of a standard deviation, pixels; mirrored at the edges.
   * @param {Plane} plane
   * @param {number} sigma
   * @returns {Plane}
   */
  blurred({ height, width, values }, sigma) {
    this.#write(this.exports.rasterOf(height, width), values);
    return { height, width, values: this.#read(this.exports.blurred(sigma), height * width) };
  }

  /**
   * Resized, each value from the middles of the nearest ones linearly, edges repeated.
   * @param {Plane} plane
   * @param {number} height
   * @param {number} width
   * @returns {Plane}
   */
  resized(plane, height, width) {
    this.#write(this.exports.rasterOf(plane.height, plane.width), plane.values);
    const at = this.exports.resized(height, width);
    return { height, width, values: this.#read(at, height * width) };
  }

  /**
   * The least and the greatest colour differences (size, size, 2) of a mean texture per unit of
   * luma; the modes that are completed from now on are of this mean.
   * @param {Uint8Array} mean (size, size, 3)
   * @param {number} size
   * @param {Uint8Array} parts (size, size) 1 and 2 in those that have colour
   */
  colourLimits(mean, size, parts) {
    this.#write(this.exports.meanOf(size), mean);
    const place = this.exports.partsAt();
    new Uint8Array(this.exports.memory.buffer, place).set(parts);
    const at = this.exports.limits();
    const count = 2 * size * size;
    return { low: this.#read(at, count), high: this.#read(at + 4 * count, count) };
  }

  /**
   * Give a mode colour where none has been sent: it is changed.
   * @param {Float32Array} values (size, size, 3)
   */
  completeMode(values) {
    const at = this.exports.modeAt();
    this.#write(at, values);
    this.exports.complete();
    values.set(new Float32Array(this.exports.memory.buffer, at, values.length));
  }

  /**
   * The triangle at each texel (size, size) of an atlas, -1: none, and the weights of its second and
   * third corner; a texel on a common edge has the last one.
   * @param {Float64Array} corners (n, 3, 2) column and row, 0..1
   * @param {number} size
   */
  covered(corners, size) {
    const at = this.exports.cornersAt(corners.length / 6, size);
    new Float64Array(this.exports.memory.buffer, at).set(corners);
    const place = this.exports.covered();
    const owner = new Int32Array(this.exports.memory.buffer, place, size * size).slice();
    return { owner, weights: this.#read(place + 4 * size * size, 2 * size * size) };
  }

  /**
   * @param {number} at
   * @param {ArrayLike<number>} values
   */
  #write(at, values) {
    new Float32Array(this.exports.memory.buffer, at).set(values);
  }

  /**
   * @param {number} at
   * @param {number} count
   */
  #read(at, count) {
    return new Float32Array(this.exports.memory.buffer, at, count).slice();
  }
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
