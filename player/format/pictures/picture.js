import { ByteReader } from "../bytes.js";
import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { check } from "../errors.js";
import { decodeBand } from "./band_decoder.js";
import { bandOf, emptyPyramid, parentsOf } from "./bands.js";
import { linearPlaces } from "./linear_places.js";
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
const PLANES = 3;
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
export class PictureSequence {
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
    /** @type {Pyramid[] | null} sums of magnitudes of all pictures so far */
    this.totals = null;
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
    const integers = new AdaptiveIntegers(2);
    /** @type {Pyramid[]} */
    const planes = [];
    for (let plane = 0; plane < PLANES; plane++) {
      const pyramid = emptyPyramid(...this.#size(plane));
      this.#plane(decoder, planes, pyramid, integers);
      planes.push(pyramid);
    }
    decoder.end(name);
    this.#advance(planes);
    return this.#image(planes, 2 ** (data[0] / 8));
  }

  /** @param {Pyramid[]} planes */
  #advance(planes) {
    const totals =
      this.totals ?? [...planes.keys()].map((plane) => emptyPyramid(...this.#size(plane)));
    for (const [plane, pyramid] of planes.entries()) {
      totals[plane].lowpass.addMagnitudes(pyramid.lowpass, 1);
      for (const [level, bands] of pyramid.details.entries()) {
        for (const [orientation, band] of bands.entries())
          totals[plane].details[level][orientation].addMagnitudes(band, 1);
      }
    }
    this.totals = totals;
    this.last = planes;
    this.pictures++;
  }

  /**
   * Height and width of a plane.
   * @param {number} plane
   * @returns {[number, number]}
   */
  #size(plane) {
    return plane
      ? [Math.ceil(this.height / 2), Math.ceil(this.width / 2)]
      : [this.height, this.width];
  }

  /**
   * @param {RangeDecoder} decoder
   * @param {Pyramid[]} planes those before
   * @param {Pyramid} pyramid written
   * @param {AdaptiveIntegers} integers
   */
  #plane(decoder, planes, pyramid, integers) {
    if (this.kind === KINDS.MODE) {
      this.#band(decoder, planes, pyramid, 0, LOWPASS);
    } else {
      decodeLowpass(decoder, pyramid.lowpass, integers, planes.length ? 1 : 0);
    }
    for (const [index, level] of pyramid.details.entries()) {
      for (const [orientation, { height, width }] of level.entries()) {
        if (height && width) this.#band(decoder, planes, pyramid, index + 1, orientation);
      }
    }
  }

  /**
   * @param {RangeDecoder} decoder
   * @param {Pyramid[]} planes
   * @param {Pyramid} pyramid written
   * @param {number} level
   * @param {number} orientation
   */
  #band(decoder, planes, pyramid, level, orientation) {
    const plane = planes.length;
    const band = bandOf(pyramid, level, orientation);
    const parents = level > 1 ? parentsOf(pyramid.details[level - 2], orientation) : null;
    const done = level ? pyramid.details[level - 1].slice(0, orientation).reverse() : [];
    const beside = [
      done[0],
      done[1],
      this.totals && bandOf(this.totals[plane], level, orientation),
      this.totals && bandOf(this.last[plane], level, orientation),
      plane && level > 1 ? bandOf(planes[0], level - 1, orientation) : null,
      plane > 1 ? bandOf(planes[1], level, orientation) : null,
    ].map((each) => each?.fitted(band.height, band.width) ?? null);
    const place = { kind: this.kind, plane, level, orientation, pictures: this.pictures };
    decodeBand(decoder, this.networks, place, band, parents, beside);
  }

  /**
   * @param {Pyramid[]} pyramids
   * @param {number} step
   * @returns {Image}
   */
  #image(pyramids, step) {
    const { height, width, weights } = this;
    const [luma, first, second] = pyramids.map((pyramid) => planeOf(pyramid, step));
    const blues = new Enlargement(first, height, width);
    const reds = new Enlargement(second, height, width);
    const chroma = this.kind === KINDS.MODE ? 0.3 : 0.5;
    const offset = this.kind === KINDS.MODE ? 0 : 128;
    const values = new Float32Array(3 * height * width);
    for (let i = 0, at = 0; i < height; i++) {
      const blueLine = blues.row(i);
      const redLine = reds.row(i);
      for (let j = 0; j < width; j++, at++) {
        const weight = weights ? weights[at] : 1;
        const y = Math.fround(luma.values[at] / weight + offset);
        const blue = y + Math.fround(blueLine[j] / weight) / chroma;
        const red = y + Math.fround(redLine[j] / weight) / chroma;
        values[3 * at] = red;
        values[3 * at + 1] = (y - BLUE * blue - RED * red) / GREEN;
        values[3 * at + 2] = blue;
      }
    }
    return { height, width, values };
  }
}

/**
 * @param {RangeDecoder} decoder
 * @param {Band} band written
 * @param {AdaptiveIntegers} integers
 * @param {number} context
 */
function decodeLowpass(decoder, band, integers, context) {
  const { height, width, across, written } = band;
  for (let i = 0; i < height; i++) {
    for (let j = 0, at = band.place(i, 0); j < width; j++, at++) {
      const known = written[at - 1] + written[at - across] - written[at - across - 1];
      written[at] = known + integers.decode(decoder, context);
    }
  }
}

/** A plane of half the size, enlarged linearly, row by row. */
class Enlargement {
  /**
   * @param {import("./wavelet.js").Plane} plane
   * @param {number} height
   * @param {number} width
   */
  constructor(plane, height, width) {
    this.plane = plane;
    this.rows = linearPlaces(height, plane.height, 2 * plane.height);
    this.columns = linearPlaces(width, plane.width, 2 * plane.width);
    this.line = new Float64Array(plane.width);
    this.enlarged = new Float64Array(width);
  }

  /**
   * A row of the result, until the next one is asked for.
   * @param {number} i
   */
  row(i) {
    const { plane, rows, columns, line, enlarged } = this;
    const { values, width } = plane;
    const [low, high, part] = [rows.low[i] * width, rows.high[i] * width, rows.part[i]];
    for (let j = 0; j < width; j++) {
      const upper = values[low + j];
      line[j] = upper + part * (values[high + j] - upper);
    }
    for (let j = 0; j < enlarged.length; j++) {
      const left = line[columns.low[j]];
      enlarged[j] = left + columns.part[j] * (line[columns.high[j]] - left);
    }
    return enlarged;
  }
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
