/** @typedef {import("../model/head.js").Head} Head */

/**
 * Call back for each grid point inside triangles with corners (n, 3, 2), column and row, with the
 * barycentric weights of the corners; a point on a common edge is in both triangles.
 * @param {ArrayLike<number>} corners
 * @param {number} width
 * @param {number} height
 * @param {(triangle: number, column: number, row: number, wb: number, wc: number) => void} found
 */
function coverPoints(corners, width, height, found) {
  for (let t = 0; t < corners.length / 6; t++) {
    const [ax, ay, bx0, by0, cx0, cy0] = [0, 1, 2, 3, 4, 5].map((k) => corners[6 * t + k]);
    const bx = bx0 - ax;
    const by = by0 - ay;
    const cx = cx0 - ax;
    const cy = cy0 - ay;
    const area = bx * cy - by * cx;
    if (Math.abs(area) < 1e-12) continue;
    const left = Math.max(Math.ceil(Math.min(ax, bx0, cx0)), 0);
    const right = Math.min(Math.floor(Math.max(ax, bx0, cx0)), width - 1);
    const top = Math.max(Math.ceil(Math.min(ay, by0, cy0)), 0);
    const bottom = Math.min(Math.floor(Math.max(ay, by0, cy0)), height - 1);
    for (let y = top; y <= bottom; y++) {
      for (let x = left; x <= right; x++) {
        const wb = ((x - ax) * cy - (y - ay) * cx) / area;
        const wc = (bx * (y - ay) - by * (x - ax)) / area;
        if (wb >= -1e-9 && wc >= -1e-9 && wb + wc <= 1 + 1e-9) found(t, x, y, wb, wc);
      }
    }
  }
}

/** The point of a head at each texel of an atlas of `size` texels a side. */
export class Atlas {
  /**
   * @param {Head} head
   * @param {number} size
   */
  constructor(head, size) {
    this.head = head;
    this.size = size;
    /** first corner of the triangle at each texel in `head.triangles`, -1: none */
    this.owner = new Int32Array(size * size).fill(-1);
    this.weights = new Float32Array(2 * size * size);
    /** @type {number[]} */
    const shown = [];
    for (let t = 0; t < head.triangles.length; t += 3) {
      if ([0, 1, 2].some((k) => head.opacity[head.triangles[t + k]] > 0)) shown.push(t);
    }
    const corners = shown.flatMap((t) =>
      [0, 1, 2].flatMap((k) => {
        const v = head.triangles[t + k];
        return [0, 1].map((axis) => head.textureCoordinates[2 * v + axis] * size - 0.5);
      }),
    );
    coverPoints(corners, size, size, (triangle, column, row, wb, wc) => {
      const at = row * size + column;
      this.owner[at] = shown[triangle];
      this.weights[2 * at] = wb;
      this.weights[2 * at + 1] = wc;
    });
  }

  /**
   * The part of the head at a texel; -1: none.
   * @param {number} at
   */
  partAt(at) {
    const { triangles, parts } = this.head;
    return this.owner[at] < 0 ? -1 : parts[triangles[this.owner[at]]];
  }

  /**
   * A value of the vertices, interpolated at a texel that is on the mesh.
   * @param {number} at
   * @param {ArrayLike<number>} values (n)
   */
  valueAt(at, values) {
    const { triangles } = this.head;
    const first = this.owner[at];
    const a = values[triangles[first]];
    const b = values[triangles[first + 1]];
    const c = values[triangles[first + 2]];
    return a + this.weights[2 * at] * (b - a) + this.weights[2 * at + 1] * (c - a);
  }
}
