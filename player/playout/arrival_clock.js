/** Packets that are remembered: ten seconds at three packets a second. */
const REMEMBERED = 32;
/** How long a missing packet is waited for, at least and at most, after the time it is expected. */
const MIN_WAIT_S = 0.4;
const MAX_WAIT_S = 1;

/** Relates the time of arrival to a packet's time in the call, that of its newest face. */
export class ArrivalClock {
  constructor() {
    /** @type {number[]} time of arrival less that in the call, of the newest packets */
    this.offsets = [];
    /** @type {number[]} of those that a later one had overtaken */
    this.overtaken = [];
  }

  /**
   * Note an arrival.
   * @param {number} callS the packet's time in the call
   * @param {number} arrivalS of the receiver's clock
   * @param {boolean} isOvertaken a later packet came before it, so it was probably sent again
   */
  note(callS, arrivalS, isOvertaken) {
    const offset = arrivalS - callS;
    this.offsets = [...this.offsets, offset].slice(-REMEMBERED);
    if (isOvertaken) this.overtaken = [...this.overtaken, offset].slice(-REMEMBERED);
  }

  /** When the call's time 0 would have arrived; null before the first arrival. */
  get startS() {
    return this.offsets.length ? Math.min(...this.offsets) : null;
  }

  /**
   * How long to wait for a packet after it is expected: as long as 95 of 100 packets take, and what
   * a repetition takes besides; the longest, while none has been repeated.
   */
  get waitS() {
    if (!this.overtaken.length) return MAX_WAIT_S;
    const startS = Math.min(...this.offsets);
    const lateS = quantile(this.offsets, 0.95) - startS;
    const repeatS = quantile(this.overtaken, 0.5) - startS;
    return Math.min(Math.max(lateS + repeatS, MIN_WAIT_S), MAX_WAIT_S);
  }

  /**
   * When a packet of this time in the call arrives if nothing delays it.
   * @param {number} callS
   */
  expectedS(callS) {
    return Math.min(...this.offsets) + callS;
  }
}

/**
 * The value below which a share of all values lies, interpolated linearly.
 * @param {number[]} values
 * @param {number} share
 */
function quantile(values, share) {
  const sorted = values.slice().sort((a, b) => a - b);
  const place = share * (sorted.length - 1);
  const low = Math.floor(place);
  const high = Math.min(low + 1, sorted.length - 1);
  return sorted[low] + (place - low) * (sorted[high] - sorted[low]);
}
