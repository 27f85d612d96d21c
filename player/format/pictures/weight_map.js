import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";

const SIDE = 12;

/**
 * The weights (height, width) of a weight map; null if all are 1.
 * @param {Uint8Array} data
 * @param {number} height
 * @param {number} width
 */
export function decodeWeightMap(data, height, width) {
  if (!data.length) return null;
  const cells = decodeCells(data);
  const rows = cellWeights(height);
  const columns = cellWeights(width);
  const weights = new Float64Array(height * width);
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const [top, down] = rows[i];
      const [left, across] = columns[j];
      const below = Math.min(top + 1, SIDE - 1);
      const right = Math.min(left + 1, SIDE - 1);
      const upper = (1 - across) * cells[top * SIDE + left] + across * cells[top * SIDE + right];
      const lower =
        (1 - across) * cells[below * SIDE + left] + across * cells[below * SIDE + right];
      weights[i * width + j] = (1 - down) * upper + down * lower;
    }
  }
  return weights;
}

/** @param {Uint8Array} data */
function decodeCells(data) {
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

/**
 * The cell before the middle of each pixel, and how far it is on the way to the next one.
 * @param {number} count
 * @returns {[number, number][]}
 */
function cellWeights(count) {
  return Array.from({ length: count }, (_, i) => {
    const at = Math.min(Math.max(((i + 0.5) * SIDE) / count - 0.5, 0), SIDE - 1);
    return [Math.floor(at), at - Math.floor(at)];
  });
}
