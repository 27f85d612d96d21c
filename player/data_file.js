import { check } from "./format/errors.js";

/** @typedef {Map<string, Float32Array | Int32Array | Int16Array | Uint8Array>} Arrays */

/** @type {Record<string, new (buffer: ArrayBuffer) => Float32Array | Int32Array | Int16Array | Uint8Array>} */
const TYPES = { float32: Float32Array, int32: Int32Array, int16: Int16Array, uint8: Uint8Array };

/**
 * The arrays of the player's data file, by name: the head, the weights of the format, and
 * what is compiled.
 *
 * The file is a head of JSON after its length (four bytes, the lowest first), an array of [name,
 * type, number of values], then their values, little-endian.  Of integers with a sign there are the
 * lowest bytes of all, then the next ones, of 2 d, or -2 d - 1 if d < 0; those of int16 are
 * differences, each from the value before.
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
    const values = new Type(bytes);
    if (type.startsWith("int")) readIntegers(new Uint8Array(bytes.slice(0)), values);
    arrays.set(name, values);
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

/**
 * @param {Uint8Array} bytes
 * @param {Float32Array | Int32Array | Int16Array | Uint8Array} values written
 */
function readIntegers(bytes, values) {
  const isDifference = values.BYTES_PER_ELEMENT === 2;
  let value = 0;
  for (let i = 0; i < values.length; i++) {
    let code = 0;
    for (let at = bytes.length - values.length + i; at >= 0; at -= values.length)
      code = 256 * code + bytes[at];
    const read = code % 2 ? -(code + 1) / 2 : code / 2;
    value = isDifference ? value + read : read;
    values[i] = value;
  }
}
