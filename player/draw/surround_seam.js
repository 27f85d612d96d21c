/** @typedef {import("../format/pictures/picture.js").Image} Image */

/** Directions of the strips' ends from the middle of the face, degrees, and their rows, 0..1. */
const DIRECTIONS_DEG = [50, -90];
const STRIP_ROWS = [0.006, 0.885];
const STRIP_WIDTH = 0.07;
/** From here on down to the chin the halves are mixed, in the end evenly. */
const BLEND_FROM_DEG = -65;
const MOST_BLEND = 0.5;

/**
 * An atlas, or a mode, whose strips agree where the halves of the surround meet: it is changed.
 * @param {Image} image square
 */
export function blendSurroundSeam({ height: size, values }) {
  const strip = Math.floor(STRIP_WIDTH * size);
  for (let i = 0; i < size; i++) {
    const along = ((i + 0.5) / size - STRIP_ROWS[0]) / (STRIP_ROWS[1] - STRIP_ROWS[0]);
    const share = Math.min(Math.max(along, 0), 1);
    const direction = DIRECTIONS_DEG[0] + share * (DIRECTIONS_DEG[1] - DIRECTIONS_DEG[0]);
    const below = (BLEND_FROM_DEG - direction) / (BLEND_FROM_DEG - DIRECTIONS_DEG[1]);
    const weight = MOST_BLEND * Math.min(Math.max(below, 0), 1);
    if (!weight) continue;
    for (let k = 0; k < 3 * strip; k++) {
      const left = 3 * i * size + k;
      const right = 3 * (i * size + size - 1 - Math.floor(k / 3)) + (k % 3);
      const difference = weight * (values[right] - values[left]);
      values[left] += difference;
      values[right] -= difference;
    }
  }
}
