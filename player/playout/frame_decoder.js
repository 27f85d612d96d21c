import { ByteReader } from "../format/bytes.js";
import { check } from "../format/errors.js";
import { FramePredictor } from "../format/frames/frame_payload.js";
import { GEOMETRY, parseTransform } from "../format/frames/frame_transform.js";
import { parseThesisPayload, THESIS_EAUS } from "../format/frames/thesis_payload.js";
import { splitVoice } from "../format/frames/voice_block.js";
import { VOICES } from "../format/model_packet.js";
import { poseFromMotion } from "../model/geometry.js";
import { clip, clipEau } from "../model/parameters.js";
import { referenceFace } from "../model/person.js";
import { PacketHistory } from "./packet_history.js";

/** @typedef {import("../format/frames/frame_transform.js").FrameTransform} FrameTransform */
/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/parameters.js").Face} Face */
/** A coded face at its time, source frames. @typedef {{time: number, face: Face}} TimedFace */
/**
 * A picture residual and its source frames.
 * @typedef {{data: Uint8Array, first: number, frames: number}} CodedResidual
 */
/** What a frame packet holds. @typedef {{faces: TimedFace[], residual: CodedResidual | null}} DecodedPacket */

const THESIS_RATE_HZ = 10;
export const SPEECH_RATE_HZ = 25;
/** Of a quotient that is a whole number in exact fractions. */
const ROUNDING = 1e-6;
const MAX_PARAMETER = 1e5;
const MAX_MOTION = [180, 180, 180, 1e4, 1e4, 3];

/** Decodes the frame packets of a model. */
export class FrameDecoder {
  /** @param {ModelPacket} model */
  constructor(model) {
    this.model = model;
    this.reference = referenceFace(model);
    /** number of the newest packet decoded */
    this.newest = -1;
    const { isThesis, framesPerPacket } = model.call;
    /** @type {FrameTransform | null} */
    this.transform = isThesis ? null : parseTransform(model.profileData);
    if (this.transform) {
      const { scaleCodes, reservedModes } = this.transform;
      const isRight = reservedModes > 0 === model.isExtensible;
      check(isRight, `model packet: ${reservedModes} reserved modes`);
      const predictor = new FramePredictor(scaleCodes, reservedModes);
      this.history = new PacketHistory(predictor, framesPerPacket);
    }
  }

  /**
   * What packet `number` of the model holds; it is later than all before.
   * @param {number} number
   * @param {Uint8Array} payload
   * @returns {DecodedPacket}
   */
  decode(number, payload) {
    const { residual, face } = this.#split(payload);
    if (!this.history) return { faces: [this.#thesisFace(number, face)], residual: null };
    const frames = this.history.decode(number, face);
    this.newest = number;
    const faces = frames.map((coded, i) => this.#timedFace(number, i, coded));
    return { faces, residual: this.#residual(number, residual, frames.length) };
  }

  /**
   * Whether a packet has a face, and not speech alone.
   * @param {Uint8Array} payload
   */
  hasFace(payload) {
    return this.#split(payload).hasFace;
  }

  /**
   * The speech of a packet, in the codec Opus: number of each frame, see docs/format.md, Voice.
   * @param {number} number
   * @param {Uint8Array} payload
   * @returns {{index: number, data: Uint8Array}[]}
   */
  speech(number, payload) {
    const { voice, rate, startFrame } = this.model.call;
    if (voice !== VOICES.OPUS) return [];
    const { block } = splitVoice(payload, voice);
    const firstPicture = number ? this.newestFrame(number - 1) + 1 : startFrame;
    const expected = Math.ceil((SPEECH_RATE_HZ * firstPicture * rate[1]) / rate[0] - ROUNDING);
    const first = expected + block.displacement;
    return block.opus.map(({ place, data }) => ({ index: first + place, data }));
  }

  /**
   * Take in a packet that comes after a later one: the newest face, if it has changed.
   * @param {number} number
   * @param {Uint8Array} payload
   * @returns {TimedFace | null}
   */
  repair(number, payload) {
    const { face } = this.#split(payload);
    if (!this.history) {
      this.#thesisFace(number, face);
      return null;
    }
    const frames = this.history.insert(number, face);
    if (!frames) return null;
    return this.#timedFace(this.newest, frames.length - 1, frames[frames.length - 1]);
  }

  /**
   * Time of the last face of a packet, source frames; one at the end of a call may have fewer faces.
   * @param {number} number
   */
  newestFrame(number) {
    const [frames, packets] = this.#spacing();
    return this.model.call.startFrame + (number * frames) / packets;
  }

  /**
   * The number of the packet of the first coded face at or after a source frame.
   * @param {number} frame
   */
  packetAt(frame) {
    const [frames, packets] = this.#spacing();
    return Math.max(0, Math.ceil(((frame - this.model.call.startFrame) * packets) / frames));
  }

  /** So many source frames come with so many packets. */
  #spacing() {
    const { rate, framesPerPacket, frameStep } = this.model.call;
    return this.history ? [framesPerPacket * frameStep, 1] : [rate[0], THESIS_RATE_HZ * rate[1]];
  }

  /** @param {Uint8Array} payload */
  #split(payload) {
    const { voice, hasResidual } = this.model.call;
    let face = payload;
    if (voice) {
      const { block, face: rest } = splitVoice(payload, voice);
      if (!block.hasFace) return { hasFace: false, residual: face.subarray(0, 0), face: rest };
      face = rest;
    }
    if (!hasResidual) return { hasFace: true, residual: face.subarray(0, 0), face };
    const reader = new ByteReader(face, "picture residual");
    const residual = reader.part("block", face.length);
    return { hasFace: true, residual, face: reader.rest() };
  }

  /**
   * @param {number} number
   * @param {Uint8Array} payload
   * @returns {TimedFace}
   */
  #thesisFace(number, payload) {
    const { hasEyelids } = this.model.call;
    const values = parseThesisPayload(payload, hasEyelids);
    const eau = this.reference.eau.slice();
    for (const [i, value] of values.subarray(6).entries()) eau[THESIS_EAUS[i]] = value;
    const pose = poseFromMotion(values, this.reference.pose);
    const none = new Float64Array(0);
    const face = { pose, eau, layers: none, modes: none };
    return { time: this.newestFrame(number), face };
  }

  /**
   * @param {number} number
   * @param {number} index of the face within its packet
   * @param {Float64Array} coded
   * @returns {TimedFace}
   */
  #timedFace(number, index, coded) {
    const { startFrame, framesPerPacket, frameStep } = this.model.call;
    const first = number ? 1 + (number - 1) * framesPerPacket : 0;
    return { time: startFrame + (first + index) * frameStep, face: this.#face(coded) };
  }

  /**
   * The face of coefficients in 1/256.
   * @param {Float64Array} coded
   * @returns {Face}
   */
  #face(coded) {
    const {
      components,
      parameters: d,
      mean,
      matrix,
      layers,
    } = /** @type {FrameTransform} */ (this.transform);
    const y = mean.slice();
    for (let c = 0; c < components; c++) {
      const q = coded[c] / 256;
      if (q) for (let i = 0; i < d; i++) y[i] += q * matrix[c * d + i];
    }
    for (let i = 0; i < d; i++) y[i] = clip(y[i], -MAX_PARAMETER, MAX_PARAMETER);
    const motion = MAX_MOTION.map((limit, i) => clip(y[i], -limit, limit));
    return {
      pose: poseFromMotion(motion, this.reference.pose),
      eau: clipEau(y.subarray(6, GEOMETRY)),
      layers: y.slice(GEOMETRY, GEOMETRY + layers),
      modes: y.slice(GEOMETRY + layers),
    };
  }

  /**
   * @param {number} number
   * @param {Uint8Array} data
   * @param {number} coded
   * @returns {CodedResidual | null}
   */
  #residual(number, data, coded) {
    if (!data.length) return null;
    const { startFrame, framesPerPacket, frameStep } = this.model.call;
    const before = (number - 1) * framesPerPacket * frameStep;
    const first = startFrame + (number ? before + 1 : 0);
    return { data, first, frames: number ? coded * frameStep : 1 };
  }
}
