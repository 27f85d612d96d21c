import { readFileSync } from "node:fs";
import { readDataFile } from "../../player/data_file.js";
import { PictureCodec } from "../../player/format/pictures/picture_codec.js";

const VECTORS = new URL("../vectors/", import.meta.url);

/** @param {string} name */
export function text(name) {
  return readFileSync(new URL(name, VECTORS), "utf8");
}

/** @param {string} digits */
export function bytesOf(digits) {
  const pairs = digits.replace(/\s/g, "").match(/../g) ?? [];
  return Uint8Array.from(pairs, (pair) => Number.parseInt(pair, 16));
}

/** @param {string} name */
export function hex(name) {
  return bytesOf(text(name));
}

/** @param {string} name */
export function json(name) {
  return JSON.parse(text(name));
}

export const DATA = readDataFile(
  /** @type {ArrayBuffer} */ (
    Uint8Array.from(readFileSync(new URL("../../player/data/player.bin", import.meta.url))).buffer
  ),
);
export const CODEC = await PictureCodec.load(DATA);
