import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";

const SIDE = 12;

/**
 * The weights (SIDE, SIDE) of a weight map, which lie linearly between these; null if all are 1.
 * @param {Uint8Array} data
 */
export function decodeWeightMap(data) {
  if (!data.length) return null;
  const decoder = new RangeDecoder(data);
  const integers = new AdaptiveIntegers(3);
  const codes = new Int32Array(SIDE * SIDE);
  for (let i = 0; i < SIDE; i++) {
    for (let j = 0; j < SIDE; j++) {
      const above = i ? codes[(i - 1) * SIDE + j] : 0;
      const left = j ? codes[i * SIDE + j - 1] : 0;
      const context = Math.min(2, Math.abs(above - left));
      codes[i * SIDE + j] = (j ? left : above) + integers.decode(decoder, context);
    }
  }
  decoder.end("weight map");
  return Float64Array.from(codes, (code) => 2 ** Math.min(Math.max(code / 2, -1), 1.5));
}
