import { SEQUENCE_MODULUS, sequenceStep } from "../format/packets.js";

/** A packet may be so far ahead of the newest; any other is behind it. */
const MAX_AHEAD = 40;
/** Numbers behind the newest that are known to have come or not. */
const WINDOW = 48;
/** A missing packet is asked for so long after it was noticed, then again, until it is given up. */
const ASK_AFTER_S = 0.03;
const ASK_AGAIN_S = 0.15;
const GIVE_UP_S = 2.5;
/** After a longer gap the packets missing are not asked for. */
const MAX_ASKED_GAP = 16;
const MAX_ASKED = 32;

/** The full numbers of frame packets: which are new, which are missing. */
export class FrameNumbers {
  /** @param {number} next number of the packet after those sent so far */
  constructor(next) {
    this.begin = next;
    this.newest = next - 1;
    /** @type {Set<number>} */
    this.come = new Set();
    /** @type {Map<number, {sinceS: number, askedS: number}>} */
    this.missing = new Map();
    this.taken = 0;
    this.repeated = 0;
  }

  /** Share of the packets that did not come the first time. */
  get loss() {
    return this.taken ? Math.min(this.repeated / this.taken, 1) : 0;
  }

  /**
   * The encoder has said which packet is next.
   * @param {number} next
   * @param {number} nowS
   */
  synchronise(next, nowS) {
    if (next <= this.newest + 1) return;
    this.#miss(this.newest + 1, next, nowS);
    this.newest = next - 1;
  }

  /**
   * The number of a packet that begins with a byte; null: it is not new.
   * @param {number} byte
   * @param {number} nowS
   */
  take(byte, nowS) {
    const ahead = sequenceStep(byte - this.newest);
    const behind = this.newest + ahead - SEQUENCE_MODULUS;
    const number = ahead > MAX_AHEAD || this.missing.has(behind) ? behind : this.newest + ahead;
    const isOld = number < this.begin || number <= this.newest - WINDOW || this.come.has(number);
    if (isOld) return null;
    this.taken++;
    if (this.missing.delete(number)) this.repeated++;
    if (number > this.newest) {
      this.#miss(this.newest + 1, number, nowS);
      this.newest = number;
      for (const each of this.come) if (each <= number - WINDOW) this.come.delete(each);
    }
    this.come.add(number);
    return number;
  }

  /**
   * A packet has come by another way, which delivers all of them in order.
   * @param {number} number
   */
  passBy(number) {
    this.missing.clear();
    this.newest = Math.max(this.newest, number);
  }

  /**
   * The packets to ask for now, ascending.
   * @param {number} nowS
   */
  toAsk(nowS) {
    const asked = [];
    for (const [number, missing] of [...this.missing].sort(([a], [b]) => a - b)) {
      if (nowS - missing.sinceS > GIVE_UP_S) this.missing.delete(number);
      else if (nowS >= missing.sinceS + ASK_AFTER_S && nowS >= missing.askedS + ASK_AGAIN_S) {
        asked.push(number);
      }
    }
    const newest = asked.slice(-MAX_ASKED);
    for (const number of newest) {
      const missing = this.missing.get(number);
      if (missing) missing.askedS = nowS;
    }
    return newest;
  }

  /**
   * @param {number} first
   * @param {number} end
   * @param {number} nowS
   */
  #miss(first, end, nowS) {
    if (end - first > MAX_ASKED_GAP) {
      if (this.come.size) return;
      first = end - MAX_ASKED_GAP;
    }
    for (let number = first; number < end; number++) {
      if (!this.missing.has(number)) this.missing.set(number, { sinceS: nowS, askedS: -Infinity });
    }
  }
}
