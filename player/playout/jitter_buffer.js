/** @typedef {import("../format/packets.js").Packet} Packet */
/**
 * A frame packet and its number, or a control packet and that of the frame packet after it.
 * @typedef {{number: number, packet: Packet, arrivalS: number}} NumberedPacket
 */

/** Packets that overtake each other on the way are no further apart than this. */
const REORDER_S = 0.06;
/** Packets that may wait for one that is missing; with more, the oldest no longer do. */
export const MAX_HELD = 64;

/** Puts packets in order, and holds them while one before them is missing and its deadline is not past. */
export class JitterBuffer {
  /** @param {(number: number) => number} deadlineS until which the frame packet with a number is waited for */
  constructor(deadlineS) {
    this.deadlineS = deadlineS;
    /** @type {number | null} number of the frame packet to release next; null before the first */
    this.next = null;
    /** no frame packets are sent until a control packet says so: it is not held */
    this.isIdle = false;
    /** @type {NumberedPacket[]} in order */
    this.held = [];
  }

  /**
   * Enter a packet; one that is there already is left out.
   * @param {NumberedPacket} item
   */
  add(item) {
    if (this.held.some((other) => orderOf(other) === orderOf(item))) return;
    this.held.push(item);
    this.held.sort((a, b) => orderOf(a) - orderOf(b));
  }

  /** When the first packet is released, whether or not those before it come; null: there is none. */
  get releaseS() {
    const [first] = this.held;
    if (!first || this.next === null) return null;
    const isAwaited = this.isIdle && first.packet.kind === "control";
    if (first.number <= this.next || isAwaited || this.held.length > MAX_HELD) {
      return first.arrivalS;
    }
    const oldestS = Math.min(...this.held.map(({ arrivalS }) => arrivalS));
    return Math.max(this.deadlineS(first.number - 1), oldestS + REORDER_S);
  }

  /**
   * Whether the next packet in order is there, or those before it are no longer waited for; a late
   * one is ready at once.
   * @param {number} nowS
   */
  isReady(nowS) {
    const { releaseS } = this;
    return releaseS !== null && nowS >= releaseS;
  }

  /** The next packet in order of those that are there; undefined: there is none. */
  take() {
    const item = this.held.shift();
    if (item) {
      const following = item.number + (item.packet.kind === "control" ? 0 : 1);
      this.next = Math.max(this.next ?? 0, following);
    }
    return item;
  }
}

/**
 * A control packet comes before the frame packet with its number.
 * @param {NumberedPacket} item
 */
function orderOf({ number, packet }) {
  return 2 * number + (packet.kind === "control" ? 0 : 1);
}
