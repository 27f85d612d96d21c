import { AdaptiveBits } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { check } from "../errors.js";

/**
 * The quantised residual of a group of frames, see docs/format.md, Picture residual.
 * @typedef {object} ResidualTiles
 * @property {number} stepCode
 * @property {number} side of a tile of luma
 * @property {number} rows
 * @property {number} columns
 * @property {number} frames
 * @property {Uint8Array} flags (rows, columns) 0: no values; 1: values; 2: of half the step
 * @property {Map<number, Int32Array>} values (frames, valuesOfTile) of each tile that has a flag
 */

const MAX_SMALL_PX = 480;
const MAX_FRAMES = 64;
const MAX_VALUES = 67108864;
const UNARY_LIMIT = 14;
// First context of each kind of decision.
const FLAG = 0;
const FINE = 16;
const PLANE = 20;
const BAND = 29;
const REACH = 45;
const ZERO = 93;
const MORE = 573;
const FLAG_ODDS = [11, 4, 5, 2, 0, -2, 0, -1, 2, -1, 2, -1, -1, -4, -4, -7];
const FINE_ODDS = [8, -4, -4, -12];
const PLANE_ODDS = [-12, -14, -16, 10, 1, -5, 11, 1, -6];
const BAND_ODDS = [-10, 0, -8, 2, 12, 0, 14, -1, -8, 0, -4, 7, 14, 3, 16, 5];
const REACH_ODDS = [
  [0, 8],
  [0, 0, 0, 0],
  [-2, -2, 0, 3, 7, 7],
];
const ZERO_ODDS = [
  [0, -2],
  [-1, 0, 0, 0],
  [-6, 0, 1, 1, 1, 2],
  [8, 2, 2, 0, 0, -1, -2, -3, -3, -4],
];
const MORE_ODDS = [
  [0, 0],
  [4, 2, 2, 0, -1, 0, -1, -1, -2, -2],
  [3, 1, -1],
];

/**
 * The sums of one of each, the last ones changing fastest.
 * @param {number[][]} terms
 * @returns {number[]}
 */
function sumsOf([first, ...others]) {
  if (!others.length) return first;
  const rest = sumsOf(others);
  return first.flatMap((term) => rest.map((sum) => term + sum));
}

const ZEROS = [
  ...FLAG_ODDS,
  ...FINE_ODDS,
  ...PLANE_ODDS,
  ...BAND_ODDS,
  ...sumsOf(REACH_ODDS),
  ...sumsOf(ZERO_ODDS),
  ...sumsOf(MORE_ODDS),
].map((k) => Math.min(Math.max(Math.round(65536 / (1 + 2 ** (-k / 2))), 96), 65440));

/**
 * Values of a tile at one temporal frequency.
 * @param {number} side
 */
export function valuesOfTile(side) {
  return 1.5 * side ** 2;
}

/**
 * The first value of a plane among those of a tile.
 * @param {number} plane
 * @param {number} side
 */
export function planeStart(plane, side) {
  return plane ? side ** 2 + (plane - 1) * (side / 2) ** 2 : 0;
}

/** @param {number} number */
function lengthOf(number) {
  return number > 0 ? 32 - Math.clz32(number) : 0;
}

/**
 * The places of a square in the order in which they are coded.
 * @param {number} side
 */
function diagonalOrder(side) {
  const places = Array.from({ length: side ** 2 }, (_, place) => place);
  const row = (/** @type {number} */ place) => Math.floor(place / side);
  const diagonal = (/** @type {number} */ place) => row(place) + (place % side);
  return places.sort((a, b) => diagonal(a) - diagonal(b) || row(a) - row(b));
}

/**
 * The tiles in the bytes of a block that is not empty.
 * @param {Uint8Array} data
 * @param {number} width of the pictures, pixels
 * @param {number} height
 * @param {number} frames
 * @returns {ResidualTiles}
 */
export function parseTiles(data, width, height, frames) {
  const side = Math.max(width, height) <= MAX_SMALL_PX ? 8 : 16;
  const rows = Math.ceil(height / side);
  const columns = Math.ceil(width / side);
  const isWithin =
    frames <= MAX_FRAMES && rows * columns * frames * valuesOfTile(side) <= MAX_VALUES;
  check(isWithin, `picture residual of ${frames} pictures of ${width}x${height}`);
  return new TileDecoder(data, side, rows, columns, frames).decode();
}

class TileDecoder {
  /**
   * @param {Uint8Array} data
   * @param {number} side
   * @param {number} rows
   * @param {number} columns
   * @param {number} frames
   */
  constructor(data, side, rows, columns, frames) {
    this.decoder = new RangeDecoder(data);
    this.contexts = new AdaptiveBits(ZEROS, 6);
    this.side = side;
    this.rows = rows;
    this.columns = columns;
    this.frames = frames;
    this.size = valuesOfTile(side);
    this.flags = new Uint8Array(rows * columns);
    /** @type {Map<number, Int32Array>} */
    this.values = new Map();
    this.orders = [diagonalOrder(side), diagonalOrder(side / 2)];
  }

  /** @returns {ResidualTiles} */
  decode() {
    const { side, rows, columns, frames, flags, values } = this;
    const stepCode = this.decoder.bits(6);
    const planes = new Uint8Array(3 * columns);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) this.#tile(row, column, planes);
    }
    this.decoder.end("picture residual");
    return { stepCode, side, rows, columns, frames, flags, values };
  }

  /** @param {number} context */
  #bit(context) {
    return this.contexts.decode(this.decoder, context);
  }

  /**
   * @param {number} row
   * @param {number} column
   * @param {Uint8Array} planes (columns, 3) whether the tile above, or to the left, has values
   */
  #tile(row, column, planes) {
    const at = row * this.columns + column;
    const flag = (/** @type {boolean} */ isThere, /** @type {number} */ place) =>
      isThere ? this.flags[place] : 0;
    const left = flag(column > 0, at - 1);
    const above = flag(row > 0, at - this.columns);
    const aboveLeft = flag(row > 0 && column > 0, at - this.columns - 1);
    const aboveRight = flag(row > 0 && column + 1 < this.columns, at - this.columns + 1);
    const around = [left, above, aboveLeft, aboveRight].reduce(
      (sum, f) => 2 * sum + (f ? 1 : 0),
      0,
    );
    if (!this.#bit(FLAG + around)) {
      planes.fill(0, 3 * column, 3 * column + 3);
      return;
    }
    this.flags[at] = 1 + this.#bit(FINE + 2 * (left === 2 ? 1 : 0) + (above === 2 ? 1 : 0));
    const own = new Int32Array(this.frames * this.size);
    this.values.set(at, own);
    const neighbours = {
      left: column ? this.values.get(at - 1) : undefined,
      above: row ? this.values.get(at - this.columns) : undefined,
    };
    for (let plane = 0; plane < 3; plane++) {
      const before = column ? planes[3 * (column - 1) + plane] : 0;
      const has = this.#bit(PLANE + 3 * plane + before + planes[3 * column + plane]);
      planes[3 * column + plane] = has;
      if (has) this.#plane(own, neighbours, plane);
    }
  }

  /**
   * @param {Int32Array} own
   * @param {{left?: Int32Array, above?: Int32Array}} neighbours
   * @param {number} plane
   */
  #plane(own, neighbours, plane) {
    const kind = plane ? 1 : 0;
    const side = plane ? this.side / 2 : this.side;
    const start = planeStart(plane, this.side);
    let before = 0;
    for (let t = 0; t < this.frames; t++) {
      const time = kind * 4 + (t < 2 ? t : t < 4 ? 2 : 3);
      before = this.#bit(BAND + 2 * time + before);
      if (!before) continue;
      const reach = this.#reach(REACH + 6 * time);
      check(reach <= 2 * (side - 1), "picture residual: a value is out of its tile");
      this.#band(own, neighbours, t * this.size + start, t, side, reach, time);
    }
  }

  /** @param {number} first */
  #reach(first) {
    let length = 0;
    while (length < 5 && this.#bit(first + length)) length++;
    if (!length) return 0;
    return 2 ** (length - 1) + this.decoder.bits(length - 1);
  }

  /**
   * @param {Int32Array} own
   * @param {{left?: Int32Array, above?: Int32Array}} neighbours
   * @param {number} start of the values at this temporal frequency
   * @param {number} t
   * @param {number} side
   * @param {number} reach
   * @param {number} time class of kind and temporal frequency
   */
  #band(own, { left, above }, start, t, side, reach, time) {
    const magnitude = (/** @type {Int32Array | undefined} */ values, /** @type {number} */ at) =>
      values ? Math.min(Math.abs(values[at]), 2) : 0;
    for (const place of this.orders[side === this.side ? 0 : 1]) {
      const u = Math.floor(place / side);
      const v = place % side;
      if (u + v > reach) return;
      const at = start + place;
      let nearby = magnitude(above, at) + magnitude(left, at);
      if (u) nearby += 2 * magnitude(own, at - side);
      if (v) nearby += 2 * magnitude(own, at - 1);
      if (t) nearby += 2 * magnitude(own, at - this.size);
      nearby = Math.min(nearby, 9);
      const frequency = Math.min(lengthOf(u + v), 5);
      if (!this.#bit(ZERO + 10 * (6 * time + frequency) + nearby)) continue;
      const more = MORE + 3 * (10 * (time >> 2) + nearby);
      let size = 1;
      while (size < UNARY_LIMIT && this.#bit(more + Math.min(size, 3) - 1)) size++;
      if (size === UNARY_LIMIT) size += this.decoder.expGolomb(13);
      own[at] = this.decoder.evenBit() ? -size : size;
    }
  }
}
