/** Lines along an axis from one side of a frame to the other, as numbers of its corners. */
const LINES = [
  [
    [0, 1],
    [2, 3],
    [0, 3],
    [2, 1],
  ],
  [
    [0, 2],
    [1, 3],
    [0, 3],
    [1, 2],
  ],
];

/**
 * Left, top, width, height, pixels, of what a frame shows beyond the scene's picture.
 * @param {number[]} corners (4, 2) where in that picture, 0 to 1, the frame's corners come from
 * @param {number} width
 * @param {number} height
 */
export function unseenStrips(corners, width, height) {
  /** @type {number[][]} */
  const strips = [];
  for (const [axis, length] of [width, height].entries()) {
    for (const isFar of [false, true]) {
      const shares = LINES[axis].map((line) => {
        const [first, last] = line.map((corner) => corners[2 * corner + axis]);
        return isFar ? shareBelow(1 - last, 1 - first) : shareBelow(first, last);
      });
      const most = Math.max(...shares);
      if (most === 0) continue;
      const depth = Math.min(Math.ceil(length * most + 1), length);
      const at = isFar ? length - depth : 0;
      strips.push(axis ? [0, at, width, depth] : [at, 0, depth, height]);
    }
  }
  return strips;
}

/**
 * The share of a line, at its beginning, on which a value is negative.
 * @param {number} first
 * @param {number} last
 */
function shareBelow(first, last) {
  if (first >= 0) return 0;
  return last <= 0 ? 1 : first / (first - last);
}
