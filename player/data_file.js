import { check } from "./format/errors.js";

/** @typedef {Map<string, Float32Array | Int32Array | Int16Array | Uint8Array>} Arrays */

/** @type {Record<string, new (buffer: ArrayBuffer) => Float32Array | Int32Array | Int16Array | Uint8Array>} */
const TYPES = { float32: Float32Array, int32: Int32Array, int16: Int16Array, uint8: Uint8Array };

/**
 * The arrays of the player's data file, by name: the head, the weights of the format, and
 * what is compiled.
 *
 * The file is a head of JSON after its length (four bytes, the lowest first), an array of [name,
 * type, number of values], then their values, little-endian.  Those of int16 are differences, each
 * from the value before: the low bytes of all, then the high ones, of 2 d, or -2 d - 1 if d < 0.
 * `assets.build_player_data` writes it.
 * @param {ArrayBuffer} file
 * @returns {Arrays}
 */
export function readDataFile(file) {
  const length = new DataView(file).getUint32(0, true);
  const list = JSON.parse(new TextDecoder().decode(new Uint8Array(file, 4, length)));
  /** @type {Arrays} */
  const arrays = new Map();
  let start = 4 + length;
  for (const [name, type, count] of list) {
    const Type = TYPES[type];
    const size = count * /** @type {any} */ (Type).BYTES_PER_ELEMENT;
    check(start + size <= file.byteLength, "the player's data file is cut off");
    const bytes = file.slice(start, start + size);
    arrays.set(name, type === "int16" ? integersFrom(new Uint8Array(bytes)) : new Type(bytes));
    start += size;
  }
  return arrays;
}

/**
 * An array of the file.
 * @param {Arrays} data
 * @param {string} name
 */
export function array(data, name) {
  const found = data.get(name);
  check(found, `the player's data file lacks ${name}`);
  return found;
}

/** @param {Uint8Array} bytes of int16 */
function integersFrom(bytes) {
  const values = new Int16Array(bytes.length / 2);
  let value = 0;
  for (let i = 0; i < values.length; i++) {
    const code = bytes[i] + 256 * bytes[values.length + i];
    value += code % 2 ? -(code + 1) / 2 : code / 2;
    values[i] = value;
  }
  return values;
}
