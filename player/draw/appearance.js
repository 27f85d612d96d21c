import { sameBytes } from "../format/bytes.js";
import { check } from "../format/errors.js";
import { isPicture, modeDecoder, parsePictureHeader } from "../format/pictures/picture.js";
import { LIDS } from "../model/parameters.js";
import { Atlas } from "./atlas.js";
import { lidsOf, lightenLids } from "./closed_lids.js";
import { colourLimits, toByte } from "./local_colours.js";
import { blendSurroundSeam } from "./surround_seam.js";

/** @typedef {import("../format/pictures/picture.js").Image} Image */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */
/** @typedef {import("../format/pictures/picture_codec.js").PictureCodec} PictureCodec */
/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("../model/parameters.js").Face} Face */
/** @typedef {import("./closed_lids.js").Lids} Lids */
/** @typedef {import("./local_colours.js").ColourLimits} ColourLimits */
/** @typedef {import("./texture_synthesis.js").TextureSynthesis} TextureSynthesis */
/** What is compiled of the player's drawing. @typedef {{filters: ImageFilters, synthesis: TextureSynthesis}} Compiled */
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
   * @param {PictureCodec} codec
   * @param {ImageFilters} filters
   * @param {Uint8Array} texture
   * @param {Image} image the picture in it
   * @param {boolean} isThesis
   */
  constructor(codec, filters, texture, image, isThesis) {
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
    this.filters = filters;
    /** whether the limits of the mean are known: modes are completed within them */
    this.hasLimits = false;
    /** @type {MeanTexture} */
    this.mean = { size: width, mean, limits: null, lids: null };
    this.sequence = modeDecoder(codec, height, width, weightMap);
    /** @type {Uint8Array[]} the modes decoded so far, as they are coded */
    this.known = [];
  }

  /** Let another one have what this one works with. */
  close() {
    this.sequence.close();
  }

  /**
   * Limits and lids of the mean: they are needed where modes are, or lids that close.
   * @param {Head} head
   * @returns {TextureDetails}
   */
  details(head) {
    const { size, mean } = this.mean;
    const atlas = new Atlas(this.filters, head, size);
    const limits = colourLimits(this.filters, mean, atlas);
    this.hasLimits = true;
    return { limits, lids: lidsOf(this.filters, mean, atlas) };
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
      if (this.hasLimits) this.filters.completeMode(image.values);
      if (!this.isThesis) blendSurroundSeam(image);
      this.known.push(mode);
      yield image.values;
    }
  }
}

/** Makes the texture of each frame. */
export class Appearance {
  /**
   * @param {Compiled} compiled
   * @param {MeanTexture} mean
   * @param {Float32Array[]} modes each (size, size, 3)
   */
  constructor({ filters, synthesis }, mean, modes) {
    this.filters = filters;
    this.synthesis = synthesis;
    this.mean = mean;
    this.modes = modes;
    this.texture = new Uint8ClampedArray(4 * mean.size ** 2);
  }

  /**
   * The texture (size, size, 4), R, G, B and alpha, of a frame.
   * @param {Face} face
   */
  synthesise({ modes, eau }) {
    const { mean, texture } = this;
    this.synthesis.synthesise(mean, this.modes, modes, texture);
    if (mean.lids)
      lightenLids(
        this.filters,
        mean.lids,
        texture,
        LIDS.map((lid) => eau[lid]),
      );
    return texture;
  }
}
