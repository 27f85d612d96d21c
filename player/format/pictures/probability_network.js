/** @typedef {{features: Int32Array, classes: Int32Array, last: Int32Array}} Weights */

const MAX_LOGIT = 2048;
const MAX_HIDDEN = 16384;
/** First row of each class, see docs/format.md, Probabilities. */
const CLASS_STARTS = { plane: 3, level: 6, orientation: 12, pass: 16, row: 20, column: 36 };
const CELLS = 16;
/** 16 log2(1 + x), rounded. */
const LOG = Float64Array.from({ length: 1024 }, (_, x) => Math.round(16 * Math.log2(1 + x)));
const SIGMOID = Int32Array.from({ length: 2 * MAX_LOGIT + 1 }, (_, i) => {
  const zero = Math.round(65536 / (1 + Math.exp(-(i - MAX_LOGIT) / 256)));
  return Math.min(Math.max(zero, 24), 65512);
});

/**
 * The logarithm of a magnitude as the networks take it.
 * @param {number} magnitude
 */
export function logOf(magnitude) {
  return LOG[magnitude < LOG.length ? magnitude : LOG.length - 1];
}

/**
 * What all positions of a band have in common.
 * @typedef {object} BandPlace
 * @property {number} kind background 0, texture 1, mode 2
 * @property {number} plane
 * @property {number} level
 * @property {number} orientation lowpass 3
 * @property {number} pictures modes before this one
 */

/** A network that gives the probabilities of decisions. */
export class ProbabilityNetwork {
  /**
   * @param {Weights} weights
   * @param {number} features of a position; two more are of the pass
   * @param {number} hidden
   */
  constructor(weights, features, hidden) {
    this.features = features;
    this.hidden = hidden;
    this.outputs = weights.last.length / (hidden + 1);
    this.weights = weights;
    this.shared = new Int32Array(hidden);
    this.sums = new Int32Array(hidden);
    this.logits = new Float64Array(this.outputs);
  }

  /**
   * Begin a pass of a grid.
   * @param {BandPlace} band
   * @param {number} pass
   * @param {number} height of the grid
   */
  startPass(band, pass, height) {
    const { classes, features } = this.weights;
    const rows = [
      band.kind,
      CLASS_STARTS.plane + band.plane,
      CLASS_STARTS.level + band.level,
      CLASS_STARTS.orientation + band.orientation,
      CLASS_STARTS.pass + pass,
    ];
    const before = logOf(band.pictures);
    const tall = logOf(height);
    for (let j = 0; j < this.hidden; j++) {
      let sum = before * features[this.features * this.hidden + j];
      sum += tall * features[(this.features + 1) * this.hidden + j];
      for (const row of rows) sum += classes[row * this.hidden + j];
      this.shared[j] = sum;
    }
  }

  /**
   * Begin a position of a grid (height, width).
   * @param {number} row
   * @param {number} column
   * @param {number} height
   * @param {number} width
   */
  startPosition(row, column, height, width) {
    const { hidden, sums, shared } = this;
    const { classes } = this.weights;
    const r = (CLASS_STARTS.row + Math.floor((row * CELLS) / height)) * hidden;
    const c = (CLASS_STARTS.column + Math.floor((column * CELLS) / width)) * hidden;
    for (let j = 0; j < hidden; j++) sums[j] = shared[j] + classes[r + j] + classes[c + j];
  }

  /**
   * Add a feature of the position.
   * @param {number} index
   * @param {number} value
   */
  add(index, value) {
    if (!value) return;
    const { hidden, sums } = this;
    const { features } = this.weights;
    const magnitude = value < 0 ? -value : value;
    const log = LOG[magnitude < LOG.length ? magnitude : LOG.length - 1];
    const signed = value < 0 ? -log : log;
    for (let j = 0, at = index * hidden; j < hidden; j++, at++) sums[j] += signed * features[at];
  }

  /**
   * The probabilities of a zero, in 1 / 65536, for the features that have been added.
   * @param {Int32Array} zeros written from `start` on
   * @param {number} start
   */
  write(zeros, start) {
    const { hidden, sums, outputs, logits } = this;
    const { last } = this.weights;
    for (let o = 0; o < outputs; o++) logits[o] = last[hidden * outputs + o];
    for (let j = 0; j < hidden; j++) {
      const value = Math.min(sums[j] >> 9, MAX_HIDDEN);
      if (value <= 0) continue;
      for (let o = 0; o < outputs; o++) logits[o] += value * last[j * outputs + o];
    }
    for (let o = 0; o < outputs; o++) {
      const logit = Math.floor(logits[o] / 8192) + MAX_LOGIT;
      zeros[start + o] = SIGMOID[Math.min(Math.max(logit, 0), 2 * MAX_LOGIT)];
    }
  }
}

/** The networks of tile flags, of magnitudes and of signs. */
export class ProbabilityNetworks {
  /** @param {Map<string, Int32Array>} arrays by the names of docs/format.md, Weights */
  constructor(arrays) {
    const weights = (/** @type {string} */ name) => {
      const of = (/** @type {string} */ part) =>
        /** @type {Int32Array} */ (arrays.get(`${name}_${part}`));
      return { features: of("features"), classes: of("classes"), last: of("last") };
    };
    this.tiles = new ProbabilityNetwork(weights("tiles"), 21, 16);
    this.sizes = new ProbabilityNetwork(weights("sizes"), 21, 40);
    this.signs = new ProbabilityNetwork(weights("signs"), 14, 24);
  }
}
