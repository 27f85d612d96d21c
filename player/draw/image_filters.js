// Filters of planes (height, width, channels), row by row, as OpenCV's of the same names.

/**
 * Values (height, width, channels).
 * @typedef {{height: number, width: number, channels: number, values: Float32Array}} Raster
 */

/** From this standard deviation on a blur works on a raster of a quarter of the size. */
const COARSE_SIGMA = 8;
const REDUCTION = 4;

/**
 * @param {number} height
 * @param {number} width
 * @param {number} channels
 * @returns {Raster}
 */
export function emptyRaster(height, width, channels) {
  return { height, width, channels, values: new Float32Array(height * width * channels) };
}

/**
 * Blurred by a Gaussian of a standard deviation, pixels; mirrored at the edges.
 * @param {Raster} raster
 * @param {number} sigma
 * @returns {Raster}
 */
export function blurred(raster, sigma) {
  if (sigma >= COARSE_SIGMA && Math.min(raster.width, raster.height) >= 16 * REDUCTION) {
    const small = reduced(raster);
    // Reducing and enlarging blur by about these variances themselves.
    const own = (REDUCTION ** 2 - 1) / 12 + REDUCTION ** 2 / 6;
    const rest = Math.sqrt(sigma ** 2 - own) / REDUCTION;
    return resized(convolved(small, rest), raster.height, raster.width);
  }
  return convolved(raster, sigma);
}

/** @param {Raster} raster */
function reduced({ height, width, channels, values }) {
  const result = emptyRaster(Math.ceil(height / REDUCTION), Math.ceil(width / REDUCTION), channels);
  for (let i = 0; i < result.height; i++) {
    for (let j = 0; j < result.width; j++) {
      const rows = Math.min(REDUCTION, height - i * REDUCTION);
      const columns = Math.min(REDUCTION, width - j * REDUCTION);
      const at = (i * result.width + j) * channels;
      for (let k = 0; k < rows; k++) {
        const from = ((i * REDUCTION + k) * width + j * REDUCTION) * channels;
        for (let l = 0; l < columns * channels; l++) result.values[at + (l % channels)] += values[from + l];
      }
      for (let c = 0; c < channels; c++) result.values[at + c] /= rows * columns;
    }
  }
  return result;
}

/**
 * @param {Raster} raster
 * @param {number} sigma
 */
function convolved(raster, sigma) {
  const reach = Math.round(sigma * 8 + 1) >> 1;
  const weights = Array.from({ length: 2 * reach + 1 }, (_, i) =>
    Math.exp(-((i - reach) ** 2) / (2 * sigma ** 2)),
  );
  const sum = weights.reduce((total, weight) => total + weight);
  const kernel = Float64Array.from(weights, (weight) => weight / sum);
  return alongRows(transposed(alongRows(transposed(raster), kernel)), kernel);
}

/**
 * @param {Raster} raster
 * @returns {Raster}
 */
function transposed({ height, width, channels, values }) {
  const result = emptyRaster(width, height, channels);
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      for (let c = 0; c < channels; c++) {
        result.values[(j * height + i) * channels + c] = values[(i * width + j) * channels + c];
      }
    }
  }
  return result;
}

/**
 * @param {Raster} raster
 * @param {Float64Array} kernel
 * @returns {Raster}
 */
function alongRows({ height, width, channels, values }, kernel) {
  const reach = kernel.length >> 1;
  const result = emptyRaster(height, width, channels);
  const line = new Float64Array((width + 2 * reach) * channels);
  const last = Math.max(width - 1, 1);
  for (let i = 0; i < height; i++) {
    for (let j = -reach; j < width + reach; j++) {
      let at = Math.abs(j) % (2 * last);
      if (at > last) at = 2 * last - at;
      for (let c = 0; c < channels; c++) {
        line[(j + reach) * channels + c] = values[(i * width + Math.min(at, width - 1)) * channels + c];
      }
    }
    const size = width * channels;
    for (let k = 0; k < size; k++) {
      let sum = 0;
      for (let t = 0, at = k; t < kernel.length; t++, at += channels) sum += kernel[t] * line[at];
      result.values[i * size + k] = sum;
    }
  }
  return result;
}

/**
 * Resized, each value from the middles of the nearest ones linearly, edges repeated.
 * @param {Raster} raster
 * @param {number} height
 * @param {number} width
 * @returns {Raster}
 */
export function resized(raster, height, width) {
  if (raster.height === height && raster.width === width) return raster;
  const rows = middles(height, raster.height);
  const columns = middles(width, raster.width);
  const { channels, values } = raster;
  const result = emptyRaster(height, width, channels);
  for (let i = 0; i < height; i++) {
    const [top, bottom, down] = rows[i];
    for (let j = 0; j < width; j++) {
      const [left, right, across] = columns[j];
      for (let c = 0; c < channels; c++) {
        const at = (/** @type {number} */ row, /** @type {number} */ column) =>
          values[(row * raster.width + column) * channels + c];
        const upper = at(top, left) + across * (at(top, right) - at(top, left));
        const lower = at(bottom, left) + across * (at(bottom, right) - at(bottom, left));
        result.values[(i * width + j) * channels + c] = upper + down * (lower - upper);
      }
    }
  }
  return result;
}

/**
 * For each of `count` middles the two of `known` around it, and how far it is between them.
 * @param {number} count
 * @param {number} known
 */
function middles(count, known) {
  return Array.from({ length: count }, (_, i) => {
    const at = Math.min(Math.max(((i + 0.5) * known) / count - 0.5, 0), known - 1);
    const low = Math.floor(at);
    return [low, Math.min(low + 1, known - 1), at - low];
  });
}

/**
 * The least, or the greatest, values within a square of an odd side around each.
 * @param {Raster} raster
 * @param {number} side
 * @param {(a: number, b: number) => number} pick
 */
export function extremes(raster, side, pick) {
  const reach = side >> 1;
  const across = (/** @type {Raster} */ { height, width, channels, values }) => {
    const result = emptyRaster(height, width, channels);
    for (let i = 0; i < height; i++) {
      for (let j = 0; j < width; j++) {
        for (let c = 0; c < channels; c++) {
          let found = values[(i * width + j) * channels + c];
          const end = Math.min(j + reach, width - 1);
          for (let k = Math.max(j - reach, 0); k <= end; k++) {
            found = pick(found, values[(i * width + k) * channels + c]);
          }
          result.values[(i * width + j) * channels + c] = found;
        }
      }
    }
    return result;
  };
  return transposed(across(transposed(across(raster))));
}
