import { PICTURE_CORNERS } from "../model/layer_motion.js";
import { bufferOf, programOf, Texture, writeBuffer, writeIndices } from "./gl.js";
import { LayerCells } from "./layer_cells.js";
import { BACKGROUND, CHANGED, LIT, STILL_SCENE, UNSEEN_SCENE } from "./shaders.js";
import { unseenStrips } from "./unseen_strips.js";

/** @typedef {import("../model/background_mesh.js").BackgroundMesh} BackgroundMesh */
/** @typedef {import("./background_pictures.js").BackgroundPictures} BackgroundPictures */
/** @typedef {import("./background_pictures.js").Bitmap} Bitmap */
/** @typedef {import("./layer_colours.js").Light} Light */
/**
 * What the layers of a frame look like.
 * @typedef {object} LayerState
 * @property {Float64Array} gridPx (rows, columns, 2) of the person's mesh
 * @property {Uint8ClampedArray | null} change (rows, columns, 4), see `changeOf`
 * @property {Light | null} light
 * @property {number[] | null} corners of the scene, see `movedCorners`
 */

/** Where a camera shows what it never has the scene is as blurred as can be from here on. */
const UNSEEN_FADE = 0.05;

/** Depths of the layers, behind all of the head: what is hidden is not drawn at all. */
const PERSON_DEPTH = 0.995;
const UNSEEN_DEPTH = 0.996;
const SCENE_DEPTH = 0.997;

/** Places of cells among the ends of `LayerCells.order`. */
const SOLID_PERSON = 0;
const BLENDED_PERSON = 2;
const SCENE = 4;

/** Draws the layers behind the head. */
export class BackgroundPass {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {BackgroundPictures} pictures
   * @param {BackgroundMesh} mesh
   */
  constructor(gl, pictures, mesh) {
    this.gl = gl;
    const { width, height } = mesh.camera;
    this.size = [width, height];
    /** What light makes of the colours: gain, offset, whether it does anything. */
    this.look = { gain: 1, offset: 0, isLit: false };
    /** Whether the frame has a change. */
    this.isChanged = false;
    this.layers = [pictures.moving, ...(pictures.still ? [pictures.still] : [])];
    this.textures = this.layers.map((layer) => {
      const texture = new Texture(gl, layer.width, layer.height);
      texture.write(layer.values);
      return texture;
    });
    const { rows: changeRows, columns: changeColumns } = pictures.changeSize;
    this.change = new Texture(gl, changeColumns, changeRows);
    this.hasMipmaps = false;
    const { gridPx, rows, columns } = mesh;
    const coordinates = Float32Array.from(gridPx, (value, i) => (value + 0.5) / this.size[i & 1]);
    this.cells = new LayerCells(rows, columns, coordinates, pictures.moving);
    this.changeSize = pictures.changeSize;
    /** @type {number[]} see `LayerCells.order` */
    this.ends = [];
    this.grid = bufferOf(gl, Float32Array.from(gridPx));
    this.indices = bufferOf(gl, this.cells.indices);
    const atlas = bufferOf(gl, coordinates);
    this.mesh = this.#vertexArray(this.grid, atlas, this.indices);
    this.stillScene = this.#vertexArray(
      bufferOf(gl, Float32Array.from(gridPx)),
      atlas,
      this.indices,
    );
    const corners = PICTURE_CORNERS.map((corner, i) => corner * this.size[i & 1] - 0.5);
    this.corners = bufferOf(gl, Float32Array.from(PICTURE_CORNERS));
    this.movedScene = this.#vertexArray(
      bufferOf(gl, Float32Array.from(corners)),
      this.corners,
      bufferOf(gl, Uint32Array.from([0, 1, 2, 2, 1, 3])),
    );
  }

  /**
   * @param {WebGLBuffer} places
   * @param {WebGLBuffer} coordinates
   * @param {WebGLBuffer} indices
   */
  #vertexArray(places, coordinates, indices) {
    return programOf(this.gl, BACKGROUND[CHANGED]).vertexArray(
      [
        [places, [["position_px", 2]]],
        [coordinates, [["texture_coordinate", 2]]],
      ],
      indices,
    );
  }

  /**
   * Draw the layers of a frame.
   * @param {LayerState} state
   */
  draw({ gridPx, change, light, corners }) {
    const { gl } = this;
    const { gain, offset, pivot } = light ?? { gain: 1, offset: 0, pivot: 0 };
    const isLit = gain !== 1 || offset !== 0;
    this.look = { gain, offset: (pivot - gain * pivot + offset) / 255, isLit };
    this.isChanged = change !== null;
    this.ends = this.cells.order(change, this.changeSize);
    writeIndices(gl, this.indices, this.cells.indices);
    if (change) this.change.write(change);
    gl.activeTexture(gl.TEXTURE1);
    this.change.use();
    gl.activeTexture(gl.TEXTURE0);
    writeBuffer(gl, this.grid, Float32Array.from(gridPx));
    gl.enable(gl.DEPTH_TEST);
    this.textures[0].use();
    this.#drawCells(this.mesh, BACKGROUND, PERSON_DEPTH, SOLID_PERSON);
    this.drawScene(corners);
    if (this.layers.length > 1) gl.enable(gl.BLEND);
    this.textures[0].use();
    this.#drawCells(this.mesh, BACKGROUND, PERSON_DEPTH, BLENDED_PERSON);
    for (const what of [gl.BLEND, gl.DEPTH_TEST]) gl.disable(what);
  }

  /**
   * Draw cells of a layer whose texture is in use.
   * @param {WebGLVertexArrayObject} array
   * @param {typeof BACKGROUND} programs
   * @param {number} depth
   * @param {number} first of the ends of these cells: of those without a change
   */
  #drawCells(array, programs, depth, first) {
    const { gl } = this;
    gl.bindVertexArray(array);
    for (const isChanged of [false, true]) {
      const at = first + (isChanged ? 1 : 0);
      const [start, end] = [at ? this.ends[at - 1] : 0, this.ends[at]];
      if (start === end) continue;
      this.#use(programs, depth, isChanged);
      gl.drawElements(gl.TRIANGLES, end - start, gl.UNSIGNED_INT, 4 * start);
    }
  }

  /**
   * Draw layers at a depth from now on, in the light of the frame.
   * @param {typeof BACKGROUND} programs
   * @param {number} depth
   * @param {boolean} isChanged whether in its change, too
   */
  #use(programs, depth, isChanged) {
    const { gain, offset, isLit } = this.look;
    const program = programOf(this.gl, programs[(isChanged ? CHANGED : 0) + (isLit ? LIT : 0)]);
    program.use();
    program.set("picture_px", this.size[0], this.size[1]);
    program.set("depth", depth);
    program.set("light", gain, offset);
    program.setUnit("change", 1);
    return program;
  }

  /**
   * Draw the scene without the person, if there is one, in the change and light drawn last.
   * @param {number[] | null} corners
   */
  drawScene(corners) {
    const { gl } = this;
    const texture = this.textures[1];
    if (!texture) return;
    texture.use();
    if (!corners) {
      this.#drawCells(this.stillScene, STILL_SCENE, SCENE_DEPTH, SCENE);
      return;
    }
    writeBuffer(gl, this.corners, Float32Array.from(corners));
    this.#use(BACKGROUND, SCENE_DEPTH, this.isChanged);
    gl.bindVertexArray(this.movedScene);
    gl.drawElements(gl.TRIANGLES, 6, gl.UNSIGNED_INT, 0);
    this.#drawUnseen(texture, unseenStrips(corners, this.size[0], this.size[1]));
  }

  /**
   * Draw what the frame shows beyond the scene's picture.
   * @param {Texture} texture
   * @param {number[][]} strips
   */
  #drawUnseen(texture, strips) {
    if (!strips.length) return;
    const { gl } = this;
    if (this.hasMipmaps) texture.useMipmaps(true);
    else texture.setMipmaps(true);
    this.hasMipmaps = true;
    this.#use(UNSEEN_SCENE, UNSEEN_DEPTH, this.isChanged).set("fade", UNSEEN_FADE);
    gl.enable(gl.SCISSOR_TEST);
    for (const [left, top, width, height] of strips) {
      gl.scissor(left, this.size[1] - top - height, width, height);
      gl.drawElements(gl.TRIANGLES, 6, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.SCISSOR_TEST);
    texture.useMipmaps(false);
  }

  /** Free the textures. */
  close() {
    for (const texture of [...this.textures, this.change]) texture.close();
  }
}
