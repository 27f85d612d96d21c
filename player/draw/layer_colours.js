import { toByte } from "./local_colours.js";
import { resized } from "./image_filters.js";

/** @typedef {import("./background_pictures.js").Bitmap} Bitmap */
/** @typedef {import("./image_filters.js").Raster} Raster */
/** @typedef {{gain: number, offset: number, pivot: number}} Light */

/** The grey level of a change that stands for no change. */
const NO_CHANGE = 128;

/**
 * The change of a frame as a picture of grey levels, 128 more than what is added; null: none.
 * @param {Float32Array[]} changes each (rows, columns, 3)
 * @param {{rows: number, columns: number}} size
 * @param {number[]} coefficients
 * @returns {Raster | null}
 */
export function changeOf(changes, { rows, columns }, coefficients) {
  if (!changes.length) return null;
  const values = new Float32Array(3 * rows * columns).fill(NO_CHANGE);
  for (const [k, change] of changes.entries()) {
    for (let i = 0; i < values.length; i++) values[i] += coefficients[k] * change[i];
  }
  let isChanged = false;
  for (let i = 0; i < values.length; i++) {
    values[i] = toByte(values[i]);
    isChanged ||= values[i] !== NO_CHANGE;
  }
  return isChanged ? { height: rows, width: columns, channels: 3, values } : null;
}

/**
 * A layer with a change and then light on its colours.
 * @param {Bitmap} layer
 * @param {Raster | null} change
 * @param {Light | null} light
 * @returns {Bitmap}
 */
export function changedLayer(layer, change, light) {
  const values = new Uint8ClampedArray(layer.values);
  if (change) {
    const added = resized(change, layer.height, layer.width).values;
    for (let at = 0; at < layer.height * layer.width; at++) {
      for (let c = 0; c < 3; c++) values[4 * at + c] += Math.round(added[3 * at + c]) - NO_CHANGE;
    }
  }
  if (light && (light.gain !== 1 || light.offset)) {
    const table = Uint8ClampedArray.from({ length: 256 }, (_, grey) =>
      Math.round(light.gain * (grey - light.pivot) + light.pivot + light.offset),
    );
    for (let i = 0; i < values.length; i++) if (i % 4 < 3) values[i] = table[values[i]];
  }
  return { ...layer, values };
}
