import { check } from "../errors.js";

/** Slope a and range of each value, and its centre, see docs/format.md, Thesis profile. */
const ROWS = [
  [0.2, 60, 0],
  [0.2, 60, 0],
  [0.2, 60, 0],
  [0.3, 300, 0],
  [0.3, 300, 0],
  [0.001, 1, 0],
  [0.5 / 127, 0.5, 0.5],
  [1 / 127, 1, 0],
  [1 / 127, 1, 0],
  [1 / 127, 1, 0],
  [0.75 / 127, 0.75, 0.25],
  [0.75 / 127, 0.75, 0.25],
];
const MAX_CODE = 127;
/** Actuators that are sent after the six values of motion, the eyelids last. */
export const THESIS_EAUS = [0, 1, 2, 3, 6, 7];

/**
 * The values of a frame packet: motion, then those of `THESIS_EAUS`.
 * @param {Uint8Array} payload
 * @param {boolean} hasEyelids
 */
export function parseThesisPayload(payload, hasEyelids) {
  const expected = hasEyelids ? 12 : 10;
  check(payload.length === expected, `thesis frame has ${payload.length} bytes, not ${expected}`);
  check(!payload.includes(0), "thesis frame has a code of -128");
  return Float64Array.from(payload, (byte, i) => {
    const [a, range, centre] = ROWS[i];
    const size = Math.abs(byte - 128);
    const b = (range - MAX_CODE * a) / MAX_CODE ** 2;
    return centre + Math.sign(byte - 128) * (a * size + b * size ** 2);
  });
}
