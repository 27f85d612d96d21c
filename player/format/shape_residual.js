import { AdaptiveIntegers } from "./entropy/adaptive_models.js";
import { RangeDecoder } from "./entropy/range_decoder.js";
import { checkShortest } from "./entropy/shortest_bytes.js";
import { check } from "./errors.js";

/**
 * The codes (three of each point) of a range-coded residual shape.
 * @param {Uint8Array} data
 */
export function parseShapeResidual(data) {
  if (!data.length) return new Int8Array(0);
  check(data[0] > 0, "residual shape of no points");
  const codes = new Int8Array(3 * data[0]);
  const decoder = new RangeDecoder(data.subarray(1));
  const integers = new AdaptiveIntegers(3);
  for (let i = 0; i < codes.length; i++) {
    const code = integers.decode(decoder, i % 3);
    check(code >= -128 && code <= 127, `residual shape has a code of ${code}`);
    codes[i] = code;
  }
  checkShortest(decoder, "residual shape");
  return codes;
}
