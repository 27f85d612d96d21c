/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("./image_filters.js").ImageFilters} ImageFilters */

/** The point of a head at each texel of an atlas of `size` texels a side. */
export class Atlas {
  /**
   * @param {ImageFilters} filters
   * @param {Head} head
   * @param {number} size
   */
  constructor(filters, head, size) {
    this.head = head;
    this.size = size;
    const { opacity, triangles, textureCoordinates } = head;
    const shown = new Int32Array(triangles.length / 3);
    const corners = new Float64Array(2 * triangles.length);
    let count = 0;
    for (let t = 0; t < triangles.length; t += 3) {
      if (!(opacity[triangles[t]] || opacity[triangles[t + 1]] || opacity[triangles[t + 2]]))
        continue;
      for (let k = 0; k < 6; k++)
        corners[6 * count + k] = textureCoordinates[2 * triangles[t + (k >> 1)] + (k & 1)];
      shown[count++] = t;
    }
    const { owner, weights } = filters.covered(corners.subarray(0, 6 * count), size);
    /** first corner of the triangle at each texel in `head.triangles`, -1: none */
    this.owner = owner.map((triangle) => (triangle < 0 ? -1 : shown[triangle]));
    /** of the second and the third corner */
    this.weights = weights;
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
