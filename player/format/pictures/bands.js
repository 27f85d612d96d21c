/** Zeros around the values of a band, so that places around a place need no test. */
export const PAD = 2;
/** Side of the tiles of a band. */
export const TILE = 4;
export const LEVELS = 5;

/** Integers (height, width) of a subband, row by row, with zeros around them. */
export class Band {
  /** @type {Band | null} */
  #tiles = null;

  /**
   * @param {number} height
   * @param {number} width
   */
  constructor(height, width) {
    this.height = height;
    this.width = width;
    this.across = width + 2 * PAD;
    /** @type {Int32Array | null} null: all are 0 */
    this.cells = null;
  }

  /** The cells, to be written. */
  get written() {
    this.cells ??= new Int32Array((this.height + 2 * PAD) * this.across);
    return this.cells;
  }

  /**
   * Where a value is among the cells.
   * @param {number} i
   * @param {number} j
   */
  place(i, j) {
    return (i + PAD) * this.across + PAD + j;
  }

  /**
   * Sums of the magnitudes of each tile.
   * @returns {Band}
   */
  get tiles() {
    if (this.#tiles) return this.#tiles;
    const sums = new Band(Math.ceil(this.height / TILE), Math.ceil(this.width / TILE));
    if (this.cells) {
      const { written } = sums;
      for (let i = 0; i < this.height; i++) {
        const to = sums.place(i >> 2, 0);
        const from = this.place(i, 0);
        for (let j = 0; j < this.width; j++) {
          written[to + (j >> 2)] += Math.abs(this.cells[from + j]);
        }
      }
    }
    this.#tiles = sums;
    return sums;
  }

  /**
   * The band cut, or filled with zeros, to a size.
   * @param {number} height
   * @param {number} width
   */
  fitted(height, width) {
    if (this.height === height && this.width === width) return this;
    const result = new Band(height, width);
    result.addMagnitudes(this, 1);
    return result;
  }

  /**
   * Add magnitudes of a band as far as it reaches, or each of them so many times.
   * @param {Band} band
   * @param {number} factor
   */
  addMagnitudes(band, factor) {
    if (!band.cells) return;
    this.#tiles = null;
    const { written } = this;
    const rows = Math.min(this.height, band.height);
    const columns = Math.min(this.width, band.width);
    for (let i = 0; i < rows; i++) {
      const to = this.place(i, 0);
      const from = band.place(i, 0);
      for (let j = 0; j < columns; j++) written[to + j] += factor * Math.abs(band.cells[from + j]);
    }
  }
}

/**
 * The coefficients of a plane; details: three bands a level, the coarsest level first.
 * @typedef {{lowpass: Band, details: Band[][]}} Pyramid
 */

/**
 * Zeros in the shapes of the bands of a plane.
 * @param {number} height
 * @param {number} width
 * @returns {Pyramid}
 */
export function emptyPyramid(height, width) {
  const details = [];
  for (let level = 0; level < LEVELS; level++) {
    const low = [Math.ceil(height / 2), Math.ceil(width / 2)];
    const high = [height >> 1, width >> 1];
    details.unshift([
      new Band(low[0], high[1]),
      new Band(high[0], low[1]),
      new Band(high[0], high[1]),
    ]);
    [height, width] = low;
  }
  return { lowpass: new Band(height, width), details };
}

/**
 * The band of a level and orientation; level 0 is the lowpass band.
 * @param {Pyramid} pyramid
 * @param {number} level
 * @param {number} orientation
 */
export function bandOf(pyramid, level, orientation) {
  return level ? pyramid.details[level - 1][orientation] : pyramid.lowpass;
}

/**
 * What the coarser level tells of a band: magnitudes of the band of the same orientation, the sums
 * of the eight around each, and those of the other orientations.  Each value is of two rows and two
 * columns.
 * @typedef {{own: Band, around: Band, others: Band}} Parents
 */

/**
 * @param {Band[]} bands of the coarser level
 * @param {number} orientation
 * @returns {Parents}
 */
export function parentsOf(bands, orientation) {
  const { height, width } = bands[orientation];
  const own = new Band(height, width);
  own.addMagnitudes(bands[orientation], 1);
  const others = new Band(height, width);
  for (const [other, band] of bands.entries()) {
    if (other !== orientation) others.addMagnitudes(band, 1);
  }
  return { own, around: ringSums(own), others };
}

/**
 * Sums of the eight neighbours of each value.
 * @param {Band} band
 */
function ringSums(band) {
  const sums = new Band(band.height, band.width);
  const { cells, across } = band;
  if (!cells) return sums;
  const { written } = sums;
  for (let i = 0; i < band.height; i++) {
    for (let j = 0, at = band.place(i, 0); j < band.width; j++, at++) {
      const above = cells[at - across - 1] + cells[at - across] + cells[at - across + 1];
      const below = cells[at + across - 1] + cells[at + across] + cells[at + across + 1];
      written[at] = above + cells[at - 1] + cells[at + 1] + below;
    }
  }
  return sums;
}

/**
 * Sums of the tiles of a band (height, width) that has each value of a coarser one four times.
 * @param {Band} band
 * @param {number} height
 * @param {number} width
 */
export function enlargedTiles(band, height, width) {
  const sums = new Band(Math.ceil(height / TILE), Math.ceil(width / TILE));
  if (!band.cells) return sums;
  const { written } = sums;
  for (let i = 0; i < Math.min(band.height, (height + 1) >> 1); i++) {
    const rows = Math.min(height - 2 * i, 2);
    const to = sums.place(i >> 1, 0);
    const from = band.place(i, 0);
    for (let j = 0; j < Math.min(band.width, (width + 1) >> 1); j++) {
      const columns = Math.min(width - 2 * j, 2);
      written[to + (j >> 1)] += rows * columns * band.cells[from + j];
    }
  }
  return sums;
}
