import { PlayoutDelay } from "./playout_delay.js";

const MARGIN_S = 0.01;
/** Frames that wait at most. */
const MAX_QUEUED = 250;

/**
 * Shows the frames of a live call at the distances at which they were taken, see `PlayoutDelay`.
 * @template {{timeS: number}} T
 */
export class Presenter {
  constructor() {
    /** @type {T[]} */
    this.queue = [];
    this.delay = new PlayoutDelay();
  }

  /**
   * Frames have come.
   * @param {T[]} frames
   * @param {number} nowS
   */
  push(frames, nowS) {
    for (const frame of frames) {
      if (this.delay.arrived(frame.timeS, nowS, MARGIN_S)) this.queue = [];
      this.queue.push(frame);
    }
    this.queue.splice(0, this.queue.length - MAX_QUEUED);
  }

  /**
   * The frame whose turn it is; null: none has come since.
   * @param {number} nowS
   */
  due(nowS) {
    const { offset } = this.delay;
    let count = 0;
    while (count < this.queue.length && this.queue[count].timeS + (offset ?? 0) <= nowS) count++;
    const [frame] = count ? this.queue.splice(0, count).slice(-1) : [null];
    return frame;
  }
}
