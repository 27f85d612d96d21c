import { sameBytes } from "../format/bytes.js";
import { check } from "../format/errors.js";
import { isPicture, modeDecoder, parsePictureHeader } from "../format/pictures/picture.js";
import { LIDS } from "../model/parameters.js";
import { Atlas } from "./atlas.js";
import { lidsOf, lightenLids } from "./closed_lids.js";
import { colourLimits, limitColours, toByte } from "./local_colours.js";
import { blendSurroundSeam } from "./surround_seam.js";

/** @typedef {import("../format/pictures/picture.js").Image} Image */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */
/** @typedef {import("../format/pictures/picture_codec.js").PictureCodec} PictureCodec */
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

/** Makes the texture of each frame: the mean and the modes times their coefficients. */
export class Appearance {
  /**
   * @param {ImageFilters} filters
   * @param {MeanTexture} mean
   * @param {Float32Array[]} modes each (size, size, 3)
   */
  constructor(filters, mean, modes) {
    this.filters = filters;
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
    for (let k = 0; k < this.modes.length; k += 4)
      addModes(this.modes.slice(k, k + 4), modes.slice(k, k + 4), added);
    if (limits && modes.length) {
      limitColours(limits, mean, added, texture);
    } else {
      for (let i = 0, p = 0; i < added.length; i += 3, p += 4) {
        for (let c = 0; c < 3; c++) texture[p + c] = toByte(mean[i + c] + added[i + c]);
      }
    }
    if (lids)
      lightenLids(
        this.filters,
        lids,
        texture,
        LIDS.map((lid) => eau[lid]),
      );
    return texture;
  }
}

/**
 * Add up to four modes times their coefficients: at once, since each pass over a texture takes time.
 * @param {Float32Array[]} modes
 * @param {Float64Array} coefficients as many, or fewer
 * @param {Float32Array} added written
 */
function addModes(modes, coefficients, added) {
  const [first, second = first, third = first, fourth = first] = modes;
  const [a = 0, b = 0, c = 0, d = 0] = coefficients;
  for (let i = 0; i < added.length; i++) {
    added[i] += a * first[i] + b * second[i] + c * third[i] + d * fourth[i];
  }
}
