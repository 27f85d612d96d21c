import { NO_CHANGE } from "./layer_cells.js";
import { toByte } from "./local_colours.js";

/** @typedef {{gain: number, offset: number, pivot: number}} Light */

/**
 * The change of a frame as a picture (rows, columns, 4) of grey levels, 128 more than what is
 * added; null: nothing is.
 * @param {Float32Array[]} changes each (rows, columns, 3)
 * @param {{rows: number, columns: number}} size
 * @param {number[]} coefficients
 */
export function changeOf(changes, { rows, columns }, coefficients) {
  if (!changes.length) return null;
  const picture = new Uint8ClampedArray(4 * rows * columns);
  let isChanged = false;
  for (let at = 0; at < rows * columns; at++) {
    for (let c = 0; c < 3; c++) {
      let grey = NO_CHANGE;
      for (const [k, change] of changes.entries()) grey += coefficients[k] * change[3 * at + c];
      picture[4 * at + c] = toByte(grey);
      isChanged ||= picture[4 * at + c] !== NO_CHANGE;
    }
  }
  return isChanged ? picture : null;
}
