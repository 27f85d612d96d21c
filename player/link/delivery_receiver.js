import { sameBytes } from "../format/bytes.js";
import { KINDS, kindOf, SEQUENCE_MODULUS } from "../format/packets.js";
import { FrameNumbers } from "./frame_numbers.js";
import { ItemAssembly } from "./item_assembly.js";
import {
  byeOf,
  helloOf,
  isMessage,
  parseMessage,
  ROLES,
  reportOf,
  SESSION_BYTES,
} from "./messages.js";

/** @typedef {import("./messages.js").Hello} Hello */
/** @typedef {import("./messages.js").Piece} Piece */
/** @typedef {import("./protection.js").Protection} Protection */
/**
 * A packet that has come: of which start of the encoder, and its number; layers have none.
 * @typedef {{packet: Uint8Array, number: number | null, session: number}} Arrival
 */

const REPORT_S = 3;
const MIN_REPORT_S = 0.02;
/**
 * How late at most a piece is reported that was there already: a report has been lost, or the piece
 * is for another decoder.  Each one that follows on such a piece waits twice as long.
 */
const MAX_REPEAT_S = 1.28;
/** How often an encoder is asked that has not answered, and after what silence one that has. */
const ASK_S = 0.25;
const SILENT_S = 1;
/** After what silence another encoder may take the call over. */
const ENCODER_GONE_S = 2.5;
const MAX_WAITING = 256;

/** What the decoder's end of a link does, without input and output; time is an argument, seconds. */
export class DeliveryReceiver {
  /** @param {Protection} protection */
  constructor(protection) {
    this.protection = protection;
    /** @type {{session: Uint8Array, index: number, frames: FrameNumbers, items: ItemAssembly, hasModel: boolean, waiting: Arrival[]} | null} */
    this.call = null;
    this.sessions = 0;
    this.nonce = 0;
    this.heardS = -Infinity;
    this.askedS = -Infinity;
    this.reportedS = -Infinity;
    this.reportDueS = Infinity;
    this.repeatS = MIN_REPORT_S;
    this.hasLeft = false;
    /** @type {Uint8Array[]} */
    this.out = [];
  }

  /**
   * The packets that are complete with a payload.  Throws `FormatError` if it is damaged.
   * @param {Uint8Array} payload
   * @param {number} nowS
   * @returns {Arrival[]}
   */
  receive(payload, nowS) {
    const data = this.protection.unprotect(payload);
    if (!data) return [];
    if (!isMessage(data)) return this.#onFrame(data, nowS);
    const message = parseMessage(data);
    if (message.kind === "hello") this.#onHello(message, nowS);
    if (message.kind === "piece" && this.call) return this.#onPiece(this.call, message, nowS);
    if (message.kind === "bye") this.hasLeft ||= message.role === ROLES.ENCODER;
    return [];
  }

  /**
   * What is to be sent now.
   * @param {number} nowS
   */
  payloads(nowS) {
    const out = this.out.splice(0);
    const silence = this.call ? SILENT_S : ASK_S;
    if (nowS - this.heardS > silence && nowS - this.askedS > silence) {
      this.askedS = nowS;
      out.push(this.#hello(true, 0));
    }
    if (this.call) {
      const missing = this.call.frames.toAsk(nowS);
      if (missing.length || nowS >= Math.min(this.reportDueS, this.reportedS + REPORT_S)) {
        this.reportedS = nowS;
        this.reportDueS = Infinity;
        out.push(this.#report(this.call, missing));
      }
    }
    return out.map((data) => this.protection.protect(data));
  }

  /** What is sent when the page is left. */
  bye() {
    return this.protection.protect(byeOf(this.protection.session));
  }

  /**
   * @param {boolean} asks
   * @param {number} answers
   */
  #hello(asks, answers) {
    this.nonce = (this.nonce % 255) + 1;
    const echo = this.call?.session ?? new Uint8Array(SESSION_BYTES);
    return helloOf(this.protection.session, echo, { asks, nonce: this.nonce, answers });
  }

  /**
   * @param {NonNullable<DeliveryReceiver["call"]>} call
   * @param {number[]} missing
   */
  #report({ frames, items }, missing) {
    return reportOf(this.protection.session, {
      loss: frames.loss,
      frames: frames.newest + 1,
      below: items.below,
      missing,
      holdings: items.holdings(),
    });
  }

  /**
   * @param {Hello} hello
   * @param {number} nowS
   */
  #onHello(hello, nowS) {
    if (hello.role !== ROLES.ENCODER) return;
    // All decoders of a call hear what is said to one.
    const isMeant =
      hello.echo.every((byte) => !byte) || sameBytes(hello.echo, this.protection.session);
    if (!this.call || !sameBytes(this.call.session, hello.session)) {
      const isTaken = this.call && !this.hasLeft && nowS - this.heardS < ENCODER_GONE_S;
      if (isTaken || !isMeant) return;
      if (!sameBytes(hello.echo, this.protection.session)) {
        this.out.push(this.#hello(true, hello.nonce));
        return;
      }
      this.#begin(hello, nowS);
    }
    const call = /** @type {NonNullable<DeliveryReceiver["call"]>} */ (this.call);
    this.heardS = nowS;
    call.items.extend(hello.spans);
    call.frames.synchronise(hello.frames, nowS);
    if (hello.asks && isMeant) {
      this.out.push(this.#hello(false, hello.nonce));
      this.reportDueS = nowS;
    }
  }

  /**
   * @param {Hello} hello
   * @param {number} nowS
   */
  #begin(hello, nowS) {
    const items = new ItemAssembly();
    items.begin(hello.spans);
    const frames = new FrameNumbers(hello.frames);
    const index = this.sessions++;
    this.call = { session: hello.session, index, frames, items, hasModel: false, waiting: [] };
    this.hasLeft = false;
    this.reportDueS = nowS;
    this.protection.onPeer(hello.session);
  }

  /**
   * @param {NonNullable<DeliveryReceiver["call"]>} call
   * @param {Piece} piece
   * @param {number} nowS
   * @returns {Arrival[]}
   */
  #onPiece(call, piece, nowS) {
    this.heardS = nowS;
    this.repeatS = call.items.has(piece) ? Math.min(2 * this.repeatS, MAX_REPEAT_S) : MIN_REPORT_S;
    this.reportDueS = Math.min(this.reportDueS, Math.max(nowS, this.reportedS + this.repeatS));
    const found = [];
    for (const { number, packet } of call.items.add(piece)) {
      const kind = kindOf(packet);
      if (kind === KINDS.FRAME) call.frames.passBy(number);
      found.push({ packet, number: kind === KINDS.LAYER ? null : number, session: call.index });
      if (kind === KINDS.MODEL && !call.hasModel) {
        call.hasModel = true;
        found.push(...call.waiting.splice(0));
      }
    }
    return found;
  }

  /**
   * @param {Uint8Array} packet
   * @param {number} nowS
   * @returns {Arrival[]}
   */
  #onFrame(packet, nowS) {
    const { call } = this;
    if (!call || kindOf(packet) !== KINDS.FRAME) return [];
    this.heardS = nowS;
    const number = call.frames.take(packet[0] % SEQUENCE_MODULUS, nowS);
    if (number === null) return [];
    const arrival = { packet, number, session: call.index };
    if (call.hasModel) return [arrival];
    if (call.waiting.length < MAX_WAITING) call.waiting.push(arrival);
    return [];
  }
}
