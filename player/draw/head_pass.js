import { drawingOrder, insideMouth, teethFalloff } from "./drawing_order.js";
import { EdgeMesh, VERTEX_FLOATS } from "./edge_mesh.js";
import { bufferOf, programOf, Texture, writeBuffer } from "./gl.js";
import { EDGE, HEAD } from "./shaders.js";

/** @typedef {import("../model/head.js").Head} Head */
/**
 * A head as it is drawn in a frame.
 * @typedef {object} HeadState
 * @property {Uint8ClampedArray} texture (size, size, 4)
 * @property {Float64Array} vertices (n, 3) mm, head frame
 * @property {number[]} clip (4, 4) clip coordinates, y down, from the head's
 * @property {number | null} mouthShading light inside the mouth; null: the texture has it
 * @property {boolean} isCoarse whether the texture has several texels a pixel
 */

/** The face is drawn wider by so much, to reach its contour in the background picture. */
const EXPANSION_PX = 0.7;
const HALF_PX = 0.5;

/** @type {WeakMap<Head, ReturnType<typeof newDrawnHead>>} */
const drawnHeads = new WeakMap();

/**
 * What all models with a head have of its drawing, made once.
 * @param {Head} head
 */
function drawnHead(head) {
  const drawn = drawnHeads.get(head) ?? newDrawnHead(head);
  drawnHeads.set(head, drawn);
  return drawn;
}

/** @param {Head} head */
function newDrawnHead(head) {
  return {
    falloff: teethFalloff(head),
    inside: Uint8Array.from({ length: head.count }, (_, v) => (insideMouth(head, v) ? 1 : 0)),
    edges: new EdgeMesh(head),
    ...drawingOrder(head),
  };
}

/** Draws a head in its texture, with smooth edges. */
export class HeadPass {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Head} head
   * @param {number} width of the picture, pixels
   * @param {number} height
   * @param {number} textureSize
   */
  constructor(gl, head, width, height, textureSize) {
    this.gl = gl;
    this.head = head;
    this.width = width;
    this.height = height;
    this.atlas = new Texture(gl, textureSize, textureSize);
    const { falloff, inside, edges, ordered, ends } = drawnHead(head);
    this.falloff = falloff;
    this.inside = inside;
    this.edges = edges;
    this.ends = { ...ends, all: ordered.length };
    this.program = programOf(gl, HEAD);
    this.positions = bufferOf(gl, new Float32Array(3 * head.count));
    this.array = this.#headArray(ordered);
    this.edgeProgram = programOf(gl, EDGE);
    this.strips = bufferOf(gl, this.edges.strips);
    this.edgeArray = this.#edgeArray();
  }

  /** @param {Uint16Array} ordered */
  #headArray(ordered) {
    const { gl, head } = this;
    const attributes = new Float32Array(5 * head.count);
    for (let v = 0; v < head.count; v++) {
      const [u, w] = head.textureCoordinates.subarray(2 * v, 2 * v + 2);
      attributes.set([u, w, head.opacity[v], this.inside[v], this.falloff[v]], 5 * v);
    }
    return this.program.vertexArray(
      [
        [this.positions, [["position_mm", 3]]],
        [
          bufferOf(gl, attributes),
          [
            ["texture_coordinate", 2],
            ["vertex_opacity", 1],
            ["inside_mouth", 1],
            ["teeth_falloff", 1],
          ],
        ],
      ],
      bufferOf(gl, ordered),
    );
  }

  #edgeArray() {
    const { gl } = this;
    const count = this.edges.strips.length / (4 * VERTEX_FLOATS);
    const quads = Uint32Array.from(
      { length: 6 * count },
      (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 0, 2, 3][i % 6],
    );
    return this.edgeProgram.vertexArray(
      [
        [
          this.strips,
          [
            ["position_clip", 3],
            ["texture_coordinate", 2],
            ["vertex_opacity", 1],
            ["vertex_light", 1],
            ["vertex_distance_px", 1],
          ],
        ],
      ],
      bufferOf(gl, quads),
    );
  }

  /**
   * Draw the head of a frame: solid skin first, what it hides by its depth not at all.
   * @param {HeadState} state
   */
  draw(state) {
    const { gl, ends } = this;
    const [outer, count] = this.#prepare(state);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    this.#render(0, ends.solid);
    this.#drawEdges(outer, true, EXPANSION_PX + HALF_PX);
    gl.enable(gl.BLEND);
    this.#render(ends.solid, ends.blended);
    gl.disable(gl.BLEND);
    gl.colorMask(false, false, false, false);
    this.#render(ends.blended, ends.clear);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.BLEND);
    this.#render(ends.clear, ends.all);
    this.#drawEdges(count, false, HALF_PX);
    for (const what of [gl.BLEND, gl.DEPTH_TEST, gl.CULL_FACE]) gl.disable(what);
  }

  /** @param {HeadState} state */
  #prepare({ texture, vertices, clip, mouthShading, isCoarse }) {
    const { gl, program } = this;
    this.atlas.write(texture);
    this.atlas.setMipmaps(isCoarse);
    writeBuffer(gl, this.positions, Float32Array.from(vertices));
    program.use();
    program.setMatrix("clip_from_head", clip);
    program.set("mouth_shading", mouthShading ?? 1);
    program.setFlag("texture_is_shaded", mouthShading === null);
    const light = this.falloff.map((falloff, v) => {
      if (mouthShading === null) return 1;
      return falloff * (this.inside[v] ? mouthShading : 1);
    });
    const flat = flattened(clip, this.width, this.height, vertices);
    const reach = EXPANSION_PX + HALF_PX;
    const counts = this.edges.write(flat, this.width, this.height, light, reach);
    writeBuffer(gl, this.strips, this.edges.strips.subarray(0, counts[1] * 4 * VERTEX_FLOATS));
    return counts;
  }

  /**
   * Draw the triangles of indices from the first to the end.
   * @param {number} first
   * @param {number} end
   */
  #render(first, end) {
    if (first >= end) return;
    this.program.use();
    this.atlas.use();
    this.gl.bindVertexArray(this.array);
    this.gl.drawElements(this.gl.TRIANGLES, end - first, this.gl.UNSIGNED_SHORT, 2 * first);
  }

  /**
   * Draw strips: behind all of the head, or before what is behind their edges.
   * @param {number} count
   * @param {boolean} isBehind
   * @param {number} reachPx
   */
  #drawEdges(count, isBehind, reachPx) {
    const { gl } = this;
    this.edgeProgram.use();
    this.edgeProgram.setFlag("behind_head", isBehind);
    this.edgeProgram.set("reach_px", reachPx);
    this.atlas.use();
    gl.enable(gl.BLEND);
    gl.disable(gl.CULL_FACE);
    gl.depthMask(false);
    gl.bindVertexArray(this.edgeArray);
    gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
    gl.depthMask(true);
    gl.enable(gl.CULL_FACE);
    gl.disable(gl.BLEND);
  }

  /** Free the texture. */
  close() {
    this.atlas.close();
  }
}

/**
 * Vertices (n, 3): pixels from the middle of the picture, and depth in clip coordinates.
 * @param {number[]} clip
 * @param {number} width
 * @param {number} height
 * @param {Float64Array} vertices
 */
function flattened(clip, width, height, vertices) {
  const scale = [width / 2, height / 2, 1];
  const flat = new Float64Array(vertices.length);
  const row = (/** @type {number} */ k, /** @type {number} */ i) =>
    clip[4 * k] * vertices[i] +
    clip[4 * k + 1] * vertices[i + 1] +
    clip[4 * k + 2] * vertices[i + 2] +
    clip[4 * k + 3];
  for (let i = 0; i < vertices.length; i += 3) {
    const depth = row(3, i);
    for (let k = 0; k < 3; k++) flat[i + k] = (row(k, i) / depth) * scale[k];
  }
  return flat;
}
