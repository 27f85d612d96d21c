import { sameBytes } from "../format/bytes.js";
import { ProbabilityNetworks } from "../format/pictures/probability_network.js";
import { Heads } from "../model/heads.js";
import { AppearanceDecoder } from "./appearance.js";
import { decodeBackground } from "./background_pictures.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./appearance.js").MeanTexture} MeanTexture */
/** @typedef {import("./background_pictures.js").BackgroundPictures} BackgroundPictures */
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
 * What has been decoded of a model; null: as of the model before.
 * @typedef {object} DecodedPictures
 * @property {MeanTexture | null} mean
 * @property {Float32Array[]} modes those beside the ones of the model before, where its texture is
 *     taken over
 * @property {BackgroundPictures | null} background
 */

/** Decodes the pictures of one model after another: it takes longest, so a worker does it. */
export class ModelDecoder {
  /** @param {Arrays} data */
  constructor(data) {
    this.networks = new ProbabilityNetworks(/** @type {Map<string, Int32Array>} */ (data));
    this.heads = new Heads(data);
    /** @type {AppearanceDecoder | null} */
    this.appearance = null;
    this.background = new Uint8Array(0);
  }

  /**
   * Decode what of a model has not been decoded.  Throws `FormatError` if it is damaged.
   * @param {CodedPictures} coded
   * @returns {DecodedPictures}
   */
  decode({ isThesis, width, height, texture, modes, background }) {
    let mean = null;
    if (!this.appearance?.isOf(texture, modes)) {
      const head = this.heads.of({ isThesis });
      this.appearance = new AppearanceDecoder(this.networks, head, texture, isThesis);
      mean = this.appearance.mean;
    }
    const further = this.appearance.further(modes);
    let pictures = null;
    if (!this.background.length || !sameBytes(this.background, background)) {
      pictures = decodeBackground(this.networks, background, width, height);
      this.background = background;
    }
    return { mean, modes: further, background: pictures };
  }
}
