import { Band, enlargedTiles, TILE } from "./bands.js";

/** @typedef {import("../entropy/range_decoder.js").RangeDecoder} RangeDecoder */
/** @typedef {import("./bands.js").Parents} Parents */
/** @typedef {import("./probability_network.js").BandPlace} BandPlace */
/** @typedef {import("./probability_network.js").ProbabilityNetwork} ProbabilityNetwork */
/** @typedef {import("./probability_network.js").ProbabilityNetworks} ProbabilityNetworks */

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
/** First features of a magnitude, see docs/format.md, Context. */
const FEATURES = { PARENTS: 6, BESIDE: 9, FLAGS: 15, AROUND: 16 };
/** Of the grids beside the band these have the sums around a place as features as well. */
const WITH_AROUND = 5;
/** The first of those whose signs predict signs. */
const SIGNED = 3;

/** What is known around the places of a band, or of its flags. */
class Context {
  /**
   * @param {Band} own written as it becomes known
   * @param {Band[]} parents grids 1 to 3 of docs/format.md
   * @param {number} shift by which a place is coarser in those
   * @param {(Band | null)[]} beside grids 4 to 9, of the size of `own`; null: zeros
   */
  constructor(own, parents, shift, beside) {
    this.own = own;
    this.cells = own.written;
    this.parents = parents;
    this.shift = shift;
    this.beside = beside.map((band) => band?.cells ?? null);
    // Where the terms of features are, from a place or from its mirror image.
    const { across } = own;
    const sides = [-1, 1];
    const above = [-across, across];
    const diagonal = [-across - 1, -across + 1, across - 1, across + 1];
    const outer = [];
    for (let i = -2; i <= 2; i++) {
      for (let j = -2; j <= 2; j++)
        if (Math.max(Math.abs(i), Math.abs(j)) === 2) outer.push(i * across + j);
    }
    this.near = [sides, above, diagonal, outer].map((each) => Int32Array.from(each));
    this.ring = Int32Array.from([...sides, ...above, ...diagonal]);
  }

  /**
   * Give a network the features of a magnitude.
   * @param {ProbabilityNetwork} network
   * @param {number} i
   * @param {number} j
   * @param {number} flags of the nine tiles around its tile
   */
  addMagnitude(network, i, j, flags) {
    const { own, cells, near, ring, parents, shift, beside } = this;
    network.startPosition(i, j, own.height, own.width);
    const at = own.place(i, j);
    const mirrored = own.place(i, own.width - 1 - j);
    for (let f = 0; f < 4; f++) network.add(f, sumAround(cells, at, near[f]));
    network.add(4, Math.abs(cells[mirrored]));
    network.add(5, sumAround(cells, mirrored, ring));
    for (let g = 0; g < parents.length; g++) {
      const parent = parents[g];
      if (!parent.cells) continue;
      const value = parent.cells[parent.place(i >> shift, j >> shift)];
      network.add(FEATURES.PARENTS + g, value);
    }
    for (let g = 0; g < beside.length; g++) {
      const grid = beside[g];
      if (!grid) continue;
      network.add(FEATURES.BESIDE + g, Math.abs(grid[at]));
      if (g < WITH_AROUND) network.add(FEATURES.AROUND + g, sumAround(grid, at, ring));
    }
    network.add(FEATURES.FLAGS, flags);
  }

  /**
   * Give a network the features of a sign.
   * @param {ProbabilityNetwork} network
   * @param {number} i
   * @param {number} j
   */
  addSign(network, i, j) {
    const { own, cells, ring, beside } = this;
    network.startPosition(i, j, own.height, own.width);
    const at = own.place(i, j);
    const mirrored = own.place(i, own.width - 1 - j);
    for (let f = 0; f < ring.length; f++) network.add(f, cells[at + ring[f]]);
    network.add(8, cells[mirrored]);
    network.add(9, cells[mirrored - 1]);
    network.add(10, cells[mirrored + 1]);
    for (let g = SIGNED; g < beside.length; g++) {
      const grid = beside[g];
      if (grid) network.add(8 + g, grid[at]);
    }
  }
}

/**
 * @param {Int32Array} cells
 * @param {number} at
 * @param {Int32Array} steps
 */
function sumAround(cells, at, steps) {
  let sum = 0;
  for (let k = 0; k < steps.length; k++) sum += Math.abs(cells[at + steps[k]]);
  return sum;
}

/**
 * Decode a band, tile flags first.
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetworks} networks
 * @param {BandPlace} place
 * @param {Band} band written
 * @param {Parents | null} parents
 * @param {(Band | null)[]} beside grids 4 to 9 of its context, each of its size; null: zeros
 */
export function decodeBand(decoder, networks, place, band, parents, beside) {
  const { height, width } = band;
  const coarse = parents ? [parents.own, parents.around, parents.others] : [];
  const flags = new Band(Math.ceil(height / TILE), Math.ceil(width / TILE));
  if (flags.height * flags.width * TILE ** 2 > SMALL_BAND) {
    const sums = coarse.map((grid) => enlargedTiles(grid, height, width));
    const tiles = beside.map((grid) => grid && (grid.cells ? grid.tiles : null));
    decodeFlags(decoder, networks.tiles, place, flags, new Context(flags, sums, 0, tiles));
  } else {
    for (let row = 0; row < flags.height; row++) {
      const start = flags.place(row, 0);
      flags.written.fill(1, start, start + flags.width);
    }
  }
  if (flags.written.includes(1))
    decodeValues(decoder, networks, place, flags, new Context(band, coarse, 1, beside));
}

/**
 * How many of the nine tiles around a tile are flagged.
 * @param {Band} flags
 * @param {number} at
 */
function flagsAround({ written, across }, at) {
  let count = 0;
  for (let row = at - across; row <= at + across; row += across) {
    count += written[row - 1] + written[row] + written[row + 1];
  }
  return count;
}

/**
 * Rows and columns, in turn, of the places of a pass in flagged tiles.
 * @param {number[]} pass its first row and column
 * @param {number} height
 * @param {number} width
 * @param {Band | null} flags null: of all tiles
 */
function placesOf([down, right], height, width, flags) {
  const places = new Int32Array((height + 1) * ((width + 1) >> 1));
  let count = 0;
  for (let i = down; i < height; i += 2) {
    const tiles = flags ? flags.place(i >> 2, 0) : 0;
    for (let j = right; j < width; j += 2) {
      if (flags && !flags.written[tiles + (j >> 2)]) {
        // On to the next tile: the loop adds two more.
        j += 2;
        continue;
      }
      places[count++] = i;
      places[count++] = j;
    }
  }
  return places.subarray(0, count);
}

/**
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetwork} network
 * @param {BandPlace} place
 * @param {Band} flags written
 * @param {Context} context
 */
function decodeFlags(decoder, network, place, flags, context) {
  const { written } = flags;
  for (const [number, pass] of PASSES.entries()) {
    network.startPass(place, number, flags.height);
    const places = placesOf(pass, flags.height, flags.width, null);
    const zeros = new Int32Array(places.length / 2);
    for (let k = 0; k < zeros.length; k++) {
      context.addMagnitude(network, places[2 * k], places[2 * k + 1], 0);
      network.write(zeros, k);
    }
    for (let k = 0; k < zeros.length; k++) {
      written[flags.place(places[2 * k], places[2 * k + 1])] = decoder.bit(zeros[k]);
    }
  }
}

/**
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetworks} networks
 * @param {BandPlace} place
 * @param {Band} flags
 * @param {Context} context
 */
function decodeValues(decoder, { sizes, signs }, place, flags, context) {
  const { height, width, written } = context.own;
  for (const [number, pass] of PASSES.entries()) {
    const places = placesOf(pass, height, width, flags);
    sizes.startPass(place, number, height);
    const zeros = new Int32Array((places.length / 2) * sizes.outputs);
    for (let k = 0; k < places.length; k += 2) {
      const [i, j] = [places[k], places[k + 1]];
      const around = flagsAround(flags, flags.place(i >> 2, j >> 2));
      context.addMagnitude(sizes, i, j, around);
      sizes.write(zeros, (k / 2) * sizes.outputs);
    }
    // What is not zero moves to the front: rows and columns, and the magnitudes.
    const magnitudes = new Int32Array(places.length / 2);
    let count = 0;
    for (let k = 0; k < places.length; k += 2) {
      const magnitude = decodeMagnitude(decoder, zeros, (k / 2) * sizes.outputs);
      if (!magnitude) continue;
      places[2 * count] = places[k];
      places[2 * count + 1] = places[k + 1];
      magnitudes[count++] = magnitude;
    }
    decodeSigns(decoder, signs, { place, number, places, magnitudes, count }, context, written);
  }
}

/**
 * Enter the values of a pass.
 * @param {RangeDecoder} decoder
 * @param {ProbabilityNetwork} network
 * @param {{place: BandPlace, number: number, places: Int32Array, magnitudes: Int32Array, count: number}} pass
 * @param {Context} context
 * @param {Int32Array} written
 */
function decodeSigns(decoder, network, pass, context, written) {
  const { place, number, places, magnitudes, count } = pass;
  network.startPass(place, number, context.own.height);
  const positive = new Int32Array(count);
  for (let k = 0; k < count; k++) {
    context.addSign(network, places[2 * k], places[2 * k + 1]);
    network.write(positive, k);
  }
  for (let k = 0; k < count; k++) {
    const value = decoder.bit(positive[k]) ? -magnitudes[k] : magnitudes[k];
    written[context.own.place(places[2 * k], places[2 * k + 1])] = value;
  }
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
