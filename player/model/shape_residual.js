import { array } from "../data_file.js";
import { JAW_DROP } from "./parameters.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./head.js").Head} Head */

/** Shape parameter of the basis functions, and their distance between the lips, mm. */
const MULTIQUADRIC_MM = 10;
const LIP_GAP_MM = 45;

/**
 * The displacement (n, 3), mm, of the vertices of the generic head for those of its control points;
 * see `shared_model/shape_residual.py`.
 * @param {Arrays} data
 * @param {Head} head
 * @param {Float64Array} controlMm (k, 3)
 */
export function residualShape(data, head, controlMm) {
  const positions = lipSeparated(head, array(data, "landmarks")[0]);
  const control = array(data, "control_points");
  const centres = [...control, ...array(data, "fixed_points")];
  const size = centres.length + 1;
  const system = Array.from({ length: size }, (_, i) =>
    Float64Array.from({ length: size }, (_, j) => {
      if (i === size - 1 || j === size - 1) return i === j ? 0 : 1;
      return multiquadric(positions, centres[i], centres[j]);
    }),
  );
  const right = system.map((_, i) =>
    Float64Array.from({ length: 3 }, (_, axis) => controlMm[3 * i + axis] ?? 0),
  );
  const weights = solved(system, right);
  const shape = new Float64Array(3 * head.count);
  for (let v = 0; v < head.count; v++) {
    for (let c = 0; c < size; c++) {
      const kernel = c === size - 1 ? 1 : multiquadric(positions, v, centres[c]);
      for (let axis = 0; axis < 3; axis++) shape[3 * v + axis] += kernel * weights[c][axis];
    }
  }
  moveRigidly(data, head, shape);
  return shape;
}

/**
 * Positions (n, 4), mm: the fourth coordinate separates the lips.
 * @param {Head} head
 * @param {number} lowerLip
 */
function lipSeparated(head, lowerLip) {
  const jaw = (/** @type {number} */ v) =>
    Math.hypot(...head.eauUp.at(JAW_DROP).subarray(3 * v, 3 * v + 3));
  const full = jaw(lowerLip);
  const positions = new Float64Array(4 * head.count);
  for (let v = 0; v < head.count; v++) {
    positions.set(head.vertices.subarray(3 * v, 3 * v + 3), 4 * v);
    positions[4 * v + 3] = LIP_GAP_MM * Math.min(jaw(v) / full, 1);
  }
  return positions;
}

/**
 * @param {Float64Array} positions
 * @param {number} a
 * @param {number} b
 */
function multiquadric(positions, a, b) {
  let square = MULTIQUADRIC_MM ** 2;
  for (let k = 0; k < 4; k++) square += (positions[4 * a + k] - positions[4 * b + k]) ** 2;
  return -Math.sqrt(square);
}

/**
 * The solution of a linear system; matrix (n, n) and right side (n, columns) are overwritten.
 * @param {Float64Array[]} matrix
 * @param {Float64Array[]} right
 */
function solved(matrix, right) {
  const n = matrix.length;
  for (let c = 0; c < n; c++) {
    let pivot = c;
    for (let i = c + 1; i < n; i++) {
      if (Math.abs(matrix[i][c]) > Math.abs(matrix[pivot][c])) pivot = i;
    }
    [matrix[c], matrix[pivot]] = [matrix[pivot], matrix[c]];
    [right[c], right[pivot]] = [right[pivot], right[c]];
    for (let i = 0; i < n; i++) {
      const factor = i === c ? 0 : matrix[i][c] / matrix[c][c];
      if (!factor) continue;
      for (let j = c; j < n; j++) matrix[i][j] -= factor * matrix[c][j];
      for (let j = 0; j < right[i].length; j++) right[i][j] -= factor * right[c][j];
    }
  }
  return right.map((row, i) => row.map((value) => value / matrix[i][i]));
}

/**
 * Let eyeballs, teeth and tongue move with the mean of the skin around them.
 * @param {Arrays} data
 * @param {Head} head
 * @param {Float64Array} shape (n, 3), written
 */
function moveRigidly(data, head, shape) {
  const supports = array(data, "rigid_supports");
  for (const [i, part] of array(data, "rigid_parts").entries()) {
    const own = [...supports.subarray(4 * i, 4 * i + 4)].filter((v) => v >= 0);
    const mean = [0, 1, 2].map(
      (axis) => own.reduce((sum, v) => sum + shape[3 * v + axis], 0) / own.length,
    );
    for (let v = 0; v < head.count; v++) if (head.parts[v] === part) shape.set(mean, 3 * v);
  }
}
