import { check } from "../format/errors.js";
import { EVENTS, SEQUENCE_MODULUS } from "../format/packets.js";
import { ArrivalClock } from "./arrival_clock.js";
import { JitterBuffer, MAX_HELD } from "./jitter_buffer.js";
import { FIRST_WINDOW, Playout } from "./playout.js";

/** @typedef {import("../format/packets.js").Packet} Packet */
/** @typedef {import("./jitter_buffer.js").NumberedPacket} NumberedPacket */

/**
 * After so long a silence the last face is shown for the frames that do not come.  What comes within
 * that time, of a link that was away or of a slow encoder, is shown late but whole.
 */
const SILENCE_S = 30;

/** The packets of one start of an encoder, in order, with the times to wait. */
export class EncoderSession {
  constructor() {
    this.playout = new Playout();
    this.clock = new ArrivalClock();
    this.buffer = new JitterBuffer((number) => this.#deadlineS(number));
    /** @type {number | null} index of its source frame 0 in the call; null before its first picture */
    this.offset = null;
    this.newest = -1;
    /** when the newest frame packet arrived */
    this.heardS = 0;
    /** @type {{packet: Packet, number: number | null}[]} packets without an order */
    this.atOnce = [];
    /** @type {NumberedPacket[]} packets that wait for the model */
    this.early = [];
  }

  /**
   * Enter a packet as it arrives.
   * @param {Packet} packet
   * @param {number | null} number see `Arrival`
   * @param {number} arrivalS
   */
  enter(packet, number, arrivalS) {
    const isTimes = packet.kind === "control" && packet.event === EVENTS.TIMES;
    const hasOrder = packet.kind === "frame" || (packet.kind === "control" && !isTimes);
    if (number === null || !hasOrder) this.atOnce.push({ packet, number });
    else if (this.early.length < MAX_HELD) this.early.push({ packet, number, arrivalS });
  }

  /**
   * Whether it is a packet's turn.
   * @param {number} nowS
   */
  isReady(nowS) {
    const isEntered = this.early.length && this.playout.models.current;
    return this.atOnce.length > 0 || isEntered || this.buffer.isReady(nowS);
  }

  /**
   * The frames of the packet whose turn it is, if it is one's.  Throws `FormatError` if that packet
   * is damaged or contradicts the call.
   * @param {number} nowS
   */
  take(nowS) {
    const first = this.atOnce.shift();
    if (first) return this.playout.receive(first.packet, first.number);
    while (this.early.length && this.playout.models.current) {
      this.#putInOrder(/** @type {NumberedPacket} */ (this.early.shift()));
    }
    const item = this.buffer.isReady(nowS) ? this.buffer.take() : undefined;
    if (!item) return [];
    try {
      return this.playout.receive(item.packet, item.number);
    } finally {
      this.buffer.isIdle = this.playout.lostAt !== null;
    }
  }

  /**
   * The source frame that a silence since the newest packet has reached; null: not known.  An
   * encoder slower than its source is not silent as long as packets come.
   * @param {number} nowS
   */
  frameDue(nowS) {
    const { current } = this.playout.models;
    const silentS = nowS - this.heardS - SILENCE_S;
    if (!current || this.newest < 0 || silentS <= 0) return null;
    return Math.trunc((this.playout.timeS(this.newest) + silentS) * current.model.call.fps);
  }

  /**
   * Enter a packet with a number, once there is a model.
   * @param {NumberedPacket} item
   */
  #putInOrder(item) {
    if (item.packet.kind === "frame") this.#note(item.number, item.packet.sequence, item.arrivalS);
    else this.buffer.next ??= item.number;
    this.buffer.add(item);
  }

  /**
   * @param {number} number
   * @param {number} sequence
   * @param {number} arrivalS
   */
  #note(number, sequence, arrivalS) {
    const isSame = number % SEQUENCE_MODULUS === sequence;
    check(isSame, `frame packet ${number} has sequence number ${sequence}`);
    this.clock.note(this.playout.timeS(number), arrivalS, number < this.newest);
    if (number > this.newest) {
      this.newest = number;
      this.heardS = arrivalS;
    }
    const first = this.playout.newest + 1;
    const isNear = first <= number && number <= first + FIRST_WINDOW;
    this.buffer.next ??= isNear ? first : number;
  }

  /** @param {number} number */
  #deadlineS(number) {
    return this.clock.expectedS(this.playout.timeS(number)) + this.clock.waitS;
  }
}
