/**
 * Rigid motion from head to camera axes: rotate by a unit quaternion (w, x, y, z), then translate.
 * @typedef {{rotation: number[], translation: number[]}} Pose
 */
/**
 * The face in one frame: pose; the EAUs; coefficients of layers and of appearance modes.
 * @typedef {{pose: Pose, eau: Float64Array, layers: Float64Array, modes: Float64Array}} Face
 */

/** Expression action units, in the order of the format: lowest and highest value. */
const EAU_RANGES = [
  [0, 1], // jaw_drop
  [-1, 1], // mouth_corners
  [-1, 1], // eyebrow_middle
  [-1, 1], // eyebrow_inner
  [-1, 1], // eyebrow_outer
  [0, 1], // nose_base
  [-0.5, 1], // lid_left
  [-0.5, 1], // lid_right
  [-1, 1], // gaze_horizontal
  [-1, 1], // gaze_vertical
  [-1, 1], // lip_stretch
  [0, 1], // upper_lip_raise
  [-0.6, 1], // lower_lip_lower
  [0, 1], // lip_press
];
export const EAUS = EAU_RANGES.length;
export const AAUS = 11;
export const JAW_DROP = 0;
/** The left and the right eyelid. */
export const LIDS = [6, 7];
/** What one step of the codes of a model packet stands for. */
export const AAU_STEP = 1 / 64;
export const EAU_STEP = 1 / 127;
export const RESIDUAL_STEP_MM = 0.25;

/**
 * Clip actuators to their ranges.
 * @param {ArrayLike<number>} eau
 */
export function clipEau(eau) {
  return Float64Array.from(eau, (value, i) => clip(value, EAU_RANGES[i][0], EAU_RANGES[i][1]));
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
export function clip(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/**
 * 0 below 0, 1 above 1, smooth between them.
 * @param {number} x
 */
export function smoothstep(x) {
  const s = clip(x, 0, 1);
  return s * s * (3 - 2 * s);
}

/**
 * `first` and a share of the way to `second`.
 * @param {ArrayLike<number>} first
 * @param {ArrayLike<number>} second
 * @param {number} share
 */
export function mix(first, second, share) {
  return Float64Array.from(first, (value, i) => value + share * (second[i] - value));
}
