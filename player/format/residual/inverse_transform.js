import { planeStart, valuesOfTile } from "./tile_decoder.js";

/** @typedef {import("./tile_decoder.js").ResidualTiles} ResidualTiles */

const BIAS = 0.08;
/** Kinds of tiles by their flag. */
const KINDS = [1, 2];

/**
 * The samples of one frame, of tiles with the whole step and of fine ones: luma (rows side,
 * columns side), then two colour differences of half the size.
 * @typedef {{coarse: Float32Array[], fine: Float32Array[]}} ResidualPlanes
 */

/** @type {Map<number, Float64Array>} */
const DCTS = new Map();
/** @type {Map<number, Float64Array>} */
const LAPPINGS = new Map();

/**
 * The orthonormal DCT-II of so many points: rows are its functions.
 * @param {number} size
 */
function dct(size) {
  let matrix = DCTS.get(size);
  if (!matrix) {
    matrix = Float64Array.from({ length: size * size }, (_, at) => {
      const k = Math.floor(at / size);
      const scale = Math.sqrt((k ? 2 : 1) / size);
      return scale * Math.cos((Math.PI * (2 * (at % size) + 1) * k) / (2 * size));
    });
    DCTS.set(size, matrix);
  }
  return matrix;
}

/**
 * The filter P of the samples around a border of two blocks, docs/format.md.
 * @param {number} size
 */
function lapping(size) {
  let filter = LAPPINGS.get(size);
  if (!filter) {
    const half = size / 2;
    const cosines = dct(half);
    const v = (/** @type {number} */ i, /** @type {number} */ j) => {
      let sum = 0;
      for (let k = 0; k < half; k++) {
        const angle = (Math.PI * (2 * (half - 1 - j) + 1) * (2 * k + 1)) / (4 * half);
        sum += cosines[k * half + half - 1 - i] * Math.sqrt(2 / half) * Math.cos(angle);
      }
      return sum;
    };
    const middle = (/** @type {number} */ i, /** @type {number} */ j) =>
      i < half || j < half ? (i === j ? 1 : 0) : v(i - half, j - half);
    const butterfly = (/** @type {number} */ i, /** @type {number} */ j) => {
      const sign = i >= half && j >= half ? -1 : 1;
      return j === i || j === size - 1 - i ? sign / Math.SQRT2 : 0;
    };
    filter = product(
      product(squared(butterfly, size), squared(middle, size), size),
      squared(butterfly, size),
      size,
    );
    LAPPINGS.set(size, filter);
  }
  return filter;
}

/**
 * @param {(i: number, j: number) => number} element
 * @param {number} size
 */
function squared(element, size) {
  return Float64Array.from({ length: size * size }, (_, at) =>
    element(Math.floor(at / size), at % size),
  );
}

/**
 * @param {Float64Array} a
 * @param {Float64Array} b
 * @param {number} size
 */
function product(a, b, size) {
  return squared((i, j) => {
    let sum = 0;
    for (let k = 0; k < size; k++) sum += a[i * size + k] * b[k * size + j];
    return sum;
  }, size);
}

/** The residual of the frames of a packet, from its tiles. */
export class ResidualPictures {
  /** @param {ResidualTiles} tiles */
  constructor(tiles) {
    this.tiles = tiles;
    /** @type {Map<number, Float32Array>} (frames, values) of each tile, in time */
    this.inTime = new Map();
    const step = 2 ** (tiles.stepCode / 4);
    for (const [at, values] of tiles.values) {
      const own = tiles.flags[at] === 2 ? step / 2 : step;
      this.inTime.set(at, this.#transformed(values, own));
    }
  }

  /**
   * Dequantise the values of a tile and transform them in time.
   * @param {Int32Array} values
   * @param {number} step
   */
  #transformed(values, step) {
    const { frames, side } = this.tiles;
    const size = valuesOfTile(side);
    const cosines = dct(frames);
    const result = new Float32Array(values.length);
    for (let t = 0; t < frames; t++) {
      for (let k = 0; k < size; k++) {
        const integer = values[t * size + k];
        if (!integer) continue;
        const value = step * (integer - BIAS * Math.sign(integer));
        for (let i = 0; i < frames; i++) result[i * size + k] += cosines[t * frames + i] * value;
      }
    }
    return result;
  }

  /**
   * The samples of a frame.
   * @param {number} frame from 0
   * @returns {ResidualPlanes}
   */
  planes(frame) {
    const [coarse, fine] = KINDS.map((kind) =>
      [0, 1, 2].map((plane) => this.#plane(frame, plane, kind)),
    );
    return { coarse, fine };
  }

  /**
   * @param {number} frame
   * @param {number} plane
   * @param {number} kind
   */
  #plane(frame, plane, kind) {
    const { rows, columns, flags, side } = this.tiles;
    const own = plane ? side / 2 : side;
    const width = columns * own;
    const samples = new Float32Array(rows * own * width);
    const has = new Uint8Array(rows * columns);
    for (const [at, values] of this.inTime) {
      if (flags[at] !== kind) continue;
      has[at] = 1;
      const start = frame * valuesOfTile(side) + planeStart(plane, side);
      const top = Math.floor(at / columns) * own * width + (at % columns) * own;
      placeBlock(values.subarray(start, start + own * own), own, samples, top, width);
    }
    filterBorders(samples, has, rows, columns, own);
    return samples;
  }
}

/**
 * Write the inverse DCT of a block.
 * @param {Float32Array} values (side, side)
 * @param {number} side
 * @param {Float32Array} samples
 * @param {number} start of the block
 * @param {number} width of the plane
 */
function placeBlock(values, side, samples, start, width) {
  const cosines = dct(side);
  const half = new Float64Array(side * side);
  for (let k = 0; k < side; k++) {
    for (let l = 0; l < side; l++) {
      const value = values[k * side + l];
      if (!value) continue;
      for (let j = 0; j < side; j++) half[k * side + j] += value * cosines[l * side + j];
    }
  }
  for (let i = 0; i < side; i++) {
    for (let k = 0; k < side; k++) {
      const weight = cosines[k * side + i];
      for (let j = 0; j < side; j++) samples[start + i * width + j] += weight * half[k * side + j];
    }
  }
}

/**
 * Filter the samples across the borders of blocks: between columns, then between rows.
 * @param {Float32Array} samples
 * @param {Uint8Array} has (rows, columns) whether a block has values
 * @param {number} rows
 * @param {number} columns
 * @param {number} side
 */
function filterBorders(samples, has, rows, columns, side) {
  const filter = lapping(side);
  const width = columns * side;
  const spread = new Uint8Array(rows * columns);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const at = row * columns + column;
      if (has[at]) {
        spread[at] = 1;
        if (column) spread[at - 1] = 1;
        if (column + 1 < columns) spread[at + 1] = 1;
      }
      if (!column || !(has[at] || has[at - 1])) continue;
      const first = row * side * width + column * side - side / 2;
      for (let i = 0; i < side; i++) filterLine(samples, first + i * width, 1, filter, side);
    }
  }
  for (let row = 1; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const at = row * columns + column;
      if (!spread[at] && !spread[at - columns]) continue;
      const first = (row * side - side / 2) * width + column * side;
      for (let j = 0; j < side; j++) filterLine(samples, first + j, width, filter, side);
    }
  }
}

/**
 * Multiply the samples of a line by the transpose of a filter.
 * @param {Float32Array} samples
 * @param {number} first
 * @param {number} step
 * @param {Float64Array} filter
 * @param {number} side
 */
function filterLine(samples, first, step, filter, side) {
  const before = new Float64Array(side);
  for (let k = 0; k < side; k++) before[k] = samples[first + k * step];
  for (let j = 0; j < side; j++) {
    let sum = 0;
    for (let k = 0; k < side; k++) sum += filter[k * side + j] * before[k];
    samples[first + j * step] = sum;
  }
}
