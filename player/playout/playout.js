import { check } from "../format/errors.js";
import { FrameClock } from "../format/frames/frame_times.js";
import { EVENTS, SEQUENCE_MODULUS, sequenceStep } from "../format/packets.js";
import { interpolate, withFocalChange } from "../model/geometry.js";
import { atRest, bridge, presence } from "./concealment.js";
import { ReceivedModels } from "./received_models.js";

/** @typedef {import("../format/packets.js").Packet} Packet */
/** @typedef {import("../model/parameters.js").Face} Face */
/** @typedef {import("./frame_decoder.js").CodedResidual} CodedResidual */
/** @typedef {import("./frame_decoder.js").TimedFace} TimedFace */
/** @typedef {import("./received_models.js").ReceivedModel} ReceivedModel */
/** Bytes of a frame of speech, 40 ms, and its number from source frame 0 on. @typedef {{index: number, data: Uint8Array}} SpeechFrame */
/**
 * The face of a source frame.
 * @typedef {object} PlayoutFrame
 * @property {number} index of the source frame
 * @property {Face} face
 * @property {ReceivedModel} received what it was decoded by
 * @property {number} timeS when it is shown, seconds from the start of the source
 * @property {boolean} isFrozen it repeats an older face: the encoder had none
 * @property {boolean} isLost its packet is missing
 * @property {number} presence how much of the person is shown
 * @property {CodedResidual | null} residual
 */

/** Speech frames that are kept until somebody takes them. */
const MAX_SPEECH = 250;
/** A packet up to so many numbers behind the newest is late. */
const LATE_WINDOW = 16;
/** A first frame packet farther ahead shows that the call was joined late. */
export const FIRST_WINDOW = 9;
/** A packet may be at most so far ahead of the last frame. */
export const MAX_GAP_S = 600;

/** Turns the packets of a call, in order, into the faces of its source frames. */
export class Playout {
  constructor() {
    this.models = new ReceivedModels();
    this.clock = new FrameClock();
    this.ended = false;
    this.lost = 0;
    this.joinedLate = false;
    this.begin = 0;
    this.next = 0;
    this.newest = -1;
    this.isNumbered = false;
    /** @type {TimedFace | null} */
    this.last = null;
    /** @type {number | null} source frame from which on the face is lost */
    this.lostAt = null;
    /** @type {number | null} source frame from which on nobody is there */
    this.goneAt = null;
    /** @type {Face | null} see `takeRepaired` */
    this.repaired = null;
    /** @type {SpeechFrame[]} see `takeSpeech` */
    this.speech = [];
  }

  /**
   * The frames that can be shown after a packet.  Throws `FormatError` if it contradicts the call.
   * @param {Packet} packet
   * @param {number | null} number of a frame packet, of the first one of a model, of the one after a
   *     control packet; null: its 6 bits tell
   * @returns {PlayoutFrame[]}
   */
  receive(packet, number = null) {
    if (packet.kind === "model") this.#receiveModel(packet.model, number);
    if (packet.kind === "layer") {
      this.models.receiveLayer(packet.version, packet.number, packet.data);
    }
    if (packet.kind === "control") return this.#receiveControl(packet, number);
    if (packet.kind === "frame") return this.#receiveFrame(packet.sequence, packet.payload, number);
    return [];
  }

  /**
   * @param {import("../format/model_packet.js").ModelPacket} model
   * @param {number | null} exact
   */
  #receiveModel(model, exact) {
    const isFirst = !this.models.current;
    const newest = isFirst ? model.sequence : this.newest;
    const first = exact ?? newest + sequenceStep(model.sequence - newest);
    if (isFirst) {
      this.newest = first - 1;
      if (model.version) this.#joinLate();
    }
    this.models.receiveModel(model, first);
  }

  #joinLate() {
    this.joinedLate = true;
    this.next = -1;
  }

  /**
   * @param {number} sequence
   * @param {Uint8Array} payload
   * @param {number | null} exact
   */
  #receiveFrame(sequence, payload, exact) {
    if (exact !== null) this.#hear(exact, payload);
    if (!this.models.current?.decoder.hasFace(payload)) return [];
    const number = this.#number(sequence, this.models.current, exact);
    const { newest } = this;
    if (number <= newest) {
      this.#receiveLate(number, payload);
      return [];
    }
    const { update } = this.models;
    if (update && number >= update.first) this.#activate(update);
    const received = /** @type {ReceivedModel} */ (this.models.current);
    const decoded = received.decoder.decode(number - received.first, payload);
    this.lost += number - newest - 1;
    this.newest = number;
    /** @type {PlayoutFrame[]} */
    const frames = [];
    for (const [place, timed] of decoded.faces.entries()) {
      const isGap = place === 0 && number - newest > 1;
      frames.push(...this.#framesUntil(received, timed, isGap));
      const isFrozen = this.lostAt !== null && this.last;
      this.last = { time: timed.time, face: isFrozen && this.last ? this.last.face : timed.face };
    }
    return frames.map((frame) => withResidual(frame, decoded.residual));
  }

  /**
   * Keep the speech of a packet with a number, unless it is late.
   * @param {number} number
   * @param {Uint8Array} payload
   */
  #hear(number, payload) {
    const { current, update } = this.models;
    const received = update && number >= update.first ? update : current;
    if (!received || number <= this.newest || number < received.first) return;
    this.speech.push(...received.decoder.speech(number - received.first, payload));
    this.speech.splice(0, this.speech.length - MAX_SPEECH);
  }

  /** The speech that has come since asked before, in the codec Opus. */
  takeSpeech() {
    const { speech } = this;
    this.speech = [];
    return speech;
  }

  /**
   * Let what was decoded without this packet become exact.
   * @param {number} number
   * @param {Uint8Array} payload
   */
  #receiveLate(number, payload) {
    const { current } = this.models;
    if (!current || number < current.first) return;
    const newest = current.decoder.repair(number - current.first, payload);
    if (!newest || !this.last || this.lostAt !== null) return;
    this.last = newest;
    if (this.next > newest.time) this.repaired = newest.face;
  }

  /** The face shown last as it truly was, if a late packet has told so since asked before. */
  takeRepaired() {
    const { repaired } = this;
    this.repaired = null;
    return repaired;
  }

  /**
   * Time in the call of the last face of a frame packet, seconds, once there is a model.
   * @param {number} number
   */
  timeS(number) {
    const { current, update } = this.models;
    const received = update && number >= update.first ? update : current;
    if (!received) throw new Error("a call has no times before its model");
    return received.decoder.newestFrame(number - received.first) / received.model.call.fps;
  }

  /**
   * Do not show the source frames before one any more.
   * @param {number} index
   */
  skipTo(index) {
    this.next = Math.max(this.next, index);
  }

  /** @param {ReceivedModel} update */
  #activate(update) {
    const { current } = this.models;
    if (this.last && current) {
      const ratio = update.model.call.focalPx / current.model.call.focalPx;
      const none = new Float64Array(0);
      const face = { ...withFocalChange(this.last.face, ratio), modes: none, layers: none };
      this.last = { ...this.last, face };
    }
    this.models.activate();
  }

  /**
   * The number of a frame packet in the call.
   * @param {number} sequence
   * @param {ReceivedModel} current
   * @param {number | null} exact
   */
  #number(sequence, current, exact) {
    if (exact !== null) this.isNumbered = true;
    const ahead = exact === null ? sequenceStep(sequence - this.newest) : exact - this.newest;
    const number = this.newest + ahead;
    if (!this.last && this.newest < current.first && ahead > FIRST_WINDOW) {
      this.#joinLate();
      this.newest = number - 1;
    } else if (exact === null && ahead >= SEQUENCE_MODULUS - LATE_WINDOW) {
      return number - SEQUENCE_MODULUS;
    }
    return number;
  }

  /**
   * Source frames after those shown before, up to the time of a coded face.
   * @param {ReceivedModel} received
   * @param {TimedFace} timed
   * @param {boolean} isGap packets before it are missing
   */
  #framesUntil(received, timed, isGap) {
    const { last } = this;
    if (this.next < 0) this.next = Math.ceil(timed.time);
    this.#checkGap(received, timed.time);
    const frames = [];
    for (; this.next <= timed.time; this.next++) {
      const index = this.next;
      if (this.lostAt !== null && last) {
        frames.push(this.#repeated(received, index, last.face));
      } else if (!last || index <= last.time) {
        const isFrozen = index < received.model.call.startFrame;
        frames.push(this.#frame(received, index, timed.face, { isFrozen }));
      } else if (isGap && index < timed.time) {
        const { face, isHeld } = bridge(last, timed, index);
        frames.push(this.#frame(received, index, face, { isFrozen: isHeld, isLost: true }));
      } else {
        const share = (index - last.time) / (timed.time - last.time);
        frames.push(this.#frame(received, index, interpolate(last.face, timed.face, share), {}));
      }
    }
    return frames;
  }

  /**
   * @param {ReceivedModel} received
   * @param {number} index
   * @param {Face} face
   * @param {{isFrozen?: boolean, isLost?: boolean, presence?: number}} more
   * @returns {PlayoutFrame}
   */
  #frame(received, index, face, { isFrozen = false, isLost = false, presence: shown = 1 }) {
    const timeS = this.clock.timeOf(index, received.model.call.fps);
    return { index, face, received, timeS, isFrozen, isLost, presence: shown, residual: null };
  }

  /**
   * A frame that shows an older face: one that is lost goes to rest, or fades.
   * @param {ReceivedModel} received
   * @param {number} index
   * @param {Face} face
   */
  #repeated(received, index, face) {
    const { fps } = received.model.call;
    if (this.lostAt === null) return this.#frame(received, index, face, {});
    const resting = atRest(face, received.model, (index + 1 - this.lostAt) / fps);
    const shown = this.goneAt === null ? 1 : presence(index + 1 - this.goneAt, fps);
    return this.#frame(received, index, resting, { isFrozen: true, presence: shown });
  }

  /**
   * @param {Extract<Packet, {kind: "control"}>} packet
   * @param {number | null} exact
   */
  #receiveControl({ event, frame, ticks }, exact) {
    if (event === EVENTS.TIMES) this.clock.receive(frame, ticks ?? []);
    const { current } = this.models;
    if (!current || [EVENTS.TIMES, EVENTS.CAMERA_OFF, EVENTS.CAMERA_ON].includes(event)) return [];
    if (event === EVENTS.JOINED) {
      if (exact === null && !this.last) this.#joinAt(current, frame);
      return [];
    }
    const begin = event === EVENTS.END ? this.begin : 0;
    const frames = this.#frozenUntil(current, begin + frame);
    if (event === EVENTS.END) this.ended = true;
    if (event === EVENTS.FACE_LOST) this.lostAt = frame;
    if (event === EVENTS.PERSON_GONE) this.goneAt = frame;
    if (event === EVENTS.FACE_FOUND) {
      this.lostAt = null;
      this.goneAt = null;
      if (exact !== null) this.newest = Math.max(this.newest, exact - 1);
      else if (this.isNumbered || !this.joinedLate) {
        const following = current.first + current.decoder.packetAt(frame);
        this.newest = Math.max(this.newest, following - 1);
      }
    }
    return frames;
  }

  /**
   * @param {ReceivedModel} current
   * @param {number} frame
   */
  #joinAt(current, frame) {
    this.#joinLate();
    this.begin = frame;
    this.next = frame;
    this.newest = current.first + current.decoder.packetAt(frame) - 1;
    this.isNumbered = true;
  }

  /**
   * The last face for every source frame before `end`.
   * @param {ReceivedModel} received
   * @param {number} end
   */
  #frozenUntil(received, end) {
    const { last } = this;
    if (!last || (this.joinedLate && !this.isNumbered)) return [];
    this.#checkGap(received, end);
    const frames = [];
    for (; this.next < end; this.next++)
      frames.push(this.#repeated(received, this.next, last.face));
    return frames;
  }

  /**
   * @param {ReceivedModel} received
   * @param {number} end
   */
  #checkGap(received, end) {
    const isNear = end - this.next <= MAX_GAP_S * received.model.call.fps;
    check(isNear, `call jumps from frame ${this.next} to ${Math.floor(end)}`);
  }
}

/**
 * A frame with its packet's residual, unless its face is not that of the packet.
 * @param {PlayoutFrame} frame
 * @param {CodedResidual | null} residual
 */
function withResidual(frame, residual) {
  const isShown = residual && !frame.isFrozen && !frame.isLost && frame.index >= residual.first;
  return isShown ? { ...frame, residual } : frame;
}
