import { ByteReader } from "../bytes.js";
import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { check } from "../errors.js";
import { MAX_IMAGE_BYTES } from "../model_packet.js";

/** @typedef {import("./picture_codec.js").PictureCodec} PictureCodec */
/**
 * The parts of a background with layers.
 * @typedef {object} Layers
 * @property {Uint8Array} mask (maskSide, maskSide) of the person
 * @property {number} maskSide
 * @property {Uint8Array} person a picture
 * @property {Uint8Array} scene a picture
 * @property {MotionFields} fields
 * @property {Uint8Array[]} changes modes of `changeSize`
 * @property {boolean} sceneMoves
 * @property {boolean} lightChanges
 */
/**
 * Displacements (count, rows, columns, 2), x and y, 1/64 pixel.
 * @typedef {{count: number, rows: number, columns: number, codes: Int32Array}} MotionFields
 */

const TAGS = { MASK: 0x43, LAYERS: 0x4c, FLAGGED_LAYERS: 0x4d };
const FLAGS = { SCENE_MOVES: 1, FINE_MASK: 2, LIGHT_CHANGES: 4 };
const MASK_SIDE = 96;
const MAX_MASK_BYTES = 2048;
const MAX_FIELD_BYTES = 8192;
const MAX_FIELDS = 8;
const MAX_CHANGES = 8;
const MAX_FIELD_CODE = 127;
const FIELD_CELLS = 12;
const CHANGE_SIDE = 96;

/**
 * Whether a background has layers.
 * @param {Uint8Array} data
 */
export function isLayered(data) {
  return data[0] === TAGS.LAYERS || data[0] === TAGS.FLAGGED_LAYERS;
}

/**
 * The mask, or null, and the picture of a background without layers.
 * @param {PictureCodec} codec
 * @param {Uint8Array} data
 */
export function parseBackground(codec, data) {
  if (data[0] !== TAGS.MASK) return { mask: null, maskSide: 0, picture: data };
  const reader = new ByteReader(data.subarray(1), "background");
  const mask = codec.mask(reader.part("mask", MAX_MASK_BYTES), MASK_SIDE);
  return { mask, maskSide: MASK_SIDE, picture: reader.rest() };
}

/**
 * The layers of a background of source pictures of this size.
 * @param {PictureCodec} codec
 * @param {Uint8Array} data
 * @param {number} width
 * @param {number} height
 * @returns {Layers}
 */
export function parseLayers(codec, data, width, height) {
  const reader = new ByteReader(data, "background");
  const flags = reader.byte() === TAGS.FLAGGED_LAYERS ? reader.byte() : 0;
  check(flags < 8 && (flags || data[0] === TAGS.LAYERS), `background: flags are ${flags}`);
  const maskSide = flags & FLAGS.FINE_MASK ? 2 * MASK_SIDE : MASK_SIDE;
  const mask = codec.mask(reader.part("mask", MAX_MASK_BYTES), maskSide);
  const person = reader.part("person", MAX_IMAGE_BYTES);
  const fields = decodeFields(reader.part("motion fields", MAX_FIELD_BYTES), width, height);
  const count = reader.byte();
  check(count <= MAX_CHANGES, `background: ${count} changes, limit ${MAX_CHANGES}`);
  const changes = Array.from({ length: count }, () => reader.part("change", MAX_IMAGE_BYTES));
  const scene = reader.rest();
  const sceneMoves = (flags & FLAGS.SCENE_MOVES) > 0;
  const lightChanges = (flags & FLAGS.LIGHT_CHANGES) > 0;
  return { mask, maskSide, person, scene, fields, changes, sceneMoves, lightChanges };
}

/**
 * Rows and columns of a change, for source pictures of this size.
 * @param {number} width
 * @param {number} height
 */
export function changeSize(width, height) {
  const longer = Math.max(width, height);
  const of = (/** @type {number} */ side) => Math.max(2, roundEven((CHANGE_SIDE * side) / longer));
  return { rows: of(height), columns: of(width) };
}

/** @param {number} x */
function roundEven(x) {
  const low = Math.floor(x);
  const half = x - low - 0.5;
  return low + (half > 0 || (half === 0 && low % 2) ? 1 : 0);
}

/**
 * @param {Uint8Array} data
 * @param {number} width
 * @param {number} height
 * @returns {MotionFields}
 */
function decodeFields(data, width, height) {
  const longer = Math.max(width, height);
  const points = (/** @type {number} */ side) =>
    Math.max(2, Math.ceil((FIELD_CELLS * side) / longer) + 1);
  const rows = points(height);
  const columns = points(width);
  check(data.length && data[0] <= MAX_FIELDS, "background: no 0 to 8 motion fields");
  const count = data[0];
  const codes = new Int32Array(count * rows * columns * 2);
  const decoder = new RangeDecoder(data.subarray(1));
  const integers = new AdaptiveIntegers(3);
  for (let field = 0; field < 2 * count; field++) {
    const start = (field >> 1) * rows * columns * 2 + (field & 1);
    decodeField(decoder, integers, codes, start, rows, columns);
  }
  decoder.end("background: motion fields");
  return { count, rows, columns, codes };
}

/**
 * One direction of a field.
 * @param {RangeDecoder} decoder
 * @param {AdaptiveIntegers} integers
 * @param {Int32Array} codes
 * @param {number} start
 * @param {number} rows
 * @param {number} columns
 */
function decodeField(decoder, integers, codes, start, rows, columns) {
  const known = (/** @type {number} */ i, /** @type {number} */ j) =>
    i >= 0 && j >= 0 ? codes[start + 2 * (i * columns + j)] : 0;
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const left = known(i, j - 1);
      const above = known(i - 1, j);
      const corner = known(i - 1, j - 1);
      const context = Math.min(2, Math.abs(above - corner) + Math.abs(left - corner));
      const code = left + above - corner + integers.decode(decoder, context);
      check(Math.abs(code) <= MAX_FIELD_CODE, `background: motion field has a code of ${code}`);
      codes[start + 2 * (i * columns + j)] = code;
    }
  }
}
