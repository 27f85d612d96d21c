import { ByteReader } from "./bytes.js";
import { check, FormatError } from "./errors.js";

/**
 * A number is an integer.
 * @typedef {number | Float | boolean | string | Uint8Array | Value[] | Map<string, Value>} Value
 */

/** A floating-point number. */
export class Float {
  /** @param {number} value */
  constructor(value) {
    this.value = value;
  }
}

/**
 * The map in MessagePack bytes, every value in its shortest encoding.
 * @param {Uint8Array} data
 * @param {string} name of it, for messages
 */
export function parseMap(data, name) {
  const reader = new ByteReader(data, name);
  const value = parseValue(reader, 0);
  check(value instanceof Map, `${name} is no map`);
  check(!reader.left, `${name}: ${reader.left} bytes too many`);
  return value;
}

/**
 * @param {ByteReader} reader
 * @param {number} depth
 * @returns {Value}
 */
function parseValue(reader, depth) {
  check(depth < 4, `${reader.name} is too deep`);
  const head = reader.byte();
  if (head < 0x80) return head;
  if (head < 0x90) return map(reader, head - 0x80, depth);
  if (head < 0xa0) return array(reader, head - 0x90, depth);
  if (head < 0xc0) return new TextDecoder().decode(reader.take(head - 0xa0));
  switch (head) {
    case 0xc2:
      return false;
    case 0xc3:
      return true;
    case 0xc4:
      return reader.take(integer(reader, 1, 0));
    case 0xc5:
      return reader.take(integer(reader, 2, 256));
    case 0xc6:
      return reader.take(integer(reader, 4, 65536));
    case 0xca:
      return new Float(new DataView(reader.take(4).slice().buffer).getFloat32(0));
    case 0xcc:
      return integer(reader, 1, 128);
    case 0xcd:
      return integer(reader, 2, 256);
    case 0xce:
      return integer(reader, 4, 65536);
    case 0xdc:
      return array(reader, integer(reader, 2, 16), depth);
    case 0xde:
      return map(reader, integer(reader, 2, 16), depth);
  }
  throw new FormatError(`${reader.name} has a value of an unknown type`);
}

/**
 * An integer of so many bytes; what a shorter encoding holds is refused.
 * @param {ByteReader} reader
 * @param {number} bytes
 * @param {number} least
 */
function integer(reader, bytes, least) {
  let value = 0;
  for (const byte of reader.take(bytes)) value = value * 256 + byte;
  check(value >= least, `${reader.name} has a value that is not in its shortest encoding`);
  return value;
}

/**
 * @param {ByteReader} reader
 * @param {number} count
 * @param {number} depth
 */
function array(reader, count, depth) {
  return Array.from({ length: count }, () => parseValue(reader, depth + 1));
}

/**
 * @param {ByteReader} reader
 * @param {number} count
 * @param {number} depth
 */
function map(reader, count, depth) {
  /** @type {Map<string, Value>} */
  const fields = new Map();
  for (let i = 0; i < count; i++) {
    const key = parseValue(reader, depth + 1);
    check(typeof key === "string" && !fields.has(key), `${reader.name} has an unusable key`);
    fields.set(key, parseValue(reader, depth + 1));
  }
  return fields;
}
