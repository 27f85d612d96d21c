import { FormatError } from "../format/errors.js";
import { EVENTS, parsePacket } from "../format/packets.js";
import { Playout } from "./playout.js";

/** @typedef {import("../format/packets.js").Packet} Packet */
/** @typedef {import("../link/delivery_receiver.js").Arrival} Arrival */
/** @typedef {import("./playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {{packet: Packet, number: number, isControl: boolean, atS: number}} Held */

/** How long a missing packet is waited for once a later one is there. */
const WAIT_S = 0.5;
/** Packets that may wait for one that is missing. */
const MAX_HELD = 64;
/** A first frame packet farther ahead shows that the call was joined late. */
const FIRST_WINDOW = 9;

/** Turns what a link delivers, in any order and with gaps, into the faces of a live call. */
export class LivePlayout {
  constructor() {
    this.playout = new Playout();
    this.session = 0;
    /** @type {Held[]} in order, while one before them is missing */
    this.held = [];
    /** @type {number | null} number of the frame packet to release next */
    this.next = null;
    this.damages = 0;
  }

  /** The models in use and to come. */
  get models() {
    const { current, update } = this.playout.models;
    return [current, update].flatMap((each) => (each ? [each] : []));
  }

  /**
   * The frames that can be shown after an arrival.
   * @param {Arrival} arrival
   * @param {number} nowS
   * @returns {PlayoutFrame[]}
   */
  receive({ packet: data, number, session }, nowS) {
    if (session !== this.session) {
      this.session = session;
      this.playout = new Playout();
      this.held = [];
      this.next = null;
    }
    try {
      const packet = parsePacket(data);
      if (packet.kind === "model" || packet.kind === "layer" || number === null) {
        return this.playout.receive(packet, number);
      }
      this.#hold({ packet, number, isControl: packet.kind === "control", atS: nowS });
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      this.damages++;
    }
    return this.poll(nowS);
  }

  /** @param {Held} item */
  #hold(item) {
    const isSame = (/** @type {Held} */ each) =>
      each.number === item.number && each.isControl === item.isControl;
    if (this.held.some(isSame)) return;
    this.held.push(item);
    // A control packet comes before the frame packet with its number.
    this.held.sort((a, b) => a.number - b.number || Number(b.isControl) - Number(a.isControl));
    if (this.next === null) {
      const first = this.playout.newest + 1;
      const isNear = item.number >= first && item.number <= first + FIRST_WINDOW;
      this.next = isNear ? first : item.number;
    }
  }

  /**
   * The frames to show although nothing has come.
   * @param {number} nowS
   * @returns {PlayoutFrame[]}
   */
  poll(nowS) {
    const frames = [];
    while (this.held.length && this.#isReady(nowS)) {
      const item = /** @type {Held} */ (this.held.shift());
      this.next = Math.max(this.next ?? 0, item.number + (item.isControl ? 0 : 1));
      try {
        frames.push(...this.playout.receive(item.packet, item.number));
      } catch (error) {
        if (!(error instanceof FormatError)) throw error;
        this.damages++;
      }
    }
    return frames;
  }

  /** @param {number} nowS */
  #isReady(nowS) {
    const [first] = this.held;
    const isAwaited = first.isControl && this.playout.lostAt !== null;
    const isEnd = first.packet.kind === "control" && first.packet.event === EVENTS.END;
    if (this.next === null || first.number <= this.next || isAwaited) return true;
    if (this.held.length > MAX_HELD) return true;
    const oldest = Math.min(...this.held.map(({ atS }) => atS));
    return nowS >= oldest + (isEnd ? 2 * WAIT_S : WAIT_S);
  }
}
