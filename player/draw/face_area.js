import { pixelFromHead } from "../model/geometry.js";
import { PARTS } from "../model/head.js";

/** @typedef {import("../model/geometry.js").Camera} Camera */
/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("../model/parameters.js").Pose} Pose */

const FACE_OPACITY = 0.5;
const SOFT_SHARE = 1 / 320;

/**
 * (height, width) 1 in the convex hull of the face's skin, 0 outside, in between at its edge.
 * @param {Head} head
 * @param {Camera} camera
 * @param {Pose} pose
 * @param {Float64Array} vertices (n, 3) mm, head frame
 */
export function faceArea(head, camera, pose, vertices) {
  const { width, height } = camera;
  const pixels = pixelFromHead(camera, pose, vertices);
  const points = [];
  for (let v = 0; v < head.count; v++) {
    if (head.opacity[v] < FACE_OPACITY || head.parts[v] !== PARTS.SKIN) continue;
    const place = [0, 1].map((k) => Math.round(Math.min(Math.max(pixels[2 * v + k], -1e4), 1e4)));
    points.push(place);
  }
  const area = filled(convexHull(points), width, height);
  return averaged(
    area,
    width,
    height,
    Math.max(1, Math.round(SOFT_SHARE * Math.max(width, height))),
  );
}

/**
 * The corners of the convex hull of points, around it.
 * @param {number[][]} points
 */
function convexHull(points) {
  const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (/** @type {number[][]} */ ordered) => {
    /** @type {number[][]} */
    const chain = [];
    for (const p of ordered) {
      for (let n = chain.length; n > 1; n = chain.length) {
        const [a, b] = chain.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        chain.pop();
      }
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/**
 * (height, width) 1 within a convex polygon and on its edge.
 * @param {number[][]} corners
 * @param {number} width
 * @param {number} height
 */
function filled(corners, width, height) {
  const area = new Float32Array(width * height);
  for (let y = 0; y < height; y++) {
    let left = Infinity;
    let right = -Infinity;
    for (const [i, a] of corners.entries()) {
      const b = corners[(i + 1) % corners.length];
      if (y < Math.min(a[1], b[1]) || y > Math.max(a[1], b[1])) continue;
      const ends =
        a[1] === b[1] ? [a[0], b[0]] : [a[0] + ((y - a[1]) * (b[0] - a[0])) / (b[1] - a[1])];
      left = Math.min(left, ...ends);
      right = Math.max(right, ...ends);
    }
    const first = Math.max(Math.round(left), 0);
    const last = Math.min(Math.round(right), width - 1);
    if (last >= first) area.fill(1, y * width + first, y * width + last + 1);
  }
  return area;
}

/**
 * Averaged over 2 e + 1 by 2 e + 1 pixels; mirrored at the edges.
 * @param {Float32Array} area
 * @param {number} width
 * @param {number} height
 * @param {number} e
 */
function averaged(area, width, height, e) {
  const along = (
    /** @type {Float32Array} */ from,
    /** @type {number} */ count,
    /** @type {number} */ step,
    /** @type {number} */ lines,
    /** @type {number} */ lineStep,
  ) => {
    const result = new Float32Array(from.length);
    for (let line = 0; line < lines; line++) {
      for (let i = 0; i < count; i++) {
        let sum = 0;
        for (let k = i - e; k <= i + e; k++) {
          const at = k < 0 ? -k : k >= count ? 2 * (count - 1) - k : k;
          sum += from[line * lineStep + Math.min(Math.max(at, 0), count - 1) * step];
        }
        result[line * lineStep + i * step] = sum / (2 * e + 1);
      }
    }
    return result;
  };
  return along(along(area, width, 1, height, width), height, width, width, 1);
}
