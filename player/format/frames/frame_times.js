import { signedFrom } from "../bytes.js";
import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { checkShortest } from "../entropy/shortest_bytes.js";
import { check } from "../errors.js";

/** @typedef {import("../bytes.js").ByteReader} ByteReader */

/** Deviations are in ticks of so many in a frame. */
const TICKS_PER_FRAME = 16;
const MAX_TICKS = 2 ** 31 - 1;

/**
 * The deviations, ticks, of a TIMES packet after its frame.
 * @param {ByteReader} reader
 */
export function parseTimes(reader) {
  const ticks = [signedFrom(reader.varint())];
  check(Math.abs(ticks[0]) <= MAX_TICKS, `times packet: a deviation of ${ticks[0]} ticks`);
  const coder = new RangeDecoder(reader.rest());
  const integers = new AdaptiveIntegers(2);
  let step = 0;
  for (let left = coder.bits(6); left > 0; left--) {
    step = integers.decode(coder, step ? 1 : 0);
    ticks.push(ticks[ticks.length - 1] + step);
  }
  checkShortest(coder, "times packet");
  return ticks;
}

/** Tells when source frames are shown, from the TIMES packets of a call. */
export class FrameClock {
  constructor() {
    /** @type {Map<number, number>} deviation of each frame that is known */
    this.ticks = new Map();
    this.deviation = 0;
  }

  /**
   * Enter the times of a packet.
   * @param {number} first source frame of the first
   * @param {number[]} ticks
   */
  receive(first, ticks) {
    for (const [i, each] of ticks.entries()) this.ticks.set(first + i, each);
  }

  /**
   * The time of a source frame, seconds; frames are asked for in order.
   * @param {number} frame
   * @param {number} fps
   */
  timeOf(frame, fps) {
    for (const known of [...this.ticks.keys()]
      .filter((each) => each <= frame)
      .sort((a, b) => a - b)) {
      this.deviation = /** @type {number} */ (this.ticks.get(known));
      this.ticks.delete(known);
    }
    return (frame + this.deviation / TICKS_PER_FRAME) / fps;
  }
}
