/** @typedef {import("./bands.js").Pyramid} Pyramid */
/** @typedef {import("./bands.js").Band} Band */
/** @typedef {{height: number, width: number, values: Float64Array}} Plane */

const GAIN = 1.149604398860241;
const STEPS = [0.443506852043971, 0.882911075530934, 0.052980118572961, 1.586134342059924];
/** A value is reconstructed nearer to zero than the middle of its interval, by so many steps. */
const BIAS = 0.05;

/**
 * The plane of quantised coefficients, see docs/format.md, Wavelets.
 * @param {Pyramid} pyramid
 * @param {number} step
 * @returns {Plane}
 */
export function planeOf(pyramid, step) {
  let lowpass = dequantised(pyramid.lowpass, step, 0);
  for (const level of pyramid.details) {
    const [across, down, both] = level.map((band) => dequantised(band, step, BIAS));
    lowpass = joinRows(joinColumns(lowpass, across), joinColumns(down, both));
  }
  return lowpass;
}

/**
 * @param {Band} band
 * @param {number} step
 * @param {number} bias
 * @returns {Plane}
 */
function dequantised(band, step, bias) {
  const values = new Float64Array(band.values.length);
  for (let i = 0; i < values.length; i++) {
    const v = band.values[i];
    if (v) values[i] = step * (v > 0 ? v - bias : v + bias);
  }
  return { height: band.height, width: band.width, values };
}

/**
 * @param {Plane} low
 * @param {Plane} high
 * @returns {Plane}
 */
function joinColumns(low, high) {
  const width = low.width + high.width;
  const values = new Float64Array(low.height * width);
  const line = new Lines(low.width, high.width);
  for (let i = 0; i < low.height; i++) {
    line.join(low.values, i * low.width, 1, high.values, i * high.width, 1, values, i * width, 1);
  }
  return { height: low.height, width, values };
}

/**
 * @param {Plane} low
 * @param {Plane} high
 * @returns {Plane}
 */
function joinRows(low, high) {
  const { width } = low;
  const height = low.height + high.height;
  const values = new Float64Array(height * width);
  const line = new Lines(low.height, high.height);
  for (let j = 0; j < width; j++) {
    line.join(low.values, j, width, high.values, j, width, values, j, width);
  }
  return { height, width, values };
}

/** Joins low and high values along one line after another. */
class Lines {
  /**
   * @param {number} lows
   * @param {number} highs
   */
  constructor(lows, highs) {
    this.even = new Float64Array(lows);
    this.odd = new Float64Array(highs);
  }

  /**
   * @param {Float64Array} low
   * @param {number} lowStart
   * @param {number} lowStep
   * @param {Float64Array} high
   * @param {number} highStart
   * @param {number} highStep
   * @param {Float64Array} result
   * @param {number} start
   * @param {number} step
   */
  join(low, lowStart, lowStep, high, highStart, highStep, result, start, step) {
    const { even, odd } = this;
    const lows = even.length;
    const highs = odd.length;
    if (!highs) {
      for (let i = 0; i < lows; i++) result[start + i * step] = low[lowStart + i * lowStep];
      return;
    }
    for (let i = 0; i < lows; i++) even[i] = low[lowStart + i * lowStep] / GAIN;
    for (let i = 0; i < highs; i++) odd[i] = high[highStart + i * highStep] * GAIN;
    this.#liftEven(-STEPS[0]);
    this.#liftOdd(-STEPS[1]);
    this.#liftEven(STEPS[2]);
    this.#liftOdd(STEPS[3]);
    for (let i = 0; i < lows; i++) result[start + 2 * i * step] = even[i];
    for (let i = 0; i < highs; i++) result[start + (2 * i + 1) * step] = odd[i];
  }

  /** @param {number} factor */
  #liftEven(factor) {
    const { even, odd } = this;
    const last = odd.length - 1;
    for (let i = 0; i < even.length; i++) {
      even[i] += factor * (odd[i ? Math.min(i - 1, last) : 0] + odd[Math.min(i, last)]);
    }
  }

  /** @param {number} factor */
  #liftOdd(factor) {
    const { even, odd } = this;
    const last = even.length - 1;
    for (let i = 0; i < odd.length; i++) odd[i] += factor * (even[i] + even[Math.min(i + 1, last)]);
  }
}
