import { check, FormatError } from "./errors.js";

/** Most bytes of a varint. */
const MAX_VARINT_BYTES = 5;
const MAX_VARINT = 2 ** 32 - 1;

/** Reads bytes from front to back. */
export class ByteReader {
  /**
   * @param {Uint8Array} data
   * @param {string} name of what is read, for messages
   */
  constructor(data, name) {
    this.data = data;
    this.name = name;
    this.position = 0;
  }

  /** Number of bytes that have not been read. */
  get left() {
    return this.data.length - this.position;
  }

  /** The next byte. */
  byte() {
    check(this.left >= 1, `${this.name} ends too early`);
    return this.data[this.position++];
  }

  /**
   * The next bytes.
   * @param {number} count
   */
  take(count) {
    check(count <= this.left, `${this.name} ends too early`);
    this.position += count;
    return this.data.subarray(this.position - count, this.position);
  }

  /** All bytes that are left. */
  rest() {
    return this.take(this.left);
  }

  /** An integer from 0 to 2^32 - 1 in groups of seven bits, see docs/format.md, Notation. */
  varint() {
    let value = 0;
    for (let i = 0; i < MAX_VARINT_BYTES; i++) {
      const byte = this.byte();
      value += (byte & 0x7f) * 128 ** i;
      if (byte < 0x80) {
        check(byte > 0 || i === 0, `${this.name}: a varint has a byte too many`);
        check(value <= MAX_VARINT, `${this.name}: a varint is too large`);
        return value;
      }
    }
    throw new FormatError(`${this.name}: a varint is too long`);
  }

  /**
   * A part after its length.
   * @param {string} part its name, for messages
   * @param {number} limit of its length, bytes
   */
  part(part, limit) {
    const length = this.varint();
    check(length <= limit, `${this.name}: ${part} of ${length} bytes, limit ${limit}`);
    return this.take(length);
  }
}

/**
 * An integer whose sign is its lowest bit: 2 n, or -2 n - 1 if n is negative.
 * @param {number} code
 */
export function signedFrom(code) {
  return code % 2 ? -(code + 1) / 2 : code / 2;
}

/**
 * Whether two byte strings are equal.
 * @param {Uint8Array} first
 * @param {Uint8Array} second
 */
export function sameBytes(first, second) {
  return first.length === second.length && first.every((byte, i) => byte === second[i]);
}
