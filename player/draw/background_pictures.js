import {
  changeSize,
  isLayered,
  parseBackground,
  parseLayers,
} from "../format/pictures/background.js";
import { modeDecoder } from "../format/pictures/picture.js";
import { toByte } from "./local_colours.js";
import { pullPushFill } from "./pull_push.js";
import { layerOpacity, maskOpacity } from "./soft_mask.js";

/** @typedef {import("../format/pictures/background.js").MotionFields} MotionFields */
/** @typedef {import("../format/pictures/picture.js").Image} Image */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */
/** @typedef {import("../format/pictures/picture_codec.js").PictureCodec} PictureCodec */
/** R, G, B and alpha, row by row. @typedef {{height: number, width: number, values: Uint8ClampedArray}} Bitmap */
/** Decodes a picture; its name is for messages. @typedef {(data: Uint8Array, name: string) => Promise<Image>} DecodeImage */
/**
 * What is behind the face.
 * @typedef {object} BackgroundPictures
 * @property {Bitmap} moving moves with the head
 * @property {Bitmap | null} still stands behind it; null if `moving` is opaque
 * @property {MotionFields | null} fields
 * @property {Float32Array[]} changes each (rows, columns, 3)
 * @property {{rows: number, columns: number}} changeSize
 * @property {boolean} sceneMoves
 * @property {boolean} lightChanges
 */

/**
 * @param {Image} image
 * @param {ArrayLike<number> | null} alpha (height, width) 0..1
 * @returns {Bitmap}
 */
function bitmapOf({ height, width, values }, alpha) {
  // Values are cut to 0..255 as they are written.
  const bitmap = new Uint8ClampedArray(4 * height * width).fill(255);
  for (let i = 0, p = 0; i < values.length; i += 3, p += 4) {
    bitmap[p] = Math.floor(values[i] + 0.5);
    bitmap[p + 1] = Math.floor(values[i + 1] + 0.5);
    bitmap[p + 2] = Math.floor(values[i + 2] + 0.5);
  }
  for (let at = 0; alpha && at < alpha.length; at++)
    bitmap[4 * at + 3] = Math.round(255 * alpha[at]);
  return { height, width, values: bitmap };
}

/**
 * Decode the background of a model whose pictures have this size.
 * @param {PictureCodec} codec
 * @param {ImageFilters} filters
 * @param {DecodeImage} decodeImage
 * @param {Uint8Array} data
 * @param {number} width
 * @param {number} height
 * @returns {Promise<BackgroundPictures>}
 */
export async function decodeBackground(codec, filters, decodeImage, data, width, height) {
  const nothing = {
    still: null,
    fields: null,
    changes: [],
    changeSize: changeSize(width, height),
    sceneMoves: false,
    lightChanges: false,
  };
  if (!data.length) {
    const black = { height: 2, width: 2, values: new Float32Array(12) };
    return { ...nothing, moving: bitmapOf(black, null) };
  }
  if (isLayered(data)) return decodeLayers(codec, filters, decodeImage, data, width, height);
  const { mask, maskSide, picture } = parseBackground(codec, data);
  const image = await decodeImage(picture, "background");
  if (!mask) return { ...nothing, moving: bitmapOf(image, null) };
  const { alpha, isClear } = maskOpacity(filters, mask, maskSide, image.height, image.width);
  const colours = { ...image, channels: 3, values: image.values.map(toByte) };
  const still = pullPushFill(colours, isClear);
  return { ...nothing, moving: bitmapOf(image, alpha), still: bitmapOf(still, null) };
}

/**
 * @param {PictureCodec} codec
 * @param {ImageFilters} filters
 * @param {DecodeImage} decodeImage
 * @param {Uint8Array} data
 * @param {number} width
 * @param {number} height
 * @returns {Promise<BackgroundPictures>}
 */
async function decodeLayers(codec, filters, decodeImage, data, width, height) {
  const layers = parseLayers(codec, data, width, height);
  const person = await decodeImage(layers.person, "person");
  const scene = await decodeImage(layers.scene, "scene");
  const alpha = layerOpacity(filters, layers.mask, layers.maskSide, person.height, person.width);
  const size = changeSize(width, height);
  return {
    moving: bitmapOf(person, alpha),
    still: bitmapOf(scene, null),
    fields: layers.fields,
    changes: decodeChanges(codec, layers.changes, size),
    changeSize: size,
    sceneMoves: layers.sceneMoves,
    lightChanges: layers.lightChanges,
  };
}

/**
 * @param {PictureCodec} codec
 * @param {Uint8Array[]} changes
 * @param {{rows: number, columns: number}} size
 */
function decodeChanges(codec, changes, { rows, columns }) {
  const decoder = modeDecoder(codec, rows, columns, new Uint8Array(0));
  try {
    return changes.map((change, i) => decoder.decode(change, `change ${i}`).values);
  } finally {
    decoder.close();
  }
}
