import { sameBytes } from "../format/bytes.js";
import { PictureCodec } from "../format/pictures/picture_codec.js";
import { Heads } from "../model/heads.js";
import { AppearanceDecoder } from "./appearance.js";
import { decodeBackground } from "./background_pictures.js";
import { ImageFilters } from "./image_filters.js";
import { decodeImage } from "./images.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./appearance.js").MeanTexture} MeanTexture */
/** @typedef {import("./appearance.js").TextureDetails} TextureDetails */
/** @typedef {import("./background_pictures.js").BackgroundPictures} BackgroundPictures */
/** @typedef {import("./images.js").DecodeWebp} DecodeWebp */
/**
 * What is coded of the pictures of a model.
 * @typedef {object} CodedPictures
 * @property {boolean} isThesis
 * @property {number} width of the pictures of the call
 * @property {number} height
 * @property {Uint8Array} texture
 * @property {Uint8Array[]} modes
 * @property {Uint8Array} background
 */
/**
 * A step of the decoding of a model: what it adds to the pictures of the model before, or of the
 * steps before.  A mean replaces the modes as well; null: as before.
 * @typedef {object} DecodedStep
 * @property {MeanTexture | null} mean
 * @property {TextureDetails | null} details of that mean
 * @property {Float32Array[]} modes
 * @property {BackgroundPictures | null} background
 * @property {boolean} isLast
 */

/** Decodes the pictures of one model after another: it takes longest, so a worker does it. */
export class ModelDecoder {
  /**
   * @param {Arrays} data
   * @param {PictureCodec} codec
   * @param {ImageFilters} filters
   * @param {DecodeWebp} decodeWebp
   */
  constructor(data, codec, filters, decodeWebp) {
    this.data = data;
    this.codec = codec;
    this.filters = filters;
    this.decodeWebp = decodeWebp;
    /** @type {Heads | null} made when it is needed: after the first pictures */
    this.heads = null;
    /** @type {AppearanceDecoder | null} */
    this.appearance = null;
    /** @type {Uint8Array} of the model before */
    this.background = new Uint8Array(0);
  }

  /**
   * One by the player's data file.
   * @param {Arrays} data
   * @param {DecodeWebp} decodeWebp
   */
  static async load(data, decodeWebp) {
    const [codec, filters] = await Promise.all([PictureCodec.load(data), ImageFilters.load(data)]);
    return new ModelDecoder(data, codec, filters, decodeWebp);
  }

  /**
   * Decode what of a model has not been decoded: first what can be drawn, then mode by mode.
   * Throws `FormatError` if it is damaged.
   * @param {CodedPictures} coded
   * @returns {AsyncGenerator<DecodedStep>}
   */
  async *decode({ isThesis, width, height, texture, modes, background }) {
    let mean = null;
    if (!this.appearance?.isOf(texture, modes)) {
      const image = await this.#image(texture, "texture");
      this.appearance?.close();
      this.appearance = null;
      this.appearance = new AppearanceDecoder(this.codec, this.filters, texture, image, isThesis);
      mean = this.appearance.mean;
    }
    let pictures = null;
    if (!this.background.length || !sameBytes(this.background, background)) {
      pictures = await this.#background(background, width, height);
      this.background = background;
    }
    /** @type {DecodedStep} */
    const none = { mean: null, details: null, modes: [], background: null, isLast: false };
    if (mean || pictures) yield { ...none, mean, background: pictures };
    if (mean && !isThesis) {
      this.heads ??= new Heads(this.data);
      yield { ...none, details: this.appearance.details(this.heads.of({ isThesis })) };
    }
    for (const mode of this.appearance.further(modes)) yield { ...none, modes: [mode] };
    yield { ...none, isLast: true };
  }

  /**
   * @param {Uint8Array} data
   * @param {number} width
   * @param {number} height
   */
  #background(data, width, height) {
    const image = (/** @type {Uint8Array} */ own, /** @type {string} */ name) =>
      this.#image(own, name);
    return decodeBackground(this.codec, this.filters, image, data, width, height);
  }

  /**
   * @param {Uint8Array} data
   * @param {string} name
   */
  #image(data, name) {
    return decodeImage(this.codec, this.decodeWebp, data, name);
  }
}
