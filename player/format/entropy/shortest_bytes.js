import { check } from "../errors.js";

/** @typedef {import("./range_decoder.js").RangeDecoder} RangeDecoder */

/**
 * Refuse bytes that an encoder would not have written: it writes the fewest that name a point of the
 * final interval, and of these the lowest.
 * @param {RangeDecoder} decoder after all its decisions
 * @param {string} name of what was read, for the message
 */
export function checkShortest(decoder, name) {
  decoder.end(name);
  const { data, position, code, range } = decoder;
  const digits = Array.from(data, (byte) => byte.toString(16).padStart(2, "0"));
  const point = BigInt(`0x0${digits.join("")}`);
  const unit = 256n ** BigInt(position - data.length);
  const low = point * unit - BigInt(code);
  const isLowest = point === least(low, unit);
  const coarser = 256n * unit;
  const isShorter = data.length > 0 && least(low, coarser) * coarser < low + BigInt(range);
  check(isLowest && !isShorter, `${name} is not in its shortest encoding`);
}

/**
 * The least multiple of a unit, in units, that is a number or above it.
 * @param {bigint} number not negative
 * @param {bigint} unit
 */
function least(number, unit) {
  return (number + unit - 1n) / unit;
}
