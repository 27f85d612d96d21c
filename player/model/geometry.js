// Rotations, pose and camera; the conventions are those of `shared_model/geometry.py`.
import { mix } from "./parameters.js";

/** @typedef {import("./parameters.js").Face} Face */
/** @typedef {import("./parameters.js").Pose} Pose */
/** @typedef {{width: number, height: number, focalPx: number}} Camera */

/**
 * A quaternion of unit length, w >= 0.
 * @param {number[]} q
 */
export function normalise(q) {
  const length = Math.hypot(...q);
  const sign = q[0] < 0 ? -1 : 1;
  return q.map((value) => (sign * value) / length);
}

/**
 * Rotate by `b`, then by `a`.
 * @param {number[]} a
 * @param {number[]} b
 */
export function multiply([aw, ax, ay, az], [bw, bx, by, bz]) {
  return [
    aw * bw - ax * bx - ay * by - az * bz,
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
  ];
}

/** @param {number[]} q */
export function conjugate([w, x, y, z]) {
  return [w, -x, -y, -z];
}

/**
 * The rotation of an axis-angle vector, radians.
 * @param {ArrayLike<number>} vector
 */
export function quaternionFromVector({ 0: x, 1: y, 2: z }) {
  const half = Math.hypot(x, y, z) / 2;
  const scale = half ? Math.sin(half) / (2 * half) : 0.5;
  return [Math.cos(half), x * scale, y * scale, z * scale];
}

/**
 * The axis-angle vector, radians, of a rotation.
 * @param {number[]} q
 */
export function vectorFromQuaternion(q) {
  const [w, x, y, z] = normalise(q);
  const sine = Math.hypot(x, y, z);
  const scale = sine > 1e-9 ? (2 * Math.atan2(sine, w)) / sine : 2;
  return [x * scale, y * scale, z * scale];
}

/**
 * The matrix (3, 3), row by row, of a rotation.
 * @param {number[]} q
 */
export function matrixFromQuaternion([w, x, y, z]) {
  return [
    w * w + x * x - y * y - z * z,
    2 * (x * y - w * z),
    2 * (x * z + w * y),
    2 * (x * y + w * z),
    w * w - x * x + y * y - z * z,
    2 * (y * z - w * x),
    2 * (x * z - w * y),
    2 * (y * z + w * x),
    w * w - x * x - y * y + z * z,
  ];
}

/**
 * Points (n, 3), mm, moved from the head frame to the camera frame.
 * @param {Pose} pose
 * @param {Float64Array} points
 */
export function cameraFromHead({ rotation, translation }, points) {
  const m = matrixFromQuaternion(rotation);
  const moved = new Float64Array(points.length);
  for (let i = 0; i < points.length; i += 3) {
    const x = points[i];
    const y = points[i + 1];
    const z = points[i + 2];
    for (let k = 0; k < 3; k++) {
      moved[i + k] = m[3 * k] * x + m[3 * k + 1] * y + m[3 * k + 2] * z + translation[k];
    }
  }
  return moved;
}

/**
 * The pixels (n, 2) of points (n, 3), mm, camera frame.
 * @param {Camera} camera
 * @param {Float64Array} points
 */
export function pixelFromCamera({ width, height, focalPx }, points) {
  const pixels = new Float64Array((points.length / 3) * 2);
  for (let i = 0, p = 0; p < pixels.length; i += 3, p += 2) {
    pixels[p] = (focalPx * points[i]) / points[i + 2] + (width - 1) / 2;
    pixels[p + 1] = (focalPx * points[i + 1]) / points[i + 2] + (height - 1) / 2;
  }
  return pixels;
}

/**
 * The pixels (n, 2) of points (n, 3), mm, head frame.
 * @param {Camera} camera
 * @param {Pose} pose
 * @param {Float64Array} points
 */
export function pixelFromHead(camera, pose, points) {
  return pixelFromCamera(camera, cameraFromHead(pose, points));
}

/**
 * The face at a share of the way from one to another: rotation along the shortest arc, all else
 * linearly.  Coefficients whose numbers differ are those of `second`.
 * @param {Face} first
 * @param {Face} second
 * @param {number} share
 * @returns {Face}
 */
export function interpolate(first, second, share) {
  const turn = multiply(second.pose.rotation, conjugate(first.pose.rotation));
  const part = vectorFromQuaternion(turn).map((angle) => share * angle);
  const rotation = normalise(multiply(quaternionFromVector(part), first.pose.rotation));
  const translation = [...mix(first.pose.translation, second.pose.translation, share)];
  const coefficients = (/** @type {Float64Array} */ a, /** @type {Float64Array} */ b) =>
    a.length === b.length ? mix(a, b, share) : b;
  return {
    pose: { rotation, translation },
    eau: mix(first.eau, second.eau, share),
    layers: coefficients(first.layers, second.layers),
    modes: coefficients(first.modes, second.modes),
  };
}

/**
 * The face at the depth that keeps its size when the focal length changes by a factor.
 * @param {Face} face
 * @param {number} ratio
 * @returns {Face}
 */
export function withFocalChange(face, ratio) {
  const [x, y, z] = face.pose.translation;
  return { ...face, pose: { rotation: face.pose.rotation, translation: [x, y, z * ratio] } };
}

/**
 * The pose that a motion leads to from a reference: rotation (deg), shift (mm), log depth.
 * @param {ArrayLike<number>} motion (6)
 * @param {Pose} reference
 * @returns {Pose}
 */
export function poseFromMotion(motion, reference) {
  const turn = [0, 1, 2].map((i) => (motion[i] * Math.PI) / 180);
  const ratio = Math.exp(motion[5]);
  const [x, y, z] = reference.translation;
  return {
    rotation: normalise(multiply(quaternionFromVector(turn), reference.rotation)),
    translation: [ratio * (x + motion[3]), ratio * (y + motion[4]), ratio * z],
  };
}
