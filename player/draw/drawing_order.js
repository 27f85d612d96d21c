import { PARTS } from "../model/head.js";

/** @typedef {import("../model/head.js").Head} Head */

/** Parts that are not inside the head. */
const OUTSIDE = [PARTS.SKIN, PARTS.SURROUND];
const INSIDE_MOUTH = [PARTS.TEETH_UPPER, PARTS.TEETH_LOWER, PARTS.TONGUE, PARTS.MOUTH];
const TEETH = [PARTS.TEETH_UPPER, PARTS.TEETH_LOWER];
/** Depth of the front teeth; behind them the light falls to 1 / e over the second distance. */
const FRONT_TEETH_MM = 12;
const TEETH_FADE_MM = 8;

/**
 * Whether a vertex is one of teeth, tongue or mouth.
 * @param {Head} head
 * @param {number} vertex
 */
export function insideMouth(head, vertex) {
  return INSIDE_MOUTH.includes(head.parts[vertex]);
}

/**
 * All triangles in the order in which they are drawn, and where in it kinds of them end: those of
 * the outside without transparency, with some, wholly transparent ones; then those of the inside.
 * @param {Head} head
 */
export function drawingOrder({ triangles, parts, opacity }) {
  /** @type {number[][]} */
  const kinds = [[], [], [], []];
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [0, 1, 2].map((k) => triangles[t + k]);
    const opacities = corners.map((v) => opacity[v]);
    const isOutside = corners.every((v) => OUTSIDE.includes(parts[v]));
    const kind = Math.min(...opacities) === 1 ? 0 : Math.max(...opacities) === 0 ? 2 : 1;
    kinds[isOutside ? kind : 3].push(...corners);
  }
  const solid = kinds[0].length;
  const blended = solid + kinds[1].length;
  const ends = { solid, blended, clear: blended + kinds[2].length };
  return { ordered: Uint16Array.from(kinds.flat()), ends };
}

/**
 * The light at each vertex, relative to that on the front teeth; 1 off the teeth.
 * @param {Head} head
 */
export function teethFalloff({ vertices, parts, count }) {
  const isTooth = (/** @type {number} */ v) => TEETH.includes(parts[v]);
  let front = -Infinity;
  for (let v = 0; v < count; v++) if (isTooth(v)) front = Math.max(front, vertices[3 * v + 2]);
  return Float32Array.from({ length: count }, (_, v) => {
    const behind = Math.max(front - FRONT_TEETH_MM - vertices[3 * v + 2], 0);
    return isTooth(v) ? Math.exp(-behind / TEETH_FADE_MM) : 1;
  });
}
