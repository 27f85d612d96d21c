import { array } from "../../data_file.js";
import { check } from "../errors.js";

/** @typedef {import("../../data_file.js").Arrays} Arrays */
/**
 * What `player/wasm/pictures.ts` exports; addresses are those of bytes in its memory.
 * @typedef {object} Exports
 * @property {WebAssembly.Memory} memory
 * @property {(index: number, inputs: number, hidden: number, outputs: number) => number} network
 * @property {(isOfProbabilities: boolean) => number} table
 * @property {() => number} weightsAt
 * @property {(kind: number, height: number, width: number, hasWeights: boolean) => void} begin
 * @property {(bytes: number) => number} inputOf
 * @property {(bytes: number, step: number) => number} decode
 * @property {(bytes: number, side: number) => number} mask
 * @property {() => number} left
 * @property {() => number} imageAt
 * @property {(plane: number, level: number, orientation: number) => number} gridAt
 */

/** A program of one function that has a vector: whether it is valid tells whether there are any. */
const WITH_VECTOR = [
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15,
  253, 98, 11,
];
const NETWORKS = [
  { name: "tiles", inputs: 21, hidden: 16 },
  { name: "sizes", inputs: 21, hidden: 40 },
  { name: "signs", inputs: 14, hidden: 24 },
];
const MAX_MAGNITUDE = 1023;
const MAX_LOGIT = 2048;
/** Byte offsets of the addresses of a network's weights behind its own. */
const WEIGHTS = { FEATURES: 12, CLASSES: 16, LAST: 20 };

/** Whether this browser runs what decodes pictures: WebAssembly with vectors. */
export function hasWebAssembly() {
  return typeof WebAssembly === "object" && WebAssembly.validate(Uint8Array.from(WITH_VECTOR));
}

/** Makes what decodes pictures, as many as work at a time. */
export class PictureCodec {
  /**
   * @param {WebAssembly.Module} module
   * @param {Arrays} data the player's data file
   */
  constructor(module, data) {
    this.module = module;
    this.data = data;
    const logarithms = Uint8Array.from({ length: MAX_MAGNITUDE + 1 }, (_, x) =>
      Math.round(16 * Math.log2(1 + x)),
    );
    const zeros = Int32Array.from({ length: 2 * MAX_LOGIT + 1 }, (_, i) => {
      const zero = Math.round(65536 / (1 + Math.exp(-(i - MAX_LOGIT) / 256)));
      return Math.min(Math.max(zero, 24), 65512);
    });
    this.tables = { logarithms, zeros };
    /** @type {CompiledDecoder[]} */
    this.free = [];
  }

  /**
   * That of the player's data file.
   * @param {Arrays} data
   */
  static async load(data) {
    const bytes = /** @type {Uint8Array<ArrayBuffer>} */ (array(data, "pictures_wasm"));
    return new PictureCodec(await WebAssembly.compile(bytes), data);
  }

  /** One that nobody else has. */
  take() {
    return this.free.pop() ?? new CompiledDecoder(this.module, this.tables, this.data);
  }

  /**
   * The mask (side, side) of a person.  Throws `FormatError` if it is damaged.
   * @param {Uint8Array} data
   * @param {number} side
   */
  mask(data, side) {
    const compiled = this.take();
    const { mask, left } = compiled.mask(data, side);
    this.giveBack(compiled);
    check(!left, `background: mask: ${left} bytes too many`);
    return mask;
  }

  /** @param {CompiledDecoder} compiled */
  giveBack(compiled) {
    this.free.push(compiled);
  }
}

/** The compiled decoder of pictures, see `player/wasm/pictures.ts`. */
class CompiledDecoder {
  /**
   * @param {WebAssembly.Module} module
   * @param {PictureCodec["tables"]} tables
   * @param {Arrays} data
   */
  constructor(module, { logarithms, zeros }, data) {
    const { exports } = new WebAssembly.Instance(module);
    this.exports = /** @type {Exports} */ (/** @type {unknown} */ (exports));
    new Uint8Array(this.#memory, this.exports.table(false)).set(logarithms);
    new Int32Array(this.#memory, this.exports.table(true)).set(zeros);
    for (const [index, network] of NETWORKS.entries()) this.#writeNetwork(index, network, data);
  }

  /** Its memory; it may have another one after each call. */
  get #memory() {
    return this.exports.memory.buffer;
  }

  /**
   * @param {number} index
   * @param {{name: string, inputs: number, hidden: number}} network
   * @param {Arrays} data whose arrays have the names of docs/format.md, Weights
   */
  #writeNetwork(index, { name, inputs, hidden }, data) {
    const of = (/** @type {string} */ part) => array(data, `${name}_${part}`);
    const last = of("last");
    const outputs = last.length / (hidden + 1);
    const at = this.exports.network(index, inputs, hidden, outputs);
    const view = new DataView(this.#memory);
    const addressOf = (/** @type {number} */ part) => view.getUint32(at + part, true);
    new Int32Array(this.#memory, addressOf(WEIGHTS.FEATURES)).set(of("features"));
    new Int32Array(this.#memory, addressOf(WEIGHTS.CLASSES)).set(of("classes"));
    const rows = new Float64Array(this.#memory, addressOf(WEIGHTS.LAST), outputs * (hidden + 2));
    // By output, and to an even number: what the compiled decoder adds up at a time.
    for (let output = 0; output < outputs; output++) {
      for (let j = 0; j <= hidden; j++)
        rows[output * (hidden + 2) + j] = last[j * outputs + output];
    }
  }

  /**
   * Begin pictures of a kind and size.
   * @param {number} kind
   * @param {number} height
   * @param {number} width
   * @param {Float64Array | null} weights see `decodeWeightMap`
   */
  begin(kind, height, width, weights) {
    if (weights) new Float32Array(this.#memory, this.exports.weightsAt()).set(weights);
    this.exports.begin(kind, height, width, weights !== null);
  }

  /**
   * Decode the coefficients of a picture: how many bytes are too many, or -1 if they are damaged.
   * @param {Uint8Array} data
   * @param {number} step
   */
  decode(data, step) {
    const at = this.exports.inputOf(data.length);
    new Uint8Array(this.#memory, at).set(data);
    return this.exports.decode(data.length, step);
  }

  /**
   * A mask (side, side), and how many bytes are too many.
   * @param {Uint8Array} data
   * @param {number} side
   */
  mask(data, side) {
    const input = this.exports.inputOf(data.length);
    new Uint8Array(this.#memory, input).set(data);
    const at = this.exports.mask(data.length, side);
    const mask = new Uint8Array(this.#memory, at, side * side).slice();
    return { mask, left: this.exports.left() };
  }

  /**
   * So many values of the newest image.
   * @param {number} count
   */
  image(count) {
    return new Float32Array(this.#memory, this.exports.imageAt(), count).slice();
  }

  /**
   * The quantised coefficients of a subband of the newest picture, row by row.
   * @param {number} plane
   * @param {number} level
   * @param {number} orientation
   */
  coefficients(plane, level, orientation) {
    const grid = new Int32Array(this.#memory, this.exports.gridAt(plane, level, orientation), 4);
    const [height, width, across, cells] = grid;
    const values = new Int32Array(height * width);
    for (let i = 0; i < height; i++) {
      const row = new Int32Array(this.#memory, cells + 4 * ((i + 2) * across + 2), width);
      values.set(row, i * width);
    }
    return values;
  }
}
