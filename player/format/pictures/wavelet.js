/** @typedef {import("./bands.js").Pyramid} Pyramid */
/** @typedef {import("./bands.js").Band} Band */
/** @typedef {{height: number, width: number, values: Float64Array}} Plane */

const GAIN = 1.149604398860241;
/** The lifting steps: on which of two values, and by how much of its neighbours. */
const LIFTS = [
  { first: 0, factor: -0.443506852043971 },
  { first: 1, factor: -0.882911075530934 },
  { first: 0, factor: 0.052980118572961 },
  { first: 1, factor: 1.586134342059924 },
];
/** A value is reconstructed nearer to zero than the middle of its interval, by so many steps. */
const BIAS = 0.05;

/**
 * The plane of quantised coefficients, see docs/format.md, Wavelets.
 * @param {Pyramid} pyramid
 * @param {number} step
 * @returns {Plane}
 */
export function planeOf(pyramid, step) {
  let { height, width } = pyramid.lowpass;
  let values = new Float64Array(height * width);
  enter(values, width, 1, 0, 0, pyramid.lowpass, step, 0);
  for (const [across, down, both] of pyramid.details) {
    const lowpass = { height, width, values };
    height += down.height;
    width += across.width;
    values = new Float64Array(height * width);
    // A line of one sample alone has no high values, and is not scaled.
    const columnGain = across.width ? GAIN : 1;
    const rowGain = down.height ? GAIN : 1;
    enterLowpass(values, width, lowpass, 1 / (rowGain * columnGain));
    enter(values, width, 2, 0, 1, across, (step * columnGain) / rowGain, BIAS);
    enter(values, width, 2, 1, 0, down, (step * rowGain) / columnGain, BIAS);
    enter(values, width, 2, 1, 1, both, step * rowGain * columnGain, BIAS);
    if (across.width) liftColumns(values, height, width);
    if (down.height) liftRows(values, height, width);
  }
  return { height, width, values };
}

/**
 * Enter the lowpass plane into every other row and column.
 * @param {Float64Array} values written
 * @param {number} width
 * @param {Plane} plane
 * @param {number} gain
 */
function enterLowpass(values, width, plane, gain) {
  for (let i = 0, from = 0; i < plane.height; i++) {
    const start = 2 * i * width;
    for (let j = 0; j < plane.width; j++, from++) values[start + 2 * j] = gain * plane.values[from];
  }
}

/**
 * Enter a band, times a step, into every row and column, or every other one.
 * @param {Float64Array} values written
 * @param {number} width
 * @param {number} every
 * @param {number} row the first one
 * @param {number} column the first one
 * @param {Band} band
 * @param {number} step
 * @param {number} bias
 */
function enter(values, width, every, row, column, band, step, bias) {
  const { cells } = band;
  if (!cells) return;
  for (let i = 0; i < band.height; i++) {
    const start = (every * i + row) * width + column;
    for (let j = 0, at = band.place(i, 0); j < band.width; j++, at++) {
      const v = cells[at];
      if (v) values[start + every * j] = step * (v > 0 ? v - bias : v + bias);
    }
  }
}

/**
 * @param {Float64Array} values changed
 * @param {number} height
 * @param {number} width
 */
function liftColumns(values, height, width) {
  for (let i = 0; i < height; i++) {
    const start = i * width;
    for (const { first, factor } of LIFTS) {
      for (let j = first; j < width; j += 2) {
        const before = start + (j ? j - 1 : 1);
        const after = start + (j + 1 < width ? j + 1 : j - 1);
        values[start + j] += factor * (values[before] + values[after]);
      }
    }
  }
}

/**
 * @param {Float64Array} values changed
 * @param {number} height
 * @param {number} width
 */
function liftRows(values, height, width) {
  for (const { first, factor } of LIFTS) {
    for (let i = first; i < height; i += 2) {
      const own = i * width;
      const before = (i ? i - 1 : 1) * width;
      const after = (i + 1 < height ? i + 1 : i - 1) * width;
      for (let j = 0; j < width; j++)
        values[own + j] += factor * (values[before + j] + values[after + j]);
    }
  }
}
