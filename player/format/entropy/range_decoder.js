import { check } from "../errors.js";

const TOP_BYTES = 6;
const LEAST_RANGE = 2 ** 40;
const EVEN = 32768;

/** Reads binary decisions of given probabilities, see docs/format.md, Range decoder.
 *
 * Code and range are integers below 2^48, which numbers hold exactly. */
export class RangeDecoder {
  /** @param {Uint8Array} data */
  constructor(data) {
    this.data = data;
    this.position = TOP_BYTES;
    this.code = 0;
    for (let i = 0; i < TOP_BYTES; i++) this.code = this.code * 256 + (data[i] ?? 0);
    this.range = 2 ** 48;
  }

  /**
   * The next decision.
   * @param {number} zero its probability of being 0, in 1 / 65536
   */
  bit(zero) {
    const split = Math.floor(this.range / 65536) * zero;
    let bit = 0;
    if (this.code < split) {
      this.range = split;
    } else {
      bit = 1;
      this.code -= split;
      this.range -= split;
    }
    while (this.range < LEAST_RANGE) {
      this.code = this.code * 256 + (this.data[this.position] ?? 0);
      this.range *= 256;
      this.position++;
    }
    return bit;
  }

  /** A decision that is as likely 0 as 1. */
  evenBit() {
    return this.bit(EVEN);
  }

  /**
   * An integer of so many bits, the highest first.
   * @param {number} count
   */
  bits(count) {
    let value = 0;
    for (let i = 0; i < count; i++) value = 2 * value + this.bit(EVEN);
    return value;
  }

  /**
   * An integer from 0 to 2^(longest + 1) - 2.
   * @param {number} longest
   */
  expGolomb(longest) {
    let length = 0;
    while (this.bit(EVEN)) {
      length++;
      check(length <= longest, "a value is too large");
    }
    return 2 ** length + this.bits(length) - 1;
  }

  /**
   * Refuse bytes on which no decision has depended.
   * @param {string} name of what was read, for the message
   */
  end(name) {
    const unread = this.data.length - this.position;
    check(unread <= 0, `${name}: ${unread} bytes too many`);
  }
}
