import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { linearPlaces } from "./linear_places.js";

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
  const rows = linearPlaces(height, SIDE);
  const columns = linearPlaces(width, SIDE);
  const weights = new Float64Array(height * width);
  for (let i = 0, to = 0; i < height; i++) {
    const top = rows.low[i] * SIDE;
    const bottom = rows.high[i] * SIDE;
    const down = rows.part[i];
    for (let j = 0; j < width; j++, to++) {
      const left = columns.low[j];
      const right = columns.high[j];
      const across = columns.part[j];
      const upper = (1 - across) * cells[top + left] + across * cells[top + right];
      const lower = (1 - across) * cells[bottom + left] + across * cells[bottom + right];
      weights[to] = (1 - down) * upper + down * lower;
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
