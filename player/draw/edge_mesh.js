// The edges of a head in a picture: strips in which it fades into what is behind; see
// `decoder/rendering/edge_strips.py`.
import { insideMouth } from "./drawing_order.js";

/** @typedef {import("../model/head.js").Head} Head */

/** Floats of a vertex of a strip: clip position (3), texture (2), opacity, light, distance. */
export const VERTEX_FLOATS = 8;
const BEHIND = 6e-4;
const MITRE = 2;

/** The edges of a head, those outside the mouth first. */
export class EdgeMesh {
  /** @param {Head} head */
  constructor(head) {
    this.head = head;
    this.weld = welded(head);
    const edges = edgesOf(head, this.weld);
    const isInside = edges.map(([, a, b]) => insideMouth(head, a) && insideMouth(head, b));
    const outside = edges.filter((_, i) => !isInside[i]);
    this.outside = outside.length;
    this.edges = [...outside, ...edges.filter((_, i) => isInside[i])];
    this.strips = new Float32Array(this.edges.length * 4 * VERTEX_FLOATS);
  }

  /**
   * Write the strips of a frame; returns how many there are outside the mouth, and of all.
   * @param {Float64Array} flat (n, 3) pixels from the middle of the picture, and depth
   * @param {number} width
   * @param {number} height
   * @param {ArrayLike<number>} light (n)
   * @param {number} reachPx
   * @returns {[number, number]}
   */
  write(flat, width, height, light, reachPx) {
    const { found, outer } = this.#pictureEdges(flat);
    const corners = this.#corners(found);
    const { textureCoordinates, opacity } = this.head;
    for (const [s, { vertices, normal }] of found.entries()) {
      for (const [end, v] of vertices.entries()) {
        const at = 2 * this.weld[v];
        const isBent = corners[at] || corners[at + 1];
        const outward = isBent ? [corners[at], corners[at + 1]] : normal;
        for (let side = 0; side < 2; side++) {
          const distance = side ? reachPx : 0;
          this.strips.set(
            [
              (flat[3 * v] + distance * outward[0]) / (width / 2),
              (flat[3 * v + 1] + distance * outward[1]) / (height / 2),
              flat[3 * v + 2] + BEHIND,
              textureCoordinates[2 * v],
              textureCoordinates[2 * v + 1],
              opacity[v],
              light[v],
              distance,
            ],
            (4 * s + (side ? 3 - end : end)) * VERTEX_FLOATS,
          );
        }
      }
    }
    return [outer, found.length];
  }

  /** @param {Float64Array} flat */
  #pictureEdges(flat) {
    const { triangles } = this.head;
    const facing = new Uint8Array(triangles.length / 3);
    for (let t = 0; t < facing.length; t++) {
      const [a, b, c] = [0, 1, 2].map((k) => 3 * triangles[3 * t + k]);
      const x = flat[b] - flat[a];
      const y = flat[b + 1] - flat[a + 1];
      facing[t] = x * (flat[c + 1] - flat[a + 1]) - y * (flat[c] - flat[a]) < 0 ? 1 : 0;
    }
    const found = [];
    let outer = 0;
    for (const [e, [first, a1, b1, second, a2, b2]] of this.edges.entries()) {
      if (facing[first] === (second >= 0 ? facing[second] : 0)) continue;
      const [t, a, b] = facing[first] ? [first, a1, b1] : [second, a2, b2];
      const third = triangles[3 * t] + triangles[3 * t + 1] + triangles[3 * t + 2] - a - b;
      const x = flat[3 * a + 1] - flat[3 * b + 1];
      const y = flat[3 * b] - flat[3 * a];
      let length = Math.hypot(x, y);
      if (!length) continue;
      const isInward =
        x * (flat[3 * third] - flat[3 * a]) + y * (flat[3 * third + 1] - flat[3 * a + 1]);
      if (isInward > 0) length = -length;
      found.push({ vertices: [a, b], normal: [x / length, y / length] });
      if (e < this.outside) outer = found.length;
    }
    return { found, outer };
  }

  /**
   * How a welded vertex moves if edges move outwards by 1; 0 where they do not agree.
   * @param {{vertices: number[], normal: number[]}[]} found
   */
  #corners(found) {
    const corners = new Float64Array(2 * this.head.count);
    const degrees = new Uint16Array(this.head.count);
    for (const { vertices, normal } of found) {
      for (const vertex of vertices) {
        const v = this.weld[vertex];
        corners[2 * v] += normal[0];
        corners[2 * v + 1] += normal[1];
        degrees[v]++;
      }
    }
    for (const [v, degree] of degrees.entries()) {
      if (!degree) continue;
      const square = corners[2 * v] ** 2 + corners[2 * v + 1] ** 2;
      const factor = square * MITRE ** 2 > degree ** 2 ? degree / square : 0;
      corners[2 * v] *= factor;
      corners[2 * v + 1] *= factor;
    }
    return corners;
  }
}

/**
 * For each vertex the first one at its place: there are several at a seam of the atlas.
 * @param {Head} head
 */
function welded({ vertices, count }) {
  /** @type {Map<string, number>} */
  const first = new Map();
  return Int32Array.from({ length: count }, (_, v) => {
    const place = vertices.subarray(3 * v, 3 * v + 3).join();
    if (!first.has(place)) first.set(place, v);
    return /** @type {number} */ (first.get(place));
  });
}

/**
 * For each edge one triangle with its vertices there, and another, or -1.
 * @param {Head} head
 * @param {Int32Array} weld
 */
function edgesOf({ triangles, opacity }, weld) {
  /** @type {Map<string, number[]>} */
  const edges = new Map();
  for (let t = 0; t < triangles.length; t += 3) {
    for (let k = 0; k < 3; k++) {
      const a = triangles[t + k];
      const b = triangles[t + ((k + 1) % 3)];
      const key = [weld[a], weld[b]].sort((i, j) => i - j).join();
      const known = edges.get(key);
      if (known) known.splice(3, 3, t / 3, a, b);
      else edges.set(key, [t / 3, a, b, -1, a, b]);
    }
  }
  const ends = (/** @type {number[]} */ [, a, b]) => [weld[a], weld[b]].sort((i, j) => i - j);
  return [...edges.values()]
    .filter(([, a, b]) => opacity[a] > 0 || opacity[b] > 0)
    .sort((one, other) => ends(one)[0] - ends(other)[0] || ends(one)[1] - ends(other)[1]);
}
