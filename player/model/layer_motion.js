// What a frame's layer coefficients do; see `shared_model/layers`.

/** @typedef {import("./background_mesh.js").BackgroundMesh} BackgroundMesh */
/** @typedef {import("../format/pictures/background.js").MotionFields} MotionFields */

const CODES_PER_PX = 64;
/** Mesh cells along the edges of the picture over which inward motion falls to 0. */
const EDGE_CELLS = 2;
const UNIT_SHARE = 0.01;
const PIVOT_GREY = 128;
const UNIT_GAIN = 0.02;
const SCENE_COEFFICIENTS = 4;
/** Corners of a picture, texture coordinates. */
export const PICTURE_CORNERS = [0, 0, 1, 0, 0, 1, 1, 1];

/**
 * What a frame's layer coefficients stand for.
 * @param {{fields: MotionFields | null, changes: number, sceneMoves: boolean, lightChanges: boolean}} layers
 * @param {Float64Array} coefficients missing ones are 0
 */
export function splitCoefficients({ fields, changes, sceneMoves, lightChanges }, coefficients) {
  const at = (/** @type {number} */ i) => coefficients[i] ?? 0;
  const count = fields ? fields.count : 0;
  const scene = count + changes;
  const light = scene + (sceneMoves ? SCENE_COEFFICIENTS : 0);
  const from = (/** @type {number} */ first, /** @type {number} */ length) =>
    Array.from({ length }, (_, i) => at(first + i));
  return {
    motion: from(0, count),
    changes: from(count, changes),
    scene: sceneMoves ? from(scene, SCENE_COEFFICIENTS) : null,
    light: lightChanges ? lightOf(at(light), at(light + 1)) : null,
  };
}

/**
 * Gain and offset, grey levels, of all colours.
 * @param {number} gain
 * @param {number} offset
 */
function lightOf(gain, offset) {
  return { gain: Math.max(1 + UNIT_GAIN * gain, 0), offset, pivot: PIVOT_GREY };
}

/**
 * Motion fields at the points of a mesh: each (rows, columns, 2), pixels.
 * @param {BackgroundMesh} mesh
 * @param {MotionFields} fields
 */
export function fieldsAtMesh(mesh, fields) {
  const size = fields.rows * fields.columns * 2;
  return Array.from({ length: fields.count }, (_, i) => {
    const codes = fields.codes.subarray(i * size, (i + 1) * size);
    const values = new Float64Array(mesh.rows * mesh.columns * 2);
    for (let p = 0; p < mesh.rows * mesh.columns; p++) {
      const y = (Math.floor(p / mesh.columns) * (fields.rows - 1)) / (mesh.rows - 1);
      const x = ((p % mesh.columns) * (fields.columns - 1)) / (mesh.columns - 1);
      for (let axis = 0; axis < 2; axis++) {
        values[2 * p + axis] = interpolated(codes, fields, x, y, axis) / CODES_PER_PX;
      }
    }
    return values;
  });
}

/**
 * @param {Int32Array} codes
 * @param {{rows: number, columns: number}} fields
 * @param {number} x
 * @param {number} y
 * @param {number} axis
 */
function interpolated(codes, { rows, columns }, x, y, axis) {
  const left = Math.min(Math.floor(x), columns - 2);
  const top = Math.min(Math.floor(y), rows - 2);
  const at = (/** @type {number} */ i, /** @type {number} */ j) =>
    codes[2 * ((top + i) * columns + left + j) + axis];
  const across = (/** @type {number} */ i) => at(i, 0) + (x - left) * (at(i, 1) - at(i, 0));
  return across(0) + (y - top) * (across(1) - across(0));
}

/**
 * What the fields add to the motion of a mesh; inward motion fades at the edges of the picture.
 * @param {BackgroundMesh} mesh
 * @param {Float64Array[]} fields
 * @param {number[]} coefficients
 */
export function ownMotion({ rows, columns }, fields, coefficients) {
  const motion = new Float64Array(rows * columns * 2);
  for (const [k, field] of fields.entries()) {
    for (let i = 0; i < motion.length; i++) motion[i] += coefficients[k] * field[i];
  }
  for (let i = 0; i < motion.length; i++) {
    const p = i >> 1;
    const [place, count] = i & 1 ? [Math.floor(p / columns), rows] : [p % columns, columns];
    const fromEdge = motion[i] > 0 ? place : count - 1 - place;
    motion[i] *= Math.min(fromEdge / EDGE_CELLS, 1);
  }
  return motion;
}

/**
 * Where in the picture of the scene the corners (4, 2) of a frame come from, texture coordinates.
 * @param {number} width
 * @param {number} height
 * @param {number[]} coefficients shift right, shift down, zoom, roll
 */
export function movedCorners(width, height, [a, b, c, d]) {
  const longer = Math.max(width, height);
  const corners = [];
  for (let i = 0; i < 4; i++) {
    const x = PICTURE_CORNERS[2 * i];
    const y = PICTURE_CORNERS[2 * i + 1];
    const u = ((2 * x - 1) * width) / longer;
    const v = ((2 * y - 1) * height) / longer;
    corners.push(x - ((a + c * u - d * v) * UNIT_SHARE * longer) / width);
    corners.push(y - ((b + c * v + d * u) * UNIT_SHARE * longer) / height);
  }
  return corners;
}
