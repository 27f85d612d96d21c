/**
 * The largest s in [0, 1] for which each corner of grid + s motion has an area of `minArea` or more.
 * @param {Float64Array} grid (rows, columns, 2)
 * @param {Float64Array} motion (rows, columns, 2)
 * @param {number} rows
 * @param {number} columns
 * @param {number} minArea
 */
export function maxUnfoldedStep(grid, motion, rows, columns, minArea) {
  let step = 1;
  const difference = (
    /** @type {Float64Array} */ values,
    /** @type {number} */ from,
    /** @type {number} */ to,
  ) => [values[2 * to] - values[2 * from], values[2 * to + 1] - values[2 * from + 1]];
  for (let i = 0; i < rows - 1; i++) {
    for (let j = 0; j < columns - 1; j++) {
      const first = i * columns + j;
      for (const across of [first, first + columns]) {
        const a = difference(grid, across, across + 1);
        const c = difference(motion, across, across + 1);
        for (const down of [first, first + 1]) {
          const b = difference(grid, down, down + columns);
          const d = difference(motion, down, down + columns);
          const root = firstRoot(cross(a, b) - minArea, cross(a, d) + cross(c, b), cross(c, d));
          if (root < step) step = root;
        }
      }
    }
  }
  return step;
}

/**
 * The least positive root of a polynomial that is positive at 0 and negative at 1, or may be.
 * @param {number} constant
 * @param {number} linear
 * @param {number} quadratic
 */
function firstRoot(constant, linear, quadratic) {
  if (constant <= 0 || constant + Math.min(linear, 0) + Math.min(quadratic, 0) >= 0)
    return Infinity;
  const square = linear ** 2 - 4 * quadratic * constant;
  if (square < 0) return Infinity;
  const root = Math.sqrt(square);
  const roots = [root - linear, -root - linear].filter((divisor) => divisor > 0);
  return Math.min(...roots.map((divisor) => (2 * constant) / divisor), Infinity);
}

/**
 * @param {number[]} a
 * @param {number[]} b
 */
function cross(a, b) {
  return a[0] * b[1] - a[1] * b[0];
}
