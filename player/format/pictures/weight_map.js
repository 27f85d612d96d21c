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
  const rows = cellsAmong(height);
  const columns = cellsAmong(width);
  const weights = new Float64Array(height * width);
  for (let i = 0, to = 0; i < height; i++) {
    const top = rows.before[i] * SIDE;
    const bottom = Math.min(rows.before[i] + 1, SIDE - 1) * SIDE;
    const down = rows.part[i];
    for (let j = 0; j < width; j++, to++) {
      const left = columns.before[j];
      const right = Math.min(left + 1, SIDE - 1);
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

/**
 * The cell before the middle of each of so many pixels, and how far that is on the way to the next.
 * @param {number} count
 */
function cellsAmong(count) {
  const before = new Int32Array(count);
  const part = new Float64Array(count);
  for (let i = 0; i < count; i++) {
    const at = Math.min(Math.max(((i + 0.5) * SIDE) / count - 0.5, 0), SIDE - 1);
    before[i] = Math.floor(at);
    part[i] = at - before[i];
  }
  return { before, part };
}
