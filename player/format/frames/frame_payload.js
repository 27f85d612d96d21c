import { RangeDecoder } from "../entropy/range_decoder.js";
import { check } from "../errors.js";
import { KINDS } from "./frame_transform.js";
import { MEAN, RATIO_BOUNDS, RATIO_CORRECTIONS, STOP, ZERO } from "./value_tables.js";

const UNLIKELY_ONE = 65024;
const KIND_STEP = [0, 0, 1, 3, 4];
const QUARTERS = [64, 76, 91, 108];
const DAMPING = [16, 15, 15, 14, 13, 12, 10, 8, 5, 0];
const GAIN = [0, 0, 0, 0, 0, 0, 1, 1, 1, 2];
const REFRESH_PERIOD = 3;
const TABLES = ZERO.length;
const UNARY_LIMIT = 40;
const MAX_VALUE = 2 ** 40;
const INTRA = 0;
const ANCHOR = 1;

/** @typedef {{index: number, left: number, right: number, kind: number}} CodedFrame */
/**
 * @typedef {object} Payload
 * @property {number} quality
 * @property {boolean} intra
 * @property {number} unused
 * @property {{index: number, values: Int32Array}[]} residuals in coding order
 * @property {Float64Array[]} frames integers in 1/256, in order of time
 */

/** What predicts the frames of a model's packets, see docs/format.md, Prediction. */
export class FramePredictor {
  /**
   * @param {Int32Array} scaleCodes (n, KINDS)
   * @param {number} reserved so many of the last components may be unused
   */
  constructor(scaleCodes, reserved) {
    this.components = scaleCodes.length / KINDS;
    this.reserved = reserved;
    this.scaleCodes = scaleCodes.slice();
    this.damping = new Int32Array(this.components);
    for (let c = 0; c < this.components; c++) {
      const at = c * KINDS;
      const relative = scaleCodes[at + ANCHOR] - scaleCodes[at + INTRA];
      const r = Math.min(Math.max(relative + 7, 0), DAMPING.length - 1);
      this.damping[c] = DAMPING[r];
      this.scaleCodes[at + ANCHOR] = Math.max(0, scaleCodes[at + ANCHOR] - GAIN[r]);
    }
  }

  /**
   * Decode a payload.  Throws `FormatError` if no encoder makes it.
   * @param {Uint8Array} data
   * @param {Float64Array} anchor the last frame of the packet before
   * @param {number} number of the packet within its model
   * @param {number} nominal frames of a packet whose header states no other number
   * @returns {Payload}
   */
  decode(data, anchor, number, nominal) {
    const decoder = new RangeDecoder(data);
    const header = readHeader(decoder, nominal, this.reserved);
    const context = new ValueContext();
    /** @type {Map<number, Int32Array>} */
    const residuals = new Map();
    const decoded = new Map([[0, anchor]]);
    for (const frame of codingOrder(header.frames)) {
      const values = this.#residuals(decoder, context, frame, header, residuals, number);
      residuals.set(frame.index, values);
      decoded.set(frame.index, this.#reconstruct(frame, header, decoded, values, number));
    }
    decoder.end("frame packet");
    return {
      ...header,
      residuals: [...residuals].map(([index, values]) => ({ index, values })),
      frames: Array.from(
        { length: header.frames },
        (_, i) => /** @type {Float64Array} */ (decoded.get(i + 1)),
      ),
    };
  }

  /**
   * The kind of prediction of a component.
   * @param {CodedFrame} frame
   * @param {number} c
   * @param {boolean} intra
   * @param {number} number
   */
  #kind(frame, c, intra, number) {
    if (frame.kind !== ANCHOR) return frame.kind;
    const isRefreshed = c % REFRESH_PERIOD === (number % 64) % REFRESH_PERIOD;
    return intra || isRefreshed ? INTRA : ANCHOR;
  }

  /**
   * @param {RangeDecoder} decoder
   * @param {ValueContext} context
   * @param {CodedFrame} frame
   * @param {ReturnType<typeof readHeader>} header
   * @param {Map<number, Int32Array>} known
   * @param {number} number
   */
  #residuals(decoder, context, frame, header, known, number) {
    const values = new Int32Array(this.components);
    const isBetween = frame.kind !== ANCHOR;
    const left = isBetween ? known.get(frame.left) : undefined;
    const right = isBetween ? known.get(frame.right) : undefined;
    context.startFrame();
    for (let c = 0; c < this.components - header.unused; c++) {
      const kind = this.#kind(frame, c, header.intra, number);
      const scale = this.scaleCodes[c * KINDS + kind];
      const base = clipTable(scale - 8 - header.quality - KIND_STEP[kind] + 20);
      const around = Math.abs(left?.[c] ?? 0) + Math.abs(right?.[c] ?? 0);
      values[c] = decodeValue(decoder, context.table(base, around));
      context.update(base, Math.abs(values[c]));
    }
    return values;
  }

  /**
   * @param {CodedFrame} frame
   * @param {ReturnType<typeof readHeader>} header
   * @param {Map<number, Float64Array>} decoded
   * @param {Int32Array} residuals
   * @param {number} number
   */
  #reconstruct(frame, header, decoded, residuals, number) {
    const values = new Float64Array(this.components);
    const at = (/** @type {number} */ index) => decoded.get(index);
    const left = /** @type {Float64Array} */ (at(frame.left));
    const right = at(frame.right) ?? left;
    const span = frame.right - frame.left;
    const offset = frame.index - frame.left;
    const before = at(frame.left - span);
    const after = at(frame.right + span);
    for (let c = 0; c < this.components; c++) {
      const kind = this.#kind(frame, c, header.intra, number);
      let prediction = 0;
      if (kind === ANCHOR) {
        prediction = Math.floor((left[c] * this.damping[c]) / 16);
      } else if (kind !== INTRA) {
        const straight = left[c] * (span - offset) + right[c] * offset;
        const outer =
          (before?.[c] ?? 2 * left[c] - right[c]) + (after?.[c] ?? 2 * right[c] - left[c]);
        const curved = 16 * straight + span * (left[c] + right[c] - outer);
        prediction = Math.floor(curved / (16 * span));
      }
      const value = prediction + residuals[c] * step(header.quality, kind);
      values[c] = Math.min(Math.max(value, -MAX_VALUE), MAX_VALUE);
    }
    return values;
  }
}

/**
 * @param {RangeDecoder} decoder
 * @param {number} nominal
 * @param {number} reserved
 */
function readHeader(decoder, nominal, reserved) {
  const quality = decoder.bits(5);
  const intra = decoder.bit(UNLIKELY_ONE) === 1;
  const frames = decoder.bit(UNLIKELY_ONE) ? decoder.bits(6) + 1 : nominal;
  check(frames <= nominal, `frame packet: ${frames} frames, limit ${nominal}`);
  const unused = decoder.bits(reserved ? Math.floor(Math.log2(reserved)) + 1 : 0);
  check(unused <= reserved, `frame packet: ${unused} components unused, limit ${reserved}`);
  return { quality, intra, frames, unused };
}

/**
 * The frames of a packet in the order in which they are coded.
 * @param {number} count
 * @returns {CodedFrame[]}
 */
function codingOrder(count) {
  const order = [{ index: count, left: 0, right: 0, kind: ANCHOR }];
  const waiting = [[0, count, ANCHOR + 1]];
  for (const [left, right, kind] of waiting) {
    if (right - left <= 1) continue;
    const middle = Math.floor((left + right) / 2);
    order.push({ index: middle, left, right, kind: Math.min(kind, KINDS - 1) });
    waiting.push([left, middle, kind + 1], [middle, right, kind + 1]);
  }
  return order;
}

/**
 * The quantiser's step, in 1/256.
 * @param {number} quality
 * @param {number} kind
 */
function step(quality, kind) {
  const quarters = quality + KIND_STEP[kind];
  return QUARTERS[quarters % 4] << (quarters >> 2);
}

/** @param {number} index */
function clipTable(index) {
  return Math.min(Math.max(index, 0), TABLES - 1);
}

/** The context of the residuals of one packet. */
class ValueContext {
  constructor() {
    this.magnitudes = 0;
    this.expected = 0;
    this.frameMagnitudes = 0;
    this.frameExpected = 0;
    this.last = 0;
    this.lastButOne = 0;
  }

  /** Begin the next frame of the packet. */
  startFrame() {
    this.magnitudes += this.frameMagnitudes;
    this.expected += this.frameExpected;
    this.frameMagnitudes = 0;
    this.frameExpected = 0;
    this.last = 0;
    this.lastButOne = 0;
  }

  /**
   * The table of the next value.
   * @param {number} base its table without context
   * @param {number} around magnitudes of the component in the frames that predict this one
   */
  table(base, around) {
    const observed = 3 * this.frameMagnitudes + this.magnitudes + 1;
    const expected = 3 * this.frameExpected + this.expected + 256;
    const ratio = Math.floor((65536 * observed) / expected);
    const u = RATIO_CORRECTIONS[RATIO_BOUNDS.filter((bound) => bound <= ratio).length];
    const v = this.last || this.lastButOne ? 1 : -1;
    return clipTable(base + u + v + (around >= 2 ? 1 : 0));
  }

  /**
   * Add the value that was decoded.
   * @param {number} base
   * @param {number} magnitude
   */
  update(base, magnitude) {
    this.frameMagnitudes += magnitude;
    this.frameExpected += MEAN[base];
    this.lastButOne = this.last;
    this.last = magnitude ? 1 : 0;
  }
}

/**
 * @param {RangeDecoder} decoder
 * @param {number} table
 */
function decodeValue(decoder, table) {
  if (!decoder.bit(ZERO[table])) return 0;
  const isNegative = decoder.evenBit();
  let magnitude = 1;
  while (magnitude <= UNARY_LIMIT && decoder.bit(STOP[table])) magnitude++;
  if (magnitude > UNARY_LIMIT) {
    magnitude += 16 * decoder.expGolomb(12);
    magnitude += decoder.bits(4);
  }
  return isNegative ? -magnitude : magnitude;
}
