import { emptyBand } from "./bands.js";

/** @typedef {import("../entropy/range_decoder.js").RangeDecoder} RangeDecoder */
/** @typedef {import("./bands.js").Band} Band */
/** @typedef {import("./probability_network.js").BandPlace} BandPlace */
/** @typedef {import("./probability_network.js").ProbabilityNetwork} ProbabilityNetwork */
/** @typedef {import("./probability_network.js").ProbabilityNetworks} ProbabilityNetworks */

/** Grids of context beside the band itself: 1 to 9 of docs/format.md, Context. */
export const CONTEXT_GRIDS = 9;
const TILE = 4;
/** Bands with no more values have no flags. */
const SMALL_BAND = 64;
const PASSES = [
  [0, 0],
  [1, 1],
  [0, 1],
  [1, 0],
];
const UNARY_LIMIT = 60;
/** The output of the network for each unary decision: the last one for all further ones. */
const OUTPUTS = [0, 1, 2, 3, 3, 4, 4, 4, 4, 5];
const PAD = 2;
const FLAGS_AROUND = CONTEXT_GRIDS + 1;
/** Grids whose signs predict signs. */
const SIGNED = [7, 8, 9];

/** Grids of one size, all padded by zeros, one after the other. */
class Context {
  /**
   * @param {number} height
   * @param {number} width
   * @param {(Int32Array | null)[]} bands values of grids 1 to 9, each (height, width); null: zeros
   */
  constructor(height, width, bands) {
    this.height = height;
    this.width = width;
    this.across = width + 2 * PAD;
    this.size = (height + 2 * PAD) * this.across;
    this.magnitudes = new Int32Array((CONTEXT_GRIDS + 2) * this.size);
    this.values = new Int32Array((1 + SIGNED.length) * this.size);
    for (const [index, band] of bands.entries()) if (band) this.#enter(index + 1, band);
    // Where the terms of features are, from a position or from its mirror image.
    const at = (/** @type {number} */ i, /** @type {number} */ j) => i * this.across + j;
    const sides = [at(0, -1), at(0, 1)];
    const above = [at(-1, 0), at(1, 0)];
    const diagonal = [at(-1, -1), at(-1, 1), at(1, -1), at(1, 1)];
    const outer = [];
    for (let i = -2; i <= 2; i++) {
      for (let j = -2; j <= 2; j++)
        if (Math.max(Math.abs(i), Math.abs(j)) === 2) outer.push(at(i, j));
    }
    this.own = [sides, above, diagonal, outer].map((each) => Int32Array.from(each));
    this.ring = Int32Array.from([...sides, ...above, ...diagonal]);
  }

  /**
   * @param {number} grid
   * @param {Int32Array} band
   */
  #enter(grid, band) {
    const signed = SIGNED.indexOf(grid) + 1;
    for (let i = 0, from = 0; i < this.height; i++) {
      let at = this.place(i, 0);
      for (let j = 0; j < this.width; j++, from++, at++) {
        const value = band[from];
        if (!value) continue;
        this.magnitudes[grid * this.size + at] = value < 0 ? -value : value;
        if (signed) this.values[signed * this.size + at] = value;
      }
    }
  }

  /**
   * Where a position is in a padded grid.
   * @param {number} i
   * @param {number} j
   */
  place(i, j) {
    return (i + PAD) * this.across + PAD + j;
  }

  /**
   * Enter a value of the band itself.
   * @param {number} i
   * @param {number} j
   * @param {number} value
   */
  setKnown(i, j, value) {
    const at = this.place(i, j);
    this.magnitudes[at] = Math.abs(value);
    this.values[at] = value;
  }

  /**
   * Enter how many of the nine tiles around a tile are flagged.
   * @param {number} row
   * @param {number} column
   * @param {number} count
   */
  setFlagsAround(row, column, count) {
    const right = Math.min((column + 1) * TILE, this.width);
    for (let i = row * TILE; i < Math.min((row + 1) * TILE, this.height); i++) {
      const start = FLAGS_AROUND * this.size + this.place(i, 0);
      this.magnitudes.fill(count, start + column * TILE, start + right);
    }
  }

  /**
   * Give a network the features of a magnitude.
   * @param {ProbabilityNetwork} network
   * @param {number} i
   * @param {number} j
   */
  addMagnitude(network, i, j) {
    network.startPosition(i, j, this.height, this.width);
    const { magnitudes, size } = this;
    const at = this.place(i, j);
    const mirrored = this.place(i, this.width - 1 - j);
    for (let f = 0; f < 4; f++) this.#addSum(network, f, at, this.own[f]);
    if (magnitudes[mirrored]) network.add(4, magnitudes[mirrored]);
    this.#addSum(network, 5, mirrored, this.ring);
    for (let grid = 1; grid <= FLAGS_AROUND; grid++) {
      const value = magnitudes[grid * size + at];
      if (value) network.add(5 + grid, value);
    }
    for (let grid = 4; grid <= 8; grid++) {
      this.#addSum(network, 12 + grid, grid * size + at, this.ring);
    }
  }

  /**
   * @param {ProbabilityNetwork} network
   * @param {number} feature
   * @param {number} at
   * @param {Int32Array} steps
   */
  #addSum(network, feature, at, steps) {
    let sum = 0;
    for (const step of steps) sum += this.magnitudes[at + step];
    if (sum) network.add(feature, sum);
  }

  /**
   * Give a network the features of a sign.
   * @param {ProbabilityNetwork} network
   * @param {number} i
   * @param {number} j
   */
  addSign(network, i, j) {
    network.startPosition(i, j, this.height, this.width);
    const { values, size } = this;
    const at = this.place(i, j);
    const mirrored = this.place(i, this.width - 1 - j);
    for (let f = 0; f < 8; f++) {
      const value = values[at + this.ring[f]];
      if (value) network.add(f, value);
    }
    for (let f = 0; f < 3; f++) {
      const value = values[mirrored + (f ? 2 * f - 3 : 0)];
      if (value) network.add(8 + f, value);
    }
    for (let grid = 1; grid <= 3; grid++) {
      const value = values[grid * size + at];
      if (value) network.add(10 + grid, value);
    }
  }
}

/**
 * Decode a band, tile flags first.
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetworks} networks
 * @param {BandPlace} place
 * @param {number} height
 * @param {number} width
 * @param {(Int32Array | null)[]} bands grids 1 to 9 of its context, each (height, width); null: zeros
 * @returns {Band}
 */
export function decodeBand(decoder, networks, place, height, width, bands) {
  const rows = Math.ceil(height / TILE);
  const columns = Math.ceil(width / TILE);
  const flags = emptyBand(rows, columns);
  if (rows * columns * TILE ** 2 > SMALL_BAND) {
    const sums = bands.map((band) => band && tileSums(band, height, width, columns, rows));
    decodeFlags(decoder, networks.tiles, place, flags, new Context(rows, columns, sums));
  } else {
    flags.values.fill(1);
  }
  if (!flags.values.includes(1)) return emptyBand(height, width);
  const context = new Context(height, width, bands);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      context.setFlagsAround(row, column, flagsAround(flags, row, column));
    }
  }
  return decodeValues(decoder, networks, place, flags, context);
}

/**
 * @param {Int32Array} band
 * @param {number} height
 * @param {number} width
 * @param {number} columns of tiles
 * @param {number} rows of tiles
 */
function tileSums(band, height, width, columns, rows) {
  const sums = new Int32Array(rows * columns);
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      sums[(i >> 2) * columns + (j >> 2)] += Math.abs(band[i * width + j]);
    }
  }
  return sums;
}

/**
 * @param {Band} flags
 * @param {number} row
 * @param {number} column
 */
function flagsAround(flags, row, column) {
  let count = 0;
  for (let i = Math.max(row - 1, 0); i <= Math.min(row + 1, flags.height - 1); i++) {
    for (let j = Math.max(column - 1, 0); j <= Math.min(column + 1, flags.width - 1); j++) {
      count += flags.values[i * flags.width + j];
    }
  }
  return count;
}

/**
 * The positions of each pass.
 * @param {number} height
 * @param {number} width
 * @param {(i: number, j: number) => boolean} isActive
 */
function passes(height, width, isActive) {
  return PASSES.map(([down, right]) => {
    /** @type {[number, number][]} */
    const places = [];
    for (let i = down; i < height; i += 2) {
      for (let j = right; j < width; j += 2) if (isActive(i, j)) places.push([i, j]);
    }
    return places;
  });
}

/**
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetwork} network
 * @param {BandPlace} place
 * @param {Band} flags written
 * @param {Context} context
 */
function decodeFlags(decoder, network, place, flags, context) {
  const all = passes(flags.height, flags.width, () => true);
  for (const [number, places] of all.entries()) {
    network.startPass(place, number, flags.height);
    const zeros = new Int32Array(places.length);
    for (const [k, [i, j]] of places.entries()) {
      context.addMagnitude(network, i, j);
      network.write(zeros, k);
    }
    for (const [k, [i, j]] of places.entries()) {
      flags.values[i * flags.width + j] = decoder.bit(zeros[k]);
    }
    for (const [i, j] of places) context.setKnown(i, j, flags.values[i * flags.width + j]);
  }
}

/**
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetworks} networks
 * @param {BandPlace} place
 * @param {Band} flags
 * @param {Context} context
 */
function decodeValues(decoder, networks, place, flags, context) {
  const { height, width } = context;
  const { sizes, signs } = networks;
  const band = emptyBand(height, width);
  const isActive = (/** @type {number} */ i, /** @type {number} */ j) =>
    flags.values[(i >> 2) * flags.width + (j >> 2)] > 0;
  for (const [number, places] of passes(height, width, isActive).entries()) {
    sizes.startPass(place, number, height);
    const zeros = new Int32Array(places.length * sizes.outputs);
    for (const [k, [i, j]] of places.entries()) {
      context.addMagnitude(sizes, i, j);
      sizes.write(zeros, k * sizes.outputs);
    }
    const sizesHere = places.map((_, k) => decodeMagnitude(decoder, zeros, k * sizes.outputs));
    const signed = places.filter((_, k) => sizesHere[k] > 0);
    const magnitudes = sizesHere.filter((size) => size > 0);
    signs.startPass(place, number, height);
    const positive = new Int32Array(signed.length);
    for (const [k, [i, j]] of signed.entries()) {
      context.addSign(signs, i, j);
      signs.write(positive, k);
    }
    for (const [k, [i, j]] of signed.entries()) {
      const value = decoder.bit(positive[k]) ? -magnitudes[k] : magnitudes[k];
      band.values[i * width + j] = value;
    }
    for (const [i, j] of signed) context.setKnown(i, j, band.values[i * width + j]);
  }
  return band;
}

/**
 * @param {RangeDecoder} decoder
 * @param {Int32Array} zeros
 * @param {number} start
 */
function decodeMagnitude(decoder, zeros, start) {
  for (let reached = 0; reached < UNARY_LIMIT; reached++) {
    const output = OUTPUTS[Math.min(reached, OUTPUTS.length - 1)];
    if (!decoder.bit(zeros[start + output])) return reached;
  }
  return UNARY_LIMIT + decoder.expGolomb(14);
}
