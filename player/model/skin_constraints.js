import { cameraFromHead, pixelFromCamera, pixelFromHead } from "./geometry.js";
import { PARTS } from "./head.js";

/** @typedef {import("./background_mesh.js").BackgroundMesh} BackgroundMesh */
/** @typedef {import("./head.js").Head} Head */
/** @typedef {import("./parameters.js").Pose} Pose */

/** Weight of no motion, against about 1 on the skin. */
const FREE_WEIGHT = 0.15;
const MIN_WEIGHT = 1e-3;
const FACING_COSINE = 0.3;
/** Vertices and points that are weighed at a time. */
const AT_ONCE = 128;

/** The skin in the background picture, and how the mesh points near it follow it. */
export class SkinConstraints {
  /**
   * @param {BackgroundMesh} mesh
   * @param {Head} head
   * @param {Float64Array} vertices (n, 3) mm, of the head in the picture
   */
  constructor(mesh, head, vertices) {
    const cosines = facingCosines(mesh.reference, head, vertices);
    /** @type {number[]} */
    this.vertices = [];
    for (let v = 0; v < head.count; v++) {
      const isDrawn = head.opacity[v] > 0 && head.parts[v] === PARTS.SKIN;
      if (isDrawn && cosines[v] > FACING_COSINE) this.vertices.push(v);
    }
    /** (k, 2) of the vertices */
    this.pixels = pixelFromHead(mesh.camera, mesh.reference, this.#picked(vertices));
    this.rigidMm = mesh.lift(this.pixels);
    /** @type {number[]} those of the mesh that follow the skin; none before `weigh` */
    this.points = [];
    /** @type {Float64Array[]} of each vertex in the motion of each of them */
    this.weights = [];
  }

  /**
   * Find the points that follow the skin, and the weight of each vertex in their motion, step by step.
   * @param {BackgroundMesh} mesh
   * @param {number} sigmaPx standard deviation of the kernel
   */
  *weigh(mesh, sigmaPx) {
    const { pixels } = this;
    const count = this.vertices.length;
    const square = (/** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ k) =>
      (pixels[2 * k] - x) ** 2 + (pixels[2 * k + 1] - y) ** 2;
    const kernel = (/** @type {number} */ squarePx) => Math.exp(squarePx / (-2 * sigmaPx ** 2));
    // By the area around each vertex, since vertices are dense around eyes and mouth.
    const density = new Float64Array(count);
    for (let i = 0; i < count; i++) {
      if (i % AT_ONCE === 0) yield;
      density[i] += kernel(0);
      for (let k = i + 1; k < count; k++) {
        const weight = kernel(square(pixels[2 * i], pixels[2 * i + 1], k));
        density[i] += weight;
        density[k] += weight;
      }
    }
    for (let p = 0; p < mesh.rows * mesh.columns; p++) {
      if (p % AT_ONCE === 0) yield;
      const x = mesh.gridPx[2 * p];
      const y = mesh.gridPx[2 * p + 1];
      let nearest = Infinity;
      for (let k = 0; k < count; k++) nearest = Math.min(nearest, square(x, y, k));
      if (kernel(nearest) <= MIN_WEIGHT) continue;
      const own = new Float64Array(count);
      let sum = 0;
      for (let k = 0; k < count; k++) {
        own[k] = kernel(square(x, y, k)) / density[k];
        sum += own[k];
      }
      this.points.push(p);
      this.weights.push(own.map((weight) => weight / (sum + FREE_WEIGHT)));
    }
  }

  /**
   * The motion (rows, columns, 2), pixels, of the skin relative to the plane of the mesh.
   * @param {BackgroundMesh} mesh
   * @param {Pose} pose
   * @param {Float64Array} vertices (n, 3) mm, head frame
   */
  motion(mesh, pose, vertices) {
    const actual = pixelFromHead(mesh.camera, pose, this.#picked(vertices));
    const rigid = pixelFromCamera(mesh.camera, mesh.movedWithHead(pose, this.rigidMm));
    const motion = new Float64Array(mesh.rows * mesh.columns * 2);
    for (const [i, p] of this.points.entries()) {
      const weights = this.weights[i];
      let x = 0;
      let y = 0;
      for (let k = 0; k < weights.length; k++) {
        x += weights[k] * (actual[2 * k] - rigid[2 * k]);
        y += weights[k] * (actual[2 * k + 1] - rigid[2 * k + 1]);
      }
      motion[2 * p] = x;
      motion[2 * p + 1] = y;
    }
    return motion;
  }

  /** @param {Float64Array} vertices */
  #picked(vertices) {
    const picked = new Float64Array(3 * this.vertices.length);
    for (const [i, v] of this.vertices.entries())
      picked.set(vertices.subarray(3 * v, 3 * v + 3), 3 * i);
    return picked;
  }
}

/**
 * The cosine between each vertex' outward normal and the direction to the camera.
 * @param {Pose} pose
 * @param {Head} head
 * @param {Float64Array} vertices
 */
function facingCosines(pose, head, vertices) {
  const seen = cameraFromHead(pose, vertices);
  const normals = vertexNormals(seen, head.triangles);
  return Float64Array.from({ length: head.count }, (_, v) => {
    let dot = 0;
    for (let k = 0; k < 3; k++) dot -= seen[3 * v + k] * normals[3 * v + k];
    const length = Math.hypot(normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]);
    const distance = Math.hypot(seen[3 * v], seen[3 * v + 1], seen[3 * v + 2]);
    return dot / (Math.max(length, 1e-12) * distance);
  });
}

/**
 * The sum (n, 3) of the normals of each vertex' triangles, weighted by their areas.
 * @param {Float64Array} points
 * @param {Int32Array} triangles
 */
function vertexNormals(points, triangles) {
  const normals = new Float64Array(points.length);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => 3 * triangles[t + k]);
    const u = [0, 1, 2].map((k) => points[b + k] - points[a + k]);
    const v = [0, 1, 2].map((k) => points[c + k] - points[a + k]);
    for (let k = 0; k < 3; k++) {
      const flat = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
      for (const vertex of [a, b, c]) normals[vertex + k] += flat;
    }
  }
  return normals;
}
