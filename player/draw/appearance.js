import { sameBytes } from "../format/bytes.js";
import { check } from "../format/errors.js";
import { isPicture, modeDecoder, parsePictureHeader } from "../format/pictures/picture.js";
import { LIDS } from "../model/parameters.js";
import { Atlas } from "./atlas.js";
import { lidsOf, lightenLids } from "./closed_lids.js";
import { LocalColours, limitColours, toByte } from "./local_colours.js";
import { blendSurroundSeam } from "./surround_seam.js";

/** @typedef {import("../format/pictures/picture.js").Image} Image */
/** @typedef {import("../format/pictures/probability_network.js").ProbabilityNetworks} ProbabilityNetworks */
/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("../model/parameters.js").Face} Face */
/** @typedef {import("./closed_lids.js").Lids} Lids */
/** @typedef {import("./local_colours.js").ColourLimits} ColourLimits */
/**
 * The decoded texture of a caller.
 * @typedef {object} MeanTexture
 * @property {number} size texels a side
 * @property {Uint8Array} mean (size, size, 3) R, G, B
 * @property {ColourLimits | null} limits of the default profile; null until known
 * @property {Lids | null} lids likewise
 */
/** What is known last of a texture. @typedef {{limits: ColourLimits, lids: Lids}} TextureDetails */

const MAX_SIDE_PX = 1024;
const MAX_MODE_TEXELS = 4 * 1024 * 1024;

/** Decodes a caller's texture, and their modes as they come. */
export class AppearanceDecoder {
  /**
   * @param {ProbabilityNetworks} networks
   * @param {Uint8Array} texture
   * @param {Image} image the picture in it
   * @param {boolean} isThesis
   */
  constructor(networks, texture, image, isThesis) {
    const { width, height } = image;
    const isRight = width === height && width >= 2 && width <= MAX_SIDE_PX;
    check(isRight, `texture is ${width}x${height}, expected a square`);
    const weightMap = isPicture(texture)
      ? parsePictureHeader(texture, "texture").weightMap
      : new Uint8Array(0);
    const { values } = image;
    for (let i = 0; i < values.length; i++) values[i] = toByte(values[i]);
    if (!isThesis) blendSurroundSeam(image);
    const mean = new Uint8Array(values.length);
    for (let i = 0; i < values.length; i++) mean[i] = toByte(values[i]);
    this.isThesis = isThesis;
    this.texture = texture;
    /** @type {LocalColours | null} */
    this.colours = null;
    /** @type {MeanTexture} */
    this.mean = { size: width, mean, limits: null, lids: null };
    this.sequence = modeDecoder(networks, height, width, weightMap);
    /** @type {Uint8Array[]} the modes decoded so far, as they are coded */
    this.known = [];
  }

  /**
   * Limits and lids of the mean: they are needed where modes are, or lids that close.
   * @param {Head} head
   * @returns {TextureDetails}
   */
  details(head) {
    const { size, mean } = this.mean;
    const atlas = new Atlas(head, size);
    this.colours = new LocalColours(mean, atlas);
    const { low, high } = this.colours;
    return { limits: { low, high }, lids: lidsOf(mean, atlas) };
  }

  /**
   * Whether it has decoded a texture, and some of these modes and no others.
   * @param {Uint8Array} texture
   * @param {Uint8Array[]} modes
   */
  isOf(texture, modes) {
    return (
      sameBytes(texture, this.texture) &&
      this.known.length <= modes.length &&
      this.known.every((mode, i) => sameBytes(mode, modes[i]))
    );
  }

  /**
   * Decode the modes that it has not decoded yet, up to the first empty one: each (size, size, 3).
   * @param {Uint8Array[]} modes
   */
  *further(modes) {
    const { size } = this.mean;
    check(modes.length * size * size <= MAX_MODE_TEXELS, `${modes.length} modes of ${size} texels`);
    for (const mode of modes.slice(this.known.length)) {
      if (!mode.length) return;
      const image = this.sequence.decode(mode, `mode ${this.known.length}`);
      this.colours?.complete(image);
      if (!this.isThesis) blendSurroundSeam(image);
      this.known.push(mode);
      yield image.values;
    }
  }
}

/** Makes the texture of each frame: the mean and the modes times their coefficients. */
export class Appearance {
  /**
   * @param {MeanTexture} mean
   * @param {Float32Array[]} modes each (size, size, 3)
   */
  constructor(mean, modes) {
    this.mean = mean;
    this.modes = modes;
    this.added = new Float32Array(3 * mean.size ** 2);
    this.texture = new Uint8ClampedArray(4 * mean.size ** 2).fill(255);
  }

  /**
   * The texture (size, size, 4), R, G, B and alpha, of a frame.
   * @param {Face} face
   */
  synthesise({ modes, eau }) {
    const { added, texture } = this;
    const { mean, limits, lids } = this.mean;
    added.fill(0);
    for (const [k, mode] of this.modes.entries()) {
      const coefficient = modes[k] ?? 0;
      if (coefficient) for (let i = 0; i < added.length; i++) added[i] += coefficient * mode[i];
    }
    if (limits && modes.length) {
      limitColours(limits, mean, added, texture);
    } else {
      for (let i = 0, p = 0; i < added.length; i += 3, p += 4) {
        for (let c = 0; c < 3; c++) texture[p + c] = toByte(mean[i + c] + added[i + c]);
      }
    }
    if (lids)
      lightenLids(
        lids,
        texture,
        LIDS.map((lid) => eau[lid]),
      );
    return texture;
  }
}
