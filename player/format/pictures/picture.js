import { ByteReader } from "../bytes.js";
import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { check } from "../errors.js";
import { CONTEXT_GRIDS, decodeBand } from "./band_decoder.js";
import { addBand, bandOf, emptyPyramid, magnitudes, mapBands, ringSums } from "./bands.js";
import { planeOf } from "./wavelet.js";
import { decodeWeightMap } from "./weight_map.js";

/** @typedef {import("./bands.js").Band} Band */
/** @typedef {import("./bands.js").Pyramid} Pyramid */
/** @typedef {import("./probability_network.js").ProbabilityNetworks} ProbabilityNetworks */
/**
 * A colour picture: values (height, width, 3) in the order R, G, B, row by row.
 * @typedef {{height: number, width: number, values: Float32Array}} Image
 */

const KINDS = { BACKGROUND: 0, TEXTURE: 1, MODE: 2 };
const LOWPASS = 3;
const MAX_STEP_CODE = 80;
const TAGS = new Map([
  [0x53, KINDS.BACKGROUND],
  [0x54, KINDS.TEXTURE],
]);
/** Weights of blue, green and red in luma. */
export const BLUE = 0.114;
export const GREEN = 0.587;
export const RED = 0.299;

/** Pictures of one kind and size, each decoded in the context of those before. */
class PictureSequence {
  /**
   * @param {ProbabilityNetworks} networks
   * @param {number} kind
   * @param {number} height
   * @param {number} width
   * @param {Float64Array | null} weights (height, width); null: all are 1
   */
  constructor(networks, kind, height, width, weights) {
    this.networks = networks;
    this.kind = kind;
    this.height = height;
    this.width = width;
    this.weights = weights;
    this.pictures = 0;
    /** @type {Pyramid[]} */
    this.last = [];
    /** @type {Pyramid[]} sums of magnitudes of all pictures so far */
    this.totals = [];
  }

  /**
   * Decode step code and coefficients of the next picture.
   * @param {Uint8Array} data
   * @param {string} name of it, for messages
   * @returns {Image}
   */
  decode(data, name) {
    check(data.length && data[0] <= MAX_STEP_CODE, `${name} has no step`);
    const decoder = new RangeDecoder(data.subarray(1));
    const half = [Math.ceil(this.height / 2), Math.ceil(this.width / 2)];
    const sizes = [[this.height, this.width], half, half];
    const integers = new AdaptiveIntegers(2);
    /** @type {Pyramid[]} */
    const planes = [];
    for (const [height, width] of sizes) {
      planes.push(this.#plane(decoder, planes, emptyPyramid(height, width), integers));
    }
    decoder.end(name);
    this.#advance(planes);
    return this.#image(planes, 2 ** (data[0] / 8));
  }

  /** @param {Pyramid[]} planes */
  #advance(planes) {
    const before = this.totals;
    this.totals = planes.map((pyramid, plane) =>
      mapBands(pyramid, (band, level, orientation) => {
        const sums = magnitudes(band);
        if (before.length) {
          const old = bandOf(before[plane], level, orientation).values;
          for (let i = 0; i < old.length; i++) sums.values[i] += old[i];
        }
        return sums;
      }),
    );
    this.last = planes;
    this.pictures++;
  }

  /**
   * @param {RangeDecoder} decoder
   * @param {Pyramid[]} planes those before
   * @param {Pyramid} pyramid written
   * @param {AdaptiveIntegers} integers
   */
  #plane(decoder, planes, pyramid, integers) {
    if (this.kind === KINDS.MODE) {
      pyramid.lowpass = this.#band(decoder, planes, pyramid.lowpass, 0, LOWPASS, [], []);
    } else {
      decodeLowpass(decoder, pyramid.lowpass, integers, planes.length ? 1 : 0);
    }
    /** @type {Band[]} */
    let parents = [];
    for (const [index, level] of pyramid.details.entries()) {
      for (const [orientation, band] of level.entries()) {
        if (!band.values.length) continue;
        const done = level.slice(0, orientation);
        level[orientation] = this.#band(
          decoder,
          planes,
          band,
          index + 1,
          orientation,
          parents,
          done,
        );
      }
      parents = level.map(magnitudes);
    }
    return pyramid;
  }

  /**
   * @param {RangeDecoder} decoder
   * @param {Pyramid[]} planes
   * @param {Band} empty of its size
   * @param {number} level
   * @param {number} orientation
   * @param {Band[]} parents magnitudes of the coarser level
   * @param {Band[]} done bands of this level
   */
  #band(decoder, planes, { height, width }, level, orientation, parents, done) {
    const plane = planes.length;
    /** @type {(Int32Array | null)[]} */
    const grids = new Array(CONTEXT_GRIDS).fill(null);
    const add = (/** @type {number} */ grid, /** @type {Band} */ band, repeat = 1) => {
      const values = grids[grid - 1] ?? new Int32Array(height * width);
      addBand(values, height, width, band, repeat);
      grids[grid - 1] = values;
    };
    if (parents.length) {
      const own = parents[orientation];
      add(1, own, 2);
      add(2, ringSums(own), 2);
      for (const [other, parent] of parents.entries()) {
        if (other !== orientation) add(3, cut(parent, own), 2);
      }
    }
    for (const [i, band] of done.slice().reverse().entries()) add(4 + i, magnitudes(band));
    if (this.pictures) {
      add(6, bandOf(this.totals[plane], level, orientation));
      add(7, bandOf(this.last[plane], level, orientation));
    }
    if (plane && level > 1) add(8, bandOf(planes[0], level - 1, orientation));
    if (plane > 1) add(9, bandOf(planes[1], level, orientation));
    const place = { kind: this.kind, plane, level, orientation, pictures: this.pictures };
    return decodeBand(decoder, this.networks, place, height, width, grids);
  }

  /**
   * @param {Pyramid[]} pyramids
   * @param {number} step
   * @returns {Image}
   */
  #image(pyramids, step) {
    const { height, width, weights } = this;
    const [luma, first, second] = pyramids.map((pyramid) => planeOf(pyramid, step));
    const blues = enlarged(first, height, width);
    const reds = enlarged(second, height, width);
    const chroma = this.kind === KINDS.MODE ? 0.3 : 0.5;
    const offset = this.kind === KINDS.MODE ? 0 : 128;
    const values = new Float32Array(3 * height * width);
    for (let i = 0; i < height * width; i++) {
      const weight = weights ? weights[i] : 1;
      const y = Math.fround(luma.values[i] / weight + offset);
      const blue = y + Math.fround(blues[i] / weight) / chroma;
      const red = y + Math.fround(reds[i] / weight) / chroma;
      values[3 * i] = red;
      values[3 * i + 1] = (y - BLUE * blue - RED * red) / GREEN;
      values[3 * i + 2] = blue;
    }
    return { height, width, values };
  }
}

/**
 * A band cut or filled with zeros to the size of another.
 * @param {Band} band
 * @param {Band} other
 * @returns {Band}
 */
function cut(band, { height, width }) {
  if (band.height === height && band.width === width) return band;
  const values = new Int32Array(height * width);
  addBand(values, height, width, band, 1);
  return { height, width, values };
}

/**
 * @param {RangeDecoder} decoder
 * @param {Band} band written
 * @param {AdaptiveIntegers} integers
 * @param {number} context
 */
function decodeLowpass(decoder, band, integers, context) {
  const { height, width, values } = band;
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const left = j ? values[i * width + j - 1] : 0;
      const above = i ? values[(i - 1) * width + j] : 0;
      const corner = i && j ? values[(i - 1) * width + j - 1] : 0;
      values[i * width + j] = left + above - corner + integers.decode(decoder, context);
    }
  }
}

/**
 * A plane of half the size, enlarged linearly.
 * @param {import("./wavelet.js").Plane} plane
 * @param {number} height
 * @param {number} width
 */
function enlarged(plane, height, width) {
  const rows = new Float64Array(height * plane.width);
  const line = (/** @type {number} */ i, /** @type {number} */ count) => {
    const at = Math.min(Math.max((i + 0.5) / 2 - 0.5, 0), count - 1);
    const low = Math.min(Math.floor(at), Math.max(count - 2, 0));
    return [low, Math.min(low + 1, count - 1), at - low];
  };
  for (let i = 0; i < height; i++) {
    const [low, high, part] = line(i, plane.height);
    for (let j = 0; j < plane.width; j++) {
      const a = plane.values[low * plane.width + j];
      rows[i * plane.width + j] = a + part * (plane.values[high * plane.width + j] - a);
    }
  }
  const result = new Float64Array(height * width);
  for (let j = 0; j < width; j++) {
    const [low, high, part] = line(j, plane.width);
    for (let i = 0; i < height; i++) {
      const a = rows[i * plane.width + low];
      result[i * width + j] = a + part * (rows[i * plane.width + high] - a);
    }
  }
  return result;
}

/**
 * Whether bytes begin like a picture of the codec.
 * @param {Uint8Array} data
 */
export function isPicture(data) {
  return TAGS.has(data[0]);
}

/**
 * The size of a picture, and its weight map.
 * @param {Uint8Array} data
 * @param {string} name of it, for messages
 */
export function parsePictureHeader(data, name) {
  const reader = new ByteReader(data, name);
  const kind = TAGS.get(reader.byte());
  check(kind !== undefined, `${name} is no picture that this player knows`);
  const width = reader.varint();
  const height = reader.varint();
  check(width && height, `${name} is ${width}x${height}`);
  const weightMap = reader.take(reader.byte());
  return { kind, width, height, weightMap, coefficients: reader.rest() };
}

/**
 * Decode a background or a texture.
 * @param {ProbabilityNetworks} networks
 * @param {Uint8Array} data
 * @param {string} name of it, for messages
 * @param {number} limit of its sides, pixels
 * @returns {Image}
 */
export function decodePicture(networks, data, name, limit) {
  const { kind, width, height, weightMap, coefficients } = parsePictureHeader(data, name);
  check(Math.max(width, height) <= limit, `${name} is ${width}x${height}, limit ${limit} a side`);
  const weights = decodeWeightMap(weightMap, height, width);
  return new PictureSequence(networks, kind, height, width, weights).decode(coefficients, name);
}

/**
 * The decoder of appearance modes or of changes.
 * @param {ProbabilityNetworks} networks
 * @param {number} height
 * @param {number} width
 * @param {Uint8Array} weightMap
 */
export function modeDecoder(networks, height, width, weightMap) {
  const weights = decodeWeightMap(weightMap, height, width);
  return new PictureSequence(networks, KINDS.MODE, height, width, weights);
}
