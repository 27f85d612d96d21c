import { FormatError } from "../format/errors.js";
import { VOICES } from "../format/model_packet.js";
import { parsePacket } from "../format/packets.js";
import { SmoothReturn } from "./concealment.js";
import { EncoderSession } from "./encoder_session.js";
import { SPEECH_RATE_HZ } from "./frame_decoder.js";
import { MAX_GAP_S } from "./playout.js";
import { isSamePicture } from "./received_models.js";

/** @typedef {import("../link/delivery_receiver.js").Arrival} Arrival */
/** @typedef {import("../model/parameters.js").Face} Face */
/** @typedef {import("./playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {import("./received_models.js").ReceivedModel} ReceivedModel */

/**
 * The receiving end of a link: what arrives in any order, and time, become faces in order.
 *
 * Frame packets with a number are put in order and waited for.  Where an encoder starts again the call goes on with its new model,
 * in the place where it would be had nothing happened.
 */
export class Receiver {
  /**
   * @param {(error: FormatError) => void} onDamage called with what is wrong with a packet that is
   *     damaged or contradicts the call; the others take effect
   */
  constructor(onDamage = () => {}) {
    this.onDamage = onDamage;
    /** packets that were damaged or contradicted the call */
    this.damages = 0;
    /** the start of the encoder whose frames are shown, and the newest */
    this.shown = new EncoderSession();
    this.heard = this.shown;
    this.shown.offset = 0;
    this.session = 0;
    /** the source frame to show next */
    this.nextFrame = 0;
    this.smoothReturn = new SmoothReturn();
  }

  /** The models in use and to come. */
  get models() {
    const { current, next } = this.heard.playout.models;
    return [current, next].flatMap((each) => (each ? [each] : []));
  }

  /** Whether the END packet has been received. */
  get ended() {
    return this.heard.playout.ended;
  }

  /** The codec of the voice of the call, one of `VOICES`; off before its model. */
  get voice() {
    return this.heard.playout.models.current?.model.call.voice ?? VOICES.OFF;
  }

  /**
   * The speech that has come since asked before, in the codec Opus, and when each frame of 40 ms is
   * heard, seconds from the start of the source.
   */
  takeSpeech() {
    const { playout, offset } = this.shown;
    const fps = playout.models.current?.model.call.fps ?? 1;
    const startS = (offset ?? 0) / fps;
    return playout.takeSpeech().map(({ index, data }) => ({
      timeS: startS + index / SPEECH_RATE_HZ,
      data,
    }));
  }

  /**
   * The frames that can be shown after an arrival.
   * @param {Arrival} arrival
   * @param {number} nowS
   * @returns {PlayoutFrame[]}
   */
  receive({ packet, number, session }, nowS) {
    if (session < this.session) return [];
    if (session > this.session) {
      this.heard = new EncoderSession();
      this.session = session;
    }
    this.#guarded(() => this.heard.enter(parsePacket(packet), number, nowS));
    return this.#released(nowS);
  }

  /**
   * The frames to show although nothing has come.
   * @param {number} nowS
   * @returns {PlayoutFrame[]}
   */
  poll(nowS) {
    const frames = this.#released(nowS);
    const due = this.shown.frameDue(nowS);
    if (due !== null && this.shown.playout.lostAt === null && !this.ended) {
      frames.push(...this.#heldUntil((this.shown.offset ?? 0) + due));
    }
    return frames;
  }

  /** @param {() => void} act what may meet damage */
  #guarded(act) {
    try {
      act();
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      this.damages++;
      this.onDamage(error);
    }
  }

  /**
   * The frames of all packets whose turn it is, with their place in the call.
   * @param {number} nowS
   */
  #released(nowS) {
    const { heard } = this;
    /** @type {PlayoutFrame[]} */
    const frames = [];
    while (heard.isReady(nowS)) {
      this.#guarded(() => {
        for (const frame of heard.take(nowS)) frames.push(...this.#placed(heard, frame));
        const repaired = heard.playout.takeRepaired();
        if (repaired) this.smoothReturn.correct(repaired);
      });
    }
    return frames;
  }

  /**
   * A session's frame in its place in the call, behind those that are held up to there.
   * @param {EncoderSession} session
   * @param {PlayoutFrame} frame
   * @returns {PlayoutFrame[]}
   */
  #placed(session, frame) {
    const { call } = frame.received.model;
    /** @type {PlayoutFrame[]} */
    let held = [];
    if (session.offset === null) {
      if (frame.index < call.startFrame) return [];
      session.offset = this.#offsetOf(session, frame);
      held = this.#heldUntil(session.offset + frame.index);
      this.smoothReturn.interrupt();
      this.shown = session;
    }
    const index = session.offset + frame.index;
    const timeS = session.offset / call.fps + frame.timeS;
    this.nextFrame = index + 1;
    const face = this.smoothReturn.show(frame.face, call.focalPx);
    return [...held, { ...frame, index, timeS, face }];
  }

  /**
   * The face shown last, as lost, for every source frame before `end`; of a longer gap those at its
   * end.
   * @param {number} end
   */
  #heldUntil(end) {
    const { shown: face } = this.smoothReturn;
    const { playout, offset } = this.shown;
    const received = playout.models.current;
    /** @type {PlayoutFrame[]} */
    const frames = [];
    if (!face || !received) return frames;
    const most = Math.ceil(MAX_GAP_S * received.model.call.fps);
    this.nextFrame = Math.max(this.nextFrame, end - most);
    for (; this.nextFrame < end; this.nextFrame++) {
      this.smoothReturn.interrupt();
      playout.skipTo(this.nextFrame + 1 - (offset ?? 0));
      frames.push(this.#heldFrame(received, face));
    }
    return frames;
  }

  /**
   * @param {ReceivedModel} received
   * @param {Face} face
   * @returns {PlayoutFrame}
   */
  #heldFrame(received, face) {
    const { playout, offset } = this.shown;
    const { fps } = received.model.call;
    const index = this.nextFrame;
    const begin = offset ?? 0;
    const timeS = begin / fps + playout.clock.timeOf(index - begin, fps);
    const flags = { isFrozen: true, isLost: true, presence: 1, residual: null };
    return { index, face, received, timeS, ...flags };
  }

  /**
   * The offset of a session whose first picture is this one.  Pictures of another size or rate begin
   * a call of their own.
   * @param {EncoderSession} session
   * @param {PlayoutFrame} first
   */
  #offsetOf(session, first) {
    const before = this.shown.playout.models.current?.model.call;
    if (!before) return 0;
    if (!isSamePicture(before, first.received.model.call)) {
      this.smoothReturn = new SmoothReturn();
      this.nextFrame = 0;
      return 0;
    }
    const [earlier, later] = [this.shown.clock.startS, session.clock.startS];
    let elapsed = 0;
    if (earlier !== null && later !== null) {
      elapsed = (this.shown.offset ?? 0) + Math.round((later - earlier) * before.fps);
    }
    return Math.max(elapsed, this.nextFrame - first.index);
  }
}
