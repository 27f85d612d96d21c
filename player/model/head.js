import { array } from "../data_file.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/**
 * A triangle mesh of n vertices and m triangles, with the fields that animate it; see
 * `shared_model/mesh.py`.
 * @typedef {object} Head
 * @property {number} count n
 * @property {Float64Array} vertices (n, 3) mm, head frame, neutral
 * @property {Int32Array} triangles (m, 3) counter-clockwise seen from outside
 * @property {Float64Array} textureCoordinates (n, 2)
 * @property {Uint8Array} parts (n) index into `PARTS`
 * @property {Float64Array} opacity (n)
 * @property {Fields} eauUp of each EAU (n, 3) mm at +1
 * @property {Fields} eauDown of each EAU (n, 3) mm at -1
 * @property {Fields} aau of each AAU (n, 3) mm at +1
 * @property {Int32Array} lips the vertices in the middle of the upper and the lower lip
 */

export const PARTS = {
  SKIN: 0,
  EYE_LEFT: 1,
  EYE_RIGHT: 2,
  TEETH_UPPER: 3,
  TEETH_LOWER: 4,
  TONGUE: 5,
  MOUTH: 6,
  SURROUND: 7,
};
const POSITION_STEP_MM = 1 / 64;
const FIELD_STEP_MM = 1 / 16;
const TEXTURE_STEP = 1 / 32767;

/** Fields of displacements, each made when it is asked for: the worker needs two of them. */
class Fields {
  /** @param {(index: number) => Float32Array} make */
  constructor(make) {
    this.make = make;
    /** @type {Float32Array[]} */
    this.made = [];
  }

  /** @param {number} index */
  at(index) {
    this.made[index] ??= this.make(index);
    return this.made[index];
  }
}

/**
 * Values (n, columns), row by row, of what is stored by column in steps.
 * @template {Float32Array | Float64Array | Int32Array} T
 * @param {ArrayLike<number>} stored
 * @param {number} columns
 * @param {number} step
 * @param {T} values written
 */
function rowsOf(stored, columns, step, values) {
  const count = stored.length / columns;
  for (let i = 0; i < count; i++) {
    for (let k = 0; k < columns; k++) values[columns * i + k] = stored[k * count + i] * step;
  }
  return values;
}

/**
 * The same in float64.
 * @param {ArrayLike<number>} stored
 * @param {number} columns
 * @param {number} step
 */
function rows64(stored, columns, step) {
  return rowsOf(stored, columns, step, new Float64Array(stored.length));
}

/**
 * The generic head.
 * @param {Arrays} data
 * @returns {Head}
 */
export function genericHead(data) {
  const vertices = rows64(array(data, "vertices"), 3, POSITION_STEP_MM);
  const triangles = array(data, "triangles");
  const fields = (/** @type {string} */ name) => {
    const stored = array(data, name);
    const size = vertices.length;
    return new Fields((i) => {
      const own = stored.subarray(i * size, (i + 1) * size);
      return rowsOf(own, 3, FIELD_STEP_MM, new Float32Array(size));
    });
  };
  return {
    count: vertices.length / 3,
    vertices,
    triangles: rowsOf(triangles, 3, 1, new Int32Array(triangles.length)),
    textureCoordinates: rows64(array(data, "texture_coordinates"), 2, TEXTURE_STEP),
    parts: new Uint8Array(array(data, "parts")),
    opacity: new Float64Array(array(data, "opacity")),
    eauUp: fields("eau_up"),
    eauDown: fields("eau_down"),
    aau: fields("aau"),
    lips: new Int32Array(array(data, "landmarks").subarray(1)),
  };
}

/**
 * The head of the default profile, with sheets across the apertures and around the face.
 * @param {Arrays} data
 * @param {Head} generic
 * @returns {Head}
 */
export function headWithSurround(data, generic) {
  const carried = new Carried(data, generic.count);
  const rims = array(data, "rim_depths");
  const vertices = carried.rows(generic.vertices, 3);
  for (const [i, depth] of rims.entries()) vertices[3 * (generic.count + i) + 2] -= depth;
  const around = rows64(array(data, "surround_vertices"), 3, POSITION_STEP_MM);
  vertices.set(around, vertices.length - around.length);
  const fields = (/** @type {Fields} */ own) =>
    new Fields((i) => new Float32Array(carried.rows(own.at(i), 3)));
  return {
    count: carried.count,
    vertices,
    triangles: surroundTriangles(data, generic),
    textureCoordinates: surroundTexture(data, generic),
    parts: new Uint8Array(array(data, "surround_parts")),
    opacity: new Float64Array(array(data, "surround_opacity")),
    eauUp: fields(generic.eauUp),
    eauDown: fields(generic.eauDown),
    aau: fields(generic.aau),
    lips: generic.lips,
  };
}

/**
 * Values (n, 3) of all vertices of the head of the default profile from those of the generic head.
 * @param {Arrays} data
 * @param {Float64Array} values
 */
export function carriedValues(data, values) {
  return new Carried(data, values.length / 3).rows(values, 3);
}

/** The vertices that are added to the generic head move with some of its own. */
class Carried {
  /**
   * @param {Arrays} data
   * @param {number} generic
   */
  constructor(data, generic) {
    this.generic = generic;
    this.rimVertices = array(data, "rim_vertices");
    this.rimWeights = array(data, "rim_weights");
    this.anchors = array(data, "surround_anchors");
    this.rims = this.rimVertices.length / 3;
    this.count = generic + this.rims + this.anchors.length;
  }

  /**
   * Values of all vertices from those (n, columns) of the generic head.
   * @param {ArrayLike<number>} values
   * @param {number} columns
   */
  rows(values, columns) {
    const all = new Float64Array(this.count * columns);
    for (let i = 0; i < values.length; i++) all[i] = values[i];
    for (let i = 0; i < 3 * this.rims; i++) {
      const at = (this.generic + Math.floor(i / 3)) * columns;
      for (let k = 0; k < columns; k++) {
        all[at + k] += this.rimWeights[i] * values[this.rimVertices[i] * columns + k];
      }
    }
    for (const [i, anchor] of this.anchors.entries()) {
      const at = (this.generic + this.rims + i) * columns;
      for (let k = 0; k < columns; k++) all[at + k] = all[anchor * columns + k];
    }
    return all;
  }
}

/**
 * @param {Arrays} data
 * @param {Head} generic
 */
function surroundTriangles(data, generic) {
  const kept = array(data, "surround_kept_triangles");
  const own = generic.triangles.filter((_, i) => kept[Math.floor(i / 3)]);
  const around = rows64(array(data, "surround_triangles"), 3, 1);
  const sheets = rows64(array(data, "sheet_triangles"), 3, 1);
  const all = new Int32Array(around.length + own.length + sheets.length);
  all.set(around);
  all.set(own, around.length);
  all.set(sheets, around.length + own.length);
  return all;
}

/**
 * @param {Arrays} data
 * @param {Head} generic
 */
function surroundTexture(data, generic) {
  const [strip] = array(data, "strip_width");
  const own = generic.textureCoordinates.map((value, i) =>
    i % 2 ? value : strip + (1 - 2 * strip) * value,
  );
  const added = rows64(array(data, "added_texture_coordinates"), 2, TEXTURE_STEP);
  const all = new Float64Array(own.length + added.length);
  all.set(own);
  all.set(added, own.length);
  return all;
}
