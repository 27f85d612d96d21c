import { AdaptiveBits } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";

/** Rows above and columns to the left of the cells of the context, the highest bit first. */
const CONTEXT = [
  [0, 1],
  [1, 1],
  [1, 0],
  [1, -1],
  [0, 2],
  [2, 0],
];

/**
 * The mask (side, side) of the person.
 * @param {Uint8Array} data
 * @param {number} side
 */
export function decodeMask(data, side) {
  const decoder = new RangeDecoder(data);
  const bits = AdaptiveBits.even(64);
  const mask = new Uint8Array(side * side);
  const cell = (/** @type {number} */ i, /** @type {number} */ j) =>
    i >= 0 && j >= 0 && j < side ? mask[i * side + j] : 0;
  for (let i = 0; i < side; i++) {
    for (let j = 0; j < side; j++) {
      let context = 0;
      for (const [up, left] of CONTEXT) context = 2 * context + cell(i - up, j - left);
      mask[i * side + j] = bits.decode(decoder, context);
    }
  }
  decoder.end("background: mask");
  return mask;
}
