// Closed eyelids of a caller who has not been seen with closed eyes; see
// `decoder/rendering/closed_lids.py`.
import { BLUE, GREEN, RED } from "../format/pictures/picture.js";
import { PARTS } from "../model/head.js";
import { LIDS, smoothstep } from "../model/parameters.js";

/** @typedef {import("./atlas.js").Atlas} Atlas */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */
/**
 * The closed lids of a caller in their texture.
 * @typedef {object} Lids
 * @property {number} size texels a side
 * @property {{left: number, right: number, top: number, bottom: number}} area around them
 * @property {Float32Array[]} weights (2, size, size) how much a texel belongs to either lid
 * @property {Float32Array} light (size, size, 3) colour of the skin around, of luma 1
 * @property {Float32Array} least (size, size) least luma
 */

const REACH = 1 / 10;
const NEAR = 1 / 24;
const LID_SHARES = [0.1, 0.4];
const LASH_SHARE = 0.85;
const LASH_LIGHT = 0.5;
const AROUND_SHARE = 0.03;
const CLOSING = 0.4;
const CLOSED = 0.75;
const LEAST_LIGHT = 0.55;

/** How much the texels of an atlas belong to the lids. */
class LidTexels {
  /** @param {Atlas} atlas */
  constructor(atlas) {
    const { size, head } = atlas;
    const motions = LIDS.map((lid) => relativeMotion(head.eauUp.at(lid), head.count));
    /** (2, size, size) of the left and the right lid */
    this.weights = LIDS.map(() => new Float32Array(size * size));
    this.isAround = new Uint8Array(size * size);
    this.area = { left: size, right: 0, top: size, bottom: 0 };
    for (let at = 0; at < size * size; at++) {
      if (atlas.partAt(at) !== PARTS.SKIN) continue;
      this.isAround[at] = 1;
      for (let lid = 0; lid < motions.length; lid++) {
        const share = atlas.valueAt(at, motions[lid]);
        if (share >= AROUND_SHARE) this.isAround[at] = 0;
        if (share <= LID_SHARES[0]) continue;
        const lashes = smoothstep((share - LASH_SHARE) / (1 - LASH_SHARE));
        const own = smoothstep((share - LID_SHARES[0]) / (LID_SHARES[1] - LID_SHARES[0]));
        const weight = own * (1 - (1 - LASH_LIGHT) * lashes);
        this.weights[lid][at] = weight;
        if (weight) this.#extend(at % size, Math.floor(at / size));
      }
    }
  }

  /**
   * @param {number} column
   * @param {number} row
   */
  #extend(column, row) {
    const { area } = this;
    area.left = Math.min(area.left, column);
    area.right = Math.max(area.right, column + 1);
    area.top = Math.min(area.top, row);
    area.bottom = Math.max(area.bottom, row + 1);
  }
}

/**
 * How far each vertex moves with a field, relative to the farthest.
 * @param {Float32Array} field
 * @param {number} count
 */
function relativeMotion(field, count) {
  const motion = Float64Array.from({ length: count }, (_, v) =>
    Math.hypot(field[3 * v], field[3 * v + 1], field[3 * v + 2]),
  );
  const most = motion.reduce((a, b) => Math.max(a, b), 0);
  return motion.map((length) => length / most);
}

/**
 * The lids of a caller.
 * @param {ImageFilters} filters
 * @param {Uint8Array} mean (size, size, 3) R, G, B
 * @param {Atlas} atlas
 * @returns {Lids}
 */
export function lidsOf(filters, mean, atlas) {
  const { size } = atlas;
  const { weights, isAround, area } = new LidTexels(atlas);
  const plane = new Float32Array(size * size);
  const [reds, greens, blues, counts] = [0, 1, 2, 3].map((c) => {
    for (let at = 0; at < plane.length; at++)
      plane[at] = isAround[at] * (c < 3 ? mean[3 * at + c] : 1);
    return filters.blurred({ height: size, width: size, values: plane }, REACH * size).values;
  });
  const light = new Float32Array(3 * size * size);
  const least = new Float32Array(size * size);
  for (let at = 0; at < size * size; at++) {
    const count = Math.max(counts[at], 1e-3);
    const sum = RED * reds[at] + GREEN * greens[at] + BLUE * blues[at];
    const luma = Math.max(sum / count, 1);
    light[3 * at] = reds[at] / count / luma;
    light[3 * at + 1] = greens[at] / count / luma;
    light[3 * at + 2] = blues[at] / count / luma;
    least[at] = LEAST_LIGHT * luma;
  }
  return { size, area, weights, light, least };
}

/**
 * Lighten the lids of a texture, the more an eye closes.
 * @param {ImageFilters} filters
 * @param {Lids} own
 * @param {Uint8ClampedArray} texture (size, size, 4), written
 * @param {ArrayLike<number>} lids actuators of the left and the right one, 1 closed
 */
export function lightenLids(filters, { size, area, weights, light, least }, texture, lids) {
  const closed = [0, 1].map((i) => smoothstep((lids[i] - CLOSING) / (CLOSED - CLOSING)));
  if (!closed[0] && !closed[1]) return;
  const { left, right, top, bottom } = area;
  const [height, width] = [bottom - top, right - left];
  const luma = { height, width, values: new Float32Array(height * width) };
  const place = (/** @type {number} */ k) =>
    (top + Math.floor(k / luma.width)) * size + left + (k % luma.width);
  for (let k = 0; k < luma.values.length; k++) {
    const p = 4 * place(k);
    luma.values[k] = RED * texture[p] + GREEN * texture[p + 1] + BLUE * texture[p + 2];
  }
  const smooth = filters.blurred(luma, NEAR * size).values;
  for (let k = 0; k < smooth.length; k++) {
    const at = place(k);
    const weight = closed[0] * weights[0][at] + closed[1] * weights[1][at];
    const missing = Math.max(least[at] - smooth[k], 0) * weight;
    if (!missing) continue;
    for (let c = 0; c < 3; c++) {
      const value = texture[4 * at + c] + missing * light[3 * at + c] + 0.5;
      texture[4 * at + c] = Math.min(Math.floor(value), 255);
    }
  }
}
