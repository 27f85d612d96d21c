/** Over so long the time that frames need is looked back. */
const WINDOW_S = 3;
/** That time has slots, as long as a packet at least; of four and more the latest is left out of account, of six and more two. */
const SLOT_S = 0.5;
const LEFT_OUT = [4, 6];
/** By so much a frame the delay shrinks that is longer than needed. */
const SHRINK_S = 0.0004;
/** Whoever is so much later than needed catches up at once. */
const EXCESS_S = 0.15;
const KEPT_S = 0.02;
/** A time so much before or after the one that came last is a jump. */
const BACK_S = 1;
const AHEAD_S = 5;

/**
 * How long after its time in the source a frame is shown: so late that those of the last seconds did
 * not miss it.  Two slots of that time may: what comes later than the others is shown at once, and
 * does not delay the rest of the call.
 */
export class PlayoutDelay {
  constructor() {
    /** @type {number | null} from the time in the source to that of the page; null: not known yet */
    this.offset = null;
    /** @type {{atS: number, needsS: number}[]} of the last seconds */
    this.late = [];
    this.lastS = -Infinity;
  }

  /** Begin anew. */
  reset() {
    this.offset = null;
    this.late = [];
    this.lastS = -Infinity;
  }

  /**
   * What comes now has this time in the source, and can be shown so much later.  Returns whether the
   * times of what has come before have nothing to do with that: it is of another call, or has jumped.
   * @param {number} timeS
   * @param {number} nowS
   * @param {number} marginS
   */
  arrived(timeS, nowS, marginS) {
    const isJump = timeS < this.lastS - BACK_S || timeS > this.lastS + AHEAD_S;
    if (isJump) this.reset();
    this.lastS = timeS;
    const needsS = nowS - timeS + marginS;
    this.late.push({ atS: nowS, needsS });
    while (this.late[0].atS < nowS - WINDOW_S) this.late.shift();
    const enough = this.#enough() ?? needsS;
    if (this.offset === null || enough > this.offset) this.offset = enough;
    else if (enough < this.offset - EXCESS_S) this.offset = enough + KEPT_S;
    else if (enough < this.offset) this.offset = Math.max(enough, this.offset - SHRINK_S);
    return isJump;
  }

  #enough() {
    const slots = new Map();
    for (const { atS, needsS } of this.late) {
      const slot = Math.floor(atS / SLOT_S);
      slots.set(slot, Math.max(needsS, slots.get(slot) ?? needsS));
    }
    const latest = [...slots.values()].sort((a, b) => b - a);
    return latest[LEFT_OUT.filter((enough) => latest.length >= enough).length];
  }
}
