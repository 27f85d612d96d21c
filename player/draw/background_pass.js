import { PICTURE_CORNERS } from "../model/layer_motion.js";
import { bufferOf, programOf, Texture, writeBuffer } from "./gl.js";
import { BACKGROUND } from "./shaders.js";

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
    this.program = programOf(gl, BACKGROUND);
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
    const { solid, blended } = shownTriangles(rows, columns, coordinates, pictures.moving);
    this.solid = solid.length;
    this.count = solid.length + blended.length;
    this.grid = bufferOf(gl, Float32Array.from(gridPx));
    const shown = Uint32Array.from([...solid, ...blended]);
    this.mesh = this.#vertexArray(this.grid, bufferOf(gl, coordinates), shown);
    const places = PICTURE_CORNERS.map((corner, i) => corner * this.size[i & 1] - 0.5);
    this.corners = bufferOf(gl, Float32Array.from(PICTURE_CORNERS));
    const strip = Uint32Array.from([0, 1, 2, 3]);
    this.scene = this.#vertexArray(bufferOf(gl, Float32Array.from(places)), this.corners, strip);
  }

  /**
   * @param {WebGLBuffer} places
   * @param {WebGLBuffer} coordinates
   * @param {Uint32Array} indices
   */
  #vertexArray(places, coordinates, indices) {
    return this.program.vertexArray(
      [
        [places, [["position_px", 2]]],
        [coordinates, [["texture_coordinate", 2]]],
      ],
      bufferOf(this.gl, indices),
    );
  }

  /**
   * Draw the layers of a frame.
   * @param {LayerState} state
   */
  draw({ gridPx, change, light, corners }) {
    const { gl, program } = this;
    program.use();
    program.set("picture_px", this.size[0], this.size[1]);
    const { gain, offset, pivot } = light ?? { gain: 1, offset: 0, pivot: 0 };
    program.set("light", gain, (pivot - gain * pivot + offset) / 255);
    program.setFlag("is_changed", change !== null);
    if (change) this.change.write(change);
    gl.activeTexture(gl.TEXTURE1);
    this.change.use();
    gl.activeTexture(gl.TEXTURE0);
    program.setUnit("change", 1);
    writeBuffer(gl, this.grid, Float32Array.from(gridPx));
    this.drawScene(corners);
    program.set("fade", 0);
    this.textures[0].use();
    gl.bindVertexArray(this.mesh);
    gl.drawElements(gl.TRIANGLES, this.solid, gl.UNSIGNED_INT, 0);
    if (this.layers.length > 1) gl.enable(gl.BLEND);
    gl.drawElements(gl.TRIANGLES, this.count - this.solid, gl.UNSIGNED_INT, 4 * this.solid);
    gl.disable(gl.BLEND);
  }

  /**
   * Draw the scene without the person, if there is one, in the change and light drawn last.
   * @param {number[] | null} corners
   */
  drawScene(corners) {
    const { gl } = this;
    const texture = this.textures[1];
    if (!texture) return;
    const places = corners ?? PICTURE_CORNERS;
    const showsUnseen = places.some((place) => place < 0 || place > 1);
    if (showsUnseen && !this.hasMipmaps) {
      texture.setMipmaps(true);
      this.hasMipmaps = true;
    }
    writeBuffer(gl, this.corners, Float32Array.from(places));
    this.program.use();
    this.program.set("fade", showsUnseen ? UNSEEN_FADE : 0);
    texture.use();
    gl.bindVertexArray(this.scene);
    gl.drawElements(gl.TRIANGLE_STRIP, 4, gl.UNSIGNED_INT, 0);
  }

  /** Free the textures. */
  close() {
    for (const texture of [...this.textures, this.change]) texture.close();
  }
}

/**
 * The triangles of a grid on which a picture has no transparency, and those with some; where it is
 * wholly transparent there are none.
 * @param {number} rows
 * @param {number} columns
 * @param {Float32Array} coordinates (rows, columns, 2) 0..1
 * @param {Bitmap} picture
 */
function shownTriangles(rows, columns, coordinates, picture) {
  /** @type {number[]} */
  const solid = [];
  /** @type {number[]} */
  const blended = [];
  for (let i = 0; i < rows - 1; i++) {
    for (let j = 0; j < columns - 1; j++) {
      const a = i * columns + j;
      const { isSolid, isClear } = alphaWithin(picture, coordinates, a, a + columns + 1);
      const corners = [a, a + columns, a + 1, a + 1, a + columns, a + columns + 1];
      if (isSolid) solid.push(...corners);
      else if (!isClear) blended.push(...corners);
    }
  }
  return { solid, blended };
}

/**
 * Whether a picture is opaque, or wholly transparent, between two corners and a little beyond.
 * @param {Bitmap} picture
 * @param {Float32Array} coordinates
 * @param {number} first
 * @param {number} last
 */
function alphaWithin({ width, height, values }, coordinates, first, last) {
  const left = Math.max(Math.floor(coordinates[2 * first] * width) - 2, 0);
  const top = Math.max(Math.floor(coordinates[2 * first + 1] * height) - 2, 0);
  const right = Math.min(Math.ceil(coordinates[2 * last] * width) + 2, width);
  const bottom = Math.min(Math.ceil(coordinates[2 * last + 1] * height) + 2, height);
  let isSolid = true;
  let isClear = true;
  for (let y = top; y < bottom; y++) {
    for (let x = left; x < right; x++) {
      const alpha = values[4 * (y * width + x) + 3];
      isSolid &&= alpha === 255;
      isClear &&= alpha === 0;
    }
  }
  return { isSolid, isClear };
}
