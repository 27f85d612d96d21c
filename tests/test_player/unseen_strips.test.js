import assert from "node:assert/strict";
import { test } from "node:test";
import { unseenStrips } from "../../player/draw/unseen_strips.js";

test("a scene that covers the frame has no strips", () => {
  assert.deepEqual(unseenStrips([0.1, 0.1, 0.9, 0, 0, 0.8, 1, 1], 320, 240), []);
});

test("each pixel that shows something beyond the scene is in a strip", () => {
  const [width, height] = [64, 48];
  for (const shift of [
    [-0.1, 0.05],
    [0.2, -0.3],
    [-1.5, 0],
  ]) {
    const [x, y] = shift;
    const corners = [x, y - 0.02, 1 + x, y, x + 0.03, 1 + y, 0.97 + x, 1 + y];
    const strips = unseenStrips(corners, width, height);
    for (let row = 0; row < height; row++) {
      for (let column = 0; column < width; column++) {
        const place = placeAt(corners, (column + 0.5) / width, (row + 0.5) / height);
        const isUnseen = place.some((value) => value < 0 || value > 1);
        const isCovered = strips.some(
          ([left, top, across, down]) =>
            column >= left && column < left + across && row >= top && row < top + down,
        );
        assert.ok(isCovered || !isUnseen, `${shift}: ${column}, ${row}`);
      }
    }
  }
});

/**
 * Where a point of the frame comes from, on the two triangles of a strip.
 * @param {number[]} corners
 * @param {number} u
 * @param {number} v
 */
function placeAt(corners, u, v) {
  const shares = u + v < 1 ? [1 - u - v, u, v, 0] : [0, 1 - v, 1 - u, u + v - 1];
  return [0, 1].map((axis) =>
    shares.reduce((sum, share, corner) => sum + share * corners[2 * corner + axis], 0),
  );
}
