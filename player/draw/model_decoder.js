import { sameBytes } from "../format/bytes.js";
import { ProbabilityNetworks } from "../format/pictures/probability_network.js";
import { Heads } from "../model/heads.js";
import { AppearanceDecoder } from "./appearance.js";
import { decodeBackground } from "./background_pictures.js";
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
   * @param {DecodeWebp} decodeWebp
   */
  constructor(data, decodeWebp) {
    this.decodeWebp = decodeWebp;
    this.networks = new ProbabilityNetworks(/** @type {Map<string, Int32Array>} */ (data));
    this.data = data;
    /** @type {Heads | null} made when it is needed: after the first pictures */
    this.heads = null;
    /** @type {AppearanceDecoder | null} */
    this.appearance = null;
    /** @type {Uint8Array} of the model before */
    this.background = new Uint8Array(0);
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
      this.appearance = new AppearanceDecoder(this.networks, texture, image, isThesis);
      mean = this.appearance.mean;
    }
    let pictures = null;
    if (!this.background.length || !sameBytes(this.background, background)) {
      const decode = (/** @type {Uint8Array} */ data, /** @type {string} */ name) =>
        this.#image(data, name);
      pictures = await decodeBackground(this.networks, decode, background, width, height);
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
   * @param {string} name
   */
  #image(data, name) {
    return decodeImage(this.networks, this.decodeWebp, data, name);
  }
}
