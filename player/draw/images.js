import { check } from "../format/errors.js";
import { decodePicture, isPicture } from "../format/pictures/picture.js";

/** @typedef {import("../format/pictures/picture.js").Image} Image */
/** @typedef {import("../format/pictures/picture_codec.js").PictureCodec} PictureCodec */
/** Decodes a WebP file, as a browser does. @typedef {(data: Uint8Array) => Promise<Image>} DecodeWebp */

const MAX_CODED_SIDE_PX = 1024;
const MAX_WEBP_SIDE_PX = 4096;

/**
 * The picture in bytes, of the picture codec or a WebP file.
 * @param {PictureCodec} codec
 * @param {DecodeWebp} decodeWebp
 * @param {Uint8Array} data
 * @param {string} name of it, for messages
 */
export async function decodeImage(codec, decodeWebp, data, name) {
  if (isPicture(data)) return decodePicture(codec, data, name, MAX_CODED_SIDE_PX);
  const isWebp =
    String.fromCharCode(...data.subarray(0, 4), ...data.subarray(8, 12)) === "RIFFWEBP";
  check(isWebp, `${name} is no picture that this player knows`);
  const image = await decodeWebp(data);
  const isWithin = Math.max(image.width, image.height) <= MAX_WEBP_SIDE_PX;
  check(isWithin, `${name} is ${image.width}x${image.height}, limit ${MAX_WEBP_SIDE_PX} a side`);
  return image;
}
