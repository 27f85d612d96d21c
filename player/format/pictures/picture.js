import { ByteReader } from "../bytes.js";
import { check } from "../errors.js";
import { decodeWeightMap } from "./weight_map.js";

/** @typedef {import("./picture_codec.js").PictureCodec} PictureCodec */
/**
 * A colour picture: values (height, width, 3) in the order R, G, B, row by row.
 * @typedef {{height: number, width: number, values: Float32Array}} Image
 */

const KINDS = { BACKGROUND: 0, TEXTURE: 1, MODE: 2 };
const MAX_STEP_CODE = 80;
const TAGS = new Map([
  [0x53, KINDS.BACKGROUND],
  [0x54, KINDS.TEXTURE],
]);
/** Weights of blue, green and red in luma. */
export const BLUE = 0.114;
export const GREEN = 0.587;
export const RED = 0.299;

/** Pictures of one kind and size, each decoded in the context of those before. */
export class PictureSequence {
  /**
   * @param {PictureCodec} codec
   * @param {number} kind
   * @param {number} height
   * @param {number} width
   * @param {Float64Array | null} weights see `decodeWeightMap`
   */
  constructor(codec, kind, height, width, weights) {
    this.codec = codec;
    this.compiled = codec.take();
    this.kind = kind;
    this.height = height;
    this.width = width;
    this.compiled.begin(kind, height, width, weights);
  }

  /** Let another sequence have what this one works with. */
  close() {
    this.codec.giveBack(this.compiled);
  }

  /**
   * Decode step code and coefficients of the next picture.
   * @param {Uint8Array} data
   * @param {string} name of it, for messages
   * @returns {Image}
   */
  decode(data, name) {
    check(data.length && data[0] <= MAX_STEP_CODE, `${name} has no step`);
    const { compiled, height, width } = this;
    const unread = compiled.decode(data.subarray(1), 2 ** (data[0] / 8));
    check(unread >= 0, `${name}: a value is too large`);
    check(!unread, `${name}: ${unread} bytes too many`);
    return { height, width, values: compiled.image(3 * height * width) };
  }
}

/**
 * Whether bytes begin like a picture of the codec.
 * @param {Uint8Array} data
 */
export function isPicture(data) {
  return TAGS.has(data[0]);
}

/**
 * The size of a picture, and its weight map.
 * @param {Uint8Array} data
 * @param {string} name of it, for messages
 */
export function parsePictureHeader(data, name) {
  const reader = new ByteReader(data, name);
  const kind = TAGS.get(reader.byte());
  check(kind !== undefined, `${name} is no picture that this player knows`);
  const width = reader.varint();
  const height = reader.varint();
  check(width && height, `${name} is ${width}x${height}`);
  const weightMap = reader.take(reader.byte());
  return { kind, width, height, weightMap, coefficients: reader.rest() };
}

/**
 * Decode a background or a texture.
 * @param {PictureCodec} codec
 * @param {Uint8Array} data
 * @param {string} name of it, for messages
 * @param {number} limit of its sides, pixels
 * @returns {Image}
 */
export function decodePicture(codec, data, name, limit) {
  const { kind, width, height, weightMap, coefficients } = parsePictureHeader(data, name);
  check(Math.max(width, height) <= limit, `${name} is ${width}x${height}, limit ${limit} a side`);
  const weights = decodeWeightMap(weightMap);
  const sequence = new PictureSequence(codec, kind, height, width, weights);
  try {
    return sequence.decode(coefficients, name);
  } finally {
    sequence.close();
  }
}

/**
 * The decoder of appearance modes or of changes, to be closed.
 * @param {PictureCodec} codec
 * @param {number} height
 * @param {number} width
 * @param {Uint8Array} weightMap
 */
export function modeDecoder(codec, height, width, weightMap) {
  const weights = decodeWeightMap(weightMap);
  return new PictureSequence(codec, KINDS.MODE, height, width, weights);
}
