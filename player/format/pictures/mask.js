import { AdaptiveBits } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";

/** Zeros around the cells, so that those of a context need no test. */
const PAD = 2;

/**
 * The mask (side, side) of the person.
 * @param {Uint8Array} data
 * @param {number} side
 */
export function decodeMask(data, side) {
  const decoder = new RangeDecoder(data);
  const bits = AdaptiveBits.even(64);
  const across = side + 2 * PAD;
  const cells = new Uint8Array((side + PAD) * across);
  const mask = new Uint8Array(side * side);
  for (let i = 0, to = 0; i < side; i++) {
    for (let j = 0, at = (i + PAD) * across + PAD; j < side; j++, at++, to++) {
      const above = at - across;
      const near = 32 * cells[at - 1] + 16 * cells[above - 1] + 8 * cells[above];
      const far = 4 * cells[above + 1] + 2 * cells[at - 2] + cells[above - across];
      cells[at] = mask[to] = bits.decode(decoder, near + far);
    }
  }
  decoder.end("background: mask");
  return mask;
}
