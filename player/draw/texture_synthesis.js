// The texture of a frame: a mean and its modes times their coefficients, within the colours nearby;
// see `decoder/rendering/texture_colour.py`.
import { array } from "../data_file.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./appearance.js").MeanTexture} MeanTexture */
/**
 * What `player/wasm/texture.ts` exports; addresses are those of bytes in its memory.
 * @typedef {object} Exports
 * @property {WebAssembly.Memory} memory
 * @property {(texels: number) => number} meanAt
 * @property {() => number} limitsAt
 * @property {() => number} modeAt
 * @property {() => number} coefficientsAt
 * @property {(isLimited: boolean) => number} synthesise
 */

/** Makes textures; what it was given last stays in its memory. */
export class TextureSynthesis {
  /** @param {Exports} exports */
  constructor(exports) {
    this.exports = exports;
    /** @type {MeanTexture | null} */
    this.mean = null;
    /** @type {Float32Array[]} */
    this.modes = [];
  }

  /**
   * The compiled one of the player's data file.
   * @param {Arrays} data
   */
  static async load(data) {
    const bytes = /** @type {Uint8Array<ArrayBuffer>} */ (array(data, "texture_wasm"));
    const { instance } = await WebAssembly.instantiate(bytes);
    return new TextureSynthesis(/** @type {Exports} */ (/** @type {unknown} */ (instance.exports)));
  }

  /**
   * Make the texture of a frame; without coefficients it is the mean as it was sent.
   * @param {MeanTexture} mean
   * @param {Float32Array[]} modes each (size, size, 3)
   * @param {Float64Array} coefficients of modes; missing ones are 0
   * @param {Uint8ClampedArray} drawn (size, size, 4) R, G, B and alpha, written
   */
  synthesise(mean, modes, coefficients, drawn) {
    this.#take(mean, modes);
    const weights = modes.map((_, k) => coefficients[k] ?? 0);
    this.#write(this.exports.coefficientsAt(), weights);
    const at = this.exports.synthesise(mean.limits !== null && coefficients.length > 0);
    drawn.set(new Uint8Array(this.exports.memory.buffer, at, drawn.length));
  }

  /**
   * @param {MeanTexture} mean
   * @param {Float32Array[]} modes
   */
  #take(mean, modes) {
    const { exports } = this;
    const isKnown =
      mean.mean === this.mean?.mean && this.modes.every((mode, k) => mode === modes[k]);
    if (!isKnown) {
      this.#write(exports.meanAt(mean.size ** 2), mean.mean);
      this.modes = [];
    }
    if (mean.limits && !(isKnown && mean.limits === this.mean?.limits)) {
      this.#write(exports.limitsAt(), mean.limits.low);
      this.#write(exports.limitsAt() + mean.limits.low.byteLength, mean.limits.high);
    }
    this.mean = mean;
    for (const mode of modes.slice(this.modes.length)) {
      this.#write(exports.modeAt(), mode);
      this.modes.push(mode);
    }
  }

  /**
   * @param {number} at
   * @param {ArrayLike<number>} values
   */
  #write(at, values) {
    new Float32Array(this.exports.memory.buffer, at).set(values);
  }
}
