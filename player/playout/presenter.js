/** Over so long the time that frames need is looked back. */
const WINDOW_S = 3;
const MARGIN_S = 0.01;
/** By so much a frame the delay shrinks that is longer than needed. */
const SHRINK_S = 0.0004;
/** Frames that wait at most. */
const MAX_QUEUED = 250;

/**
 * Shows the frames of a live call at the distances at which they were taken: each so late that
 * those of the last seconds did not miss their turn.
 * @template {{timeS: number}} T
 */
export class Presenter {
  constructor() {
    /** @type {T[]} */
    this.queue = [];
    /** @type {number | null} from the time in the call to that of the page */
    this.offset = null;
    /** @type {{atS: number, needs: number}[]} */
    this.late = [];
    this.lastS = -Infinity;
  }

  /**
   * Frames have come.
   * @param {T[]} frames
   * @param {number} nowS
   */
  push(frames, nowS) {
    for (const frame of frames) this.#push(frame, nowS);
    this.queue.splice(0, this.queue.length - MAX_QUEUED);
  }

  /**
   * @param {T} frame
   * @param {number} nowS
   */
  #push(frame, nowS) {
    const isJump = frame.timeS < this.lastS - 1 || frame.timeS > this.lastS + 5;
    if (isJump) {
      this.late = [];
      this.offset = null;
      this.queue = [];
    }
    this.lastS = frame.timeS;
    this.late.push({ atS: nowS, needs: nowS - frame.timeS + MARGIN_S });
    while (this.late[0].atS < nowS - WINDOW_S) this.late.shift();
    const enough = this.late.reduce((most, { needs }) => Math.max(most, needs), -Infinity);
    if (this.offset === null || enough > this.offset) this.offset = enough;
    else this.offset = Math.max(enough, this.offset - SHRINK_S);
    this.queue.push(frame);
  }

  /**
   * The frame whose turn it is; null: none has come since.
   * @param {number} nowS
   */
  due(nowS) {
    let count = 0;
    while (count < this.queue.length && this.queue[count].timeS + (this.offset ?? 0) <= nowS)
      count++;
    const [frame] = count ? this.queue.splice(0, count).slice(-1) : [null];
    return frame;
  }
}
