import { AAUS, EAUS } from "../model/parameters.js";
import { check } from "./errors.js";
import { Float, parseMap } from "./message_pack.js";
import { parseShapeResidual } from "./shape_residual.js";

/** @typedef {import("./message_pack.js").Value} Value */
/**
 * What stays the same throughout a call, see docs/format.md, Model packet.
 * @typedef {object} CallParameters
 * @property {boolean} isThesis profile: thesis, else default
 * @property {boolean} isBt709
 * @property {number} width of the pictures of the call, pixels
 * @property {number} height
 * @property {number} fps
 * @property {[number, number]} rate numerator and denominator of `fps`
 * @property {number} focalPx
 * @property {number} framesPerPacket coded frames in a frame packet
 * @property {number} startFrame source frame of the model's first coded frame
 * @property {number} frameStep source frames from one coded frame to the next
 * @property {boolean} hasEyelids
 * @property {number} voice codec of the voice, one of `VOICES`
 * @property {[number, number]} sampleAspect
 * @property {boolean} hasResidual
 */
/**
 * One caller: shape, pictures and what the profile adds.
 * @typedef {object} ModelPacket
 * @property {CallParameters} call
 * @property {number} version
 * @property {number} sequence number of the first frame packet that is coded by it, modulo 64
 * @property {Int8Array} aau codes
 * @property {Int8Array} residual codes of the shape, three of each point
 * @property {number[]} rotation of the reference pose, not normalised
 * @property {number[]} translation mm
 * @property {Int8Array} eau codes of the background picture
 * @property {Uint8Array} background
 * @property {Uint8Array} texture
 * @property {Uint8Array} profileData
 * @property {boolean} isProgressive
 * @property {boolean} isExtensible
 */

/** Codecs of the voice. */
export const VOICES = { OFF: 0, CODEC2_700C: 1, OPUS: 3, CODEC2_1200: 4 };
export const MAX_IMAGE_BYTES = 131072;
const KEYS = "psrfnoladqtebxm";
const FURTHER_KEYS = "kygivzw";
/** How many of the further keys each format has. */
const FORMATS = new Map([
  [15, 0],
  [16, 4],
  [17, 0],
  [18, 2],
  [19, 3],
  [20, 5],
  [21, 6],
  [22, 7],
]);
const PLAIN_RESIDUAL_FORMATS = [15, 16];
const MAX_POINTS = 255;

/** The fields of a map, checked as they are asked for. */
class Fields {
  /** @param {Map<string, Value>} values */
  constructor(values) {
    this.values = values;
  }

  /**
   * @param {string} key
   * @param {number} low
   * @param {number} high
   * @param {number} [absent] what the missing field stands for
   */
  integer(key, low, high, absent) {
    const value = this.values.get(key) ?? absent;
    return checkedNumber(key, value, low, high);
  }

  /** @param {string} key */
  flag(key) {
    const value = this.values.get(key) ?? false;
    check(typeof value === "boolean", `model packet: ${key} is neither true nor false`);
    return value;
  }

  /**
   * @param {string} key
   * @param {number} limit
   */
  bytes(key, limit) {
    const value = this.values.get(key);
    check(value instanceof Uint8Array, `model packet: ${key} is no bytes`);
    check(value.length <= limit, `model packet: ${key} has ${value.length} bytes, limit ${limit}`);
    return value;
  }

  /**
   * @param {string} key
   * @param {number} count
   */
  codes(key, count) {
    const data = this.bytes(key, count);
    check(
      data.length === count,
      `model packet: ${key} has ${data.length} codes, expected ${count}`,
    );
    return new Int8Array(data);
  }

  /**
   * @param {string} key
   * @param {number} low
   * @param {number} high
   * @param {[number, number]} [absent]
   * @returns {[number, number]}
   */
  pair(key, low, high, absent) {
    const value = this.values.get(key) ?? absent;
    check(Array.isArray(value) && value.length === 2, `model packet: ${key} is not two numbers`);
    return [checkedNumber(key, value[0], low, high), checkedNumber(key, value[1], low, high)];
  }

  /**
   * @param {string} key
   * @param {number} count
   * @param {number} limit of magnitudes
   */
  floats(key, count, limit) {
    const value = this.values.get(key);
    check(Array.isArray(value) && value.length === count, `model packet: ${key} is not ${count}`);
    return value.map((each) => checkedFloat(key, each, -limit, limit));
  }
}

/**
 * @param {string} key
 * @param {unknown} value
 * @param {number} low
 * @param {number} high
 */
function checkedNumber(key, value, low, high) {
  const isWithin = typeof value === "number" && value >= low && value <= high;
  check(isWithin, `model packet: ${key} is ${value}, expected ${low} to ${high}`);
  return value;
}

/**
 * @param {string} key
 * @param {Value | undefined} value
 * @param {number} low
 * @param {number} high
 */
function checkedFloat(key, value, low, high) {
  check(value instanceof Float, `model packet: ${key} is no floating-point number`);
  return checkedNumber(key, value.value, low, high);
}

/**
 * The model packet in a payload.  Throws `FormatError` if no encoder writes it.
 * @param {number} sequence
 * @param {Uint8Array} payload
 * @returns {ModelPacket}
 */
export function parseModel(sequence, payload) {
  const format = payload[0];
  const further = FORMATS.get(format);
  check(further !== undefined, `model packet of format ${format}, which this player does not know`);
  const values = parseMap(payload.subarray(1), "model packet");
  const keys = KEYS + FURTHER_KEYS.slice(0, further);
  check([...values.keys()].join("") === keys, `model packet: no map of the fields ${keys}`);
  const fields = new Fields(values);
  const call = callParameters(fields);
  const [version, count] = fields.pair("l", 0, 64);
  check(count >= 1 && version < count, `model packet: version ${version} of ${count}`);
  const rotation = fields.floats("q", 4, 1.001);
  check(Math.abs(Math.hypot(...rotation) - 1) <= 1e-3, "model packet: q is no rotation");
  const translation = fields.floats("t", 3, 1e6);
  check(translation[2] > 0, "model packet: the face is behind the camera");
  const eau = fields.codes("e", EAUS);
  check(!eau.includes(-128), "model packet: e has a code of -128");
  const model = {
    call,
    version,
    sequence,
    aau: fields.codes("a", AAUS),
    residual: shapeResidual(fields.bytes("d", 4096), format),
    rotation,
    translation,
    eau,
    background: fields.bytes("b", MAX_IMAGE_BYTES),
    texture: fields.bytes("x", MAX_IMAGE_BYTES),
    profileData: fields.bytes("m", MAX_IMAGE_BYTES),
    isProgressive: fields.flag("y"),
    isExtensible: fields.flag("g"),
  };
  check(formatOf(model) === format, `model packet of format ${format} in another's encoding`);
  return model;
}

/**
 * @param {Fields} fields
 * @returns {CallParameters}
 */
function callParameters(fields) {
  const profile = fields.integer("p", 0, 3);
  const [width, height] = fields.pair("s", 1, 8192);
  const rate = fields.pair("r", 1, 1e6);
  const fps = rate[0] / rate[1];
  check(fps >= 1e-3 && fps <= 1e3, `model packet: ${fps} frames a second`);
  const voice = fields.integer("v", 0, 4, 0);
  check(Object.values(VOICES).includes(voice), `model packet: unknown voice ${voice}`);
  const sampleAspect = fields.pair("z", 1, 255, [1, 1]);
  const aspect = sampleAspect[0] / sampleAspect[1];
  check(aspect <= 8 && aspect >= 1 / 8, `model packet: sample aspect ratio ${aspect}`);
  const isThesis = profile % 2 === 0;
  const hasEyelids = fields.flag("i");
  const hasResidual = fields.flag("w");
  check(isThesis || !hasEyelids, "model packet: eyelids in the default profile");
  check(!isThesis || !hasResidual, "model packet: a picture residual in the thesis profile");
  return {
    isThesis,
    isBt709: profile >= 2,
    width,
    height,
    fps,
    rate,
    focalPx: checkedFloat("f", fields.values.get("f"), 1, 1e6),
    framesPerPacket: fields.integer("n", 1, 64),
    startFrame: fields.integer("o", 0, 2 ** 32 - 1),
    frameStep: fields.integer("k", 1, 255, 1),
    hasEyelids,
    voice,
    sampleAspect,
    hasResidual,
  };
}

/**
 * @param {Uint8Array} data
 * @param {number} format
 */
function shapeResidual(data, format) {
  if (!PLAIN_RESIDUAL_FORMATS.includes(format)) return parseShapeResidual(data);
  check(data.length % 3 === 0 && data.length <= 3 * MAX_POINTS, "model packet: d has no points");
  return new Int8Array(data);
}

/**
 * The format number that the fields of a model need.
 * @param {ModelPacket} model
 */
function formatOf({ call, isProgressive, isExtensible }) {
  if (call.hasResidual) return 22;
  if (call.sampleAspect[0] !== call.sampleAspect[1]) return 21;
  if (call.voice) return 20;
  if (call.hasEyelids) return 16;
  if (isExtensible) return 19;
  if (isProgressive || call.frameStep !== 1) return 18;
  return call.isThesis ? 15 : 17;
}

/**
 * A model whose missing pictures are those of another version.
 * @param {ModelPacket} model
 * @param {ModelPacket} before
 * @returns {ModelPacket}
 */
export function withPicturesOf(model, before) {
  return {
    ...model,
    background: model.background.length ? model.background : before.background,
    texture: model.texture.length ? model.texture : before.texture,
  };
}
