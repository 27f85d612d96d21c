import { check } from "../errors.js";

/** @typedef {import("./range_decoder.js").RangeDecoder} RangeDecoder */

const ONE = 65536;
const MAX_COUNT = 60;
const MIN_PROBABILITY = 96;
const LONGEST = 14;

/** Contexts whose probabilities follow the decisions, see docs/format.md, Integers. */
export class AdaptiveBits {
  /**
   * @param {ArrayLike<number>} zeros probability of a zero in each context at first, in 1 / 65536
   * @param {number} count of decisions that each context stands for at first
   */
  constructor(zeros, count = 0) {
    this.zeros = Int32Array.from(zeros);
    this.counts = new Uint8Array(zeros.length).fill(count);
  }

  /**
   * So many contexts of even odds.
   * @param {number} contexts
   */
  static even(contexts) {
    return new AdaptiveBits(new Int32Array(contexts).fill(ONE / 2));
  }

  /**
   * The next decision, in a context.
   * @param {RangeDecoder} decoder
   * @param {number} context
   */
  decode(decoder, context) {
    const zero = this.zeros[context];
    const count = this.counts[context];
    const bit = decoder.bit(zero);
    const moved = zero + Math.floor(((bit ? 0 : ONE) - zero) / (count + 2));
    this.zeros[context] = Math.min(Math.max(moved, MIN_PROBABILITY), ONE - MIN_PROBABILITY);
    if (count < MAX_COUNT) this.counts[context] = count + 1;
    return bit;
  }
}

/** Signed integers in adaptive contexts. */
export class AdaptiveIntegers {
  /** @param {number} contexts */
  constructor(contexts) {
    this.lengths = AdaptiveBits.even(contexts * (LONGEST + 1));
  }

  /**
   * The next integer, in a context.
   * @param {RangeDecoder} decoder
   * @param {number} context
   */
  decode(decoder, context) {
    let length = 0;
    while (this.lengths.decode(decoder, context * (LONGEST + 1) + length)) {
      length++;
      check(length <= LONGEST, "a value is too large");
    }
    if (!length) return 0;
    const magnitude = 2 ** length + decoder.bits(length) - 1;
    return decoder.evenBit() ? -magnitude : magnitude;
  }
}
