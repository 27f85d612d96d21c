/**
 * Integers (height, width) of a subband, row by row.
 * @typedef {{height: number, width: number, values: Int32Array}} Band
 */
/**
 * The coefficients of a plane; details: three bands a level, the coarsest level first.
 * @typedef {{lowpass: Band, details: Band[][]}} Pyramid
 */

export const LEVELS = 5;

/**
 * @param {number} height
 * @param {number} width
 * @returns {Band}
 */
export function emptyBand(height, width) {
  return { height, width, values: new Int32Array(height * width) };
}

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
      emptyBand(low[0], high[1]),
      emptyBand(high[0], low[1]),
      emptyBand(high[0], high[1]),
    ]);
    [height, width] = low;
  }
  return { lowpass: emptyBand(height, width), details };
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
 * A pyramid of a function of each band.
 * @param {Pyramid} pyramid
 * @param {(band: Band, level: number, orientation: number) => Band} function_
 * @returns {Pyramid}
 */
export function mapBands(pyramid, function_) {
  const details = pyramid.details.map((level, i) =>
    level.map((band, o) => function_(band, i + 1, o)),
  );
  return { lowpass: function_(pyramid.lowpass, 0, 0), details };
}

/**
 * @param {Band} band
 * @returns {Band}
 */
export function magnitudes(band) {
  const values = new Int32Array(band.values.length);
  for (let i = 0; i < values.length; i++) values[i] = Math.abs(band.values[i]);
  return { ...band, values };
}

/**
 * Add the values of a band, or each of them repeated along both axes, where there are any.
 * @param {Int32Array} target (height, width)
 * @param {number} height
 * @param {number} width
 * @param {Band} band
 * @param {number} repeat 1 or 2
 */
export function addBand(target, height, width, band, repeat) {
  const rows = Math.min(height, band.height * repeat);
  const columns = Math.min(width, band.width * repeat);
  const shift = repeat - 1;
  for (let i = 0; i < rows; i++) {
    const from = (i >> shift) * band.width;
    for (let j = 0; j < columns; j++) target[i * width + j] += band.values[from + (j >> shift)];
  }
}

/**
 * Sums of the eight neighbours of each value.
 * @param {Band} band
 * @returns {Band}
 */
export function ringSums(band) {
  const sums = emptyBand(band.height, band.width);
  for (let i = 0; i < band.height; i++) {
    for (let j = 0; j < band.width; j++) {
      let sum = -band.values[i * band.width + j];
      for (let k = Math.max(i - 1, 0); k <= Math.min(i + 1, band.height - 1); k++) {
        for (let l = Math.max(j - 1, 0); l <= Math.min(j + 1, band.width - 1); l++) {
          sum += band.values[k * band.width + l];
        }
      }
      sums.values[i * band.width + j] = sum;
    }
  }
  return sums;
}
