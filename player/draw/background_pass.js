import { PICTURE_CORNERS } from "../model/layer_motion.js";
import { bufferOf, programOf, Texture, writeBuffer } from "./gl.js";
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
    /** What a change and light make of the colours: gain, offset, and which of the programs does. */
    this.look = { gain: 1, offset: 0, program: 0 };
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
    const corners = PICTURE_CORNERS.map((corner, i) => corner * this.size[i & 1] - 0.5);
    this.places = bufferOf(gl, Float32Array.from(corners));
    this.corners = bufferOf(gl, Float32Array.from(PICTURE_CORNERS));
    this.scene = this.#vertexArray(this.places, this.corners, Uint32Array.from([0, 1, 2, 3]));
  }

  /**
   * @param {WebGLBuffer} places
   * @param {WebGLBuffer} coordinates
   * @param {Uint32Array} indices
   */
  #vertexArray(places, coordinates, indices) {
    return programOf(this.gl, BACKGROUND[CHANGED]).vertexArray(
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
    const { gl } = this;
    const { gain, offset, pivot } = light ?? { gain: 1, offset: 0, pivot: 0 };
    const isLit = gain !== 1 || offset !== 0;
    this.look = {
      gain,
      offset: (pivot - gain * pivot + offset) / 255,
      program: (change ? CHANGED : 0) + (isLit ? LIT : 0),
    };
    if (change) this.change.write(change);
    gl.activeTexture(gl.TEXTURE1);
    this.change.use();
    gl.activeTexture(gl.TEXTURE0);
    writeBuffer(gl, this.grid, Float32Array.from(gridPx));
    gl.enable(gl.DEPTH_TEST);
    this.#drawPerson(0, this.solid);
    this.drawScene(corners);
    if (this.layers.length > 1) gl.enable(gl.BLEND);
    this.#drawPerson(this.solid, this.count);
    for (const what of [gl.BLEND, gl.DEPTH_TEST]) gl.disable(what);
  }

  /**
   * Draw triangles of the person.
   * @param {number} first of their indices
   * @param {number} end
   */
  #drawPerson(first, end) {
    const { gl } = this;
    this.#use(BACKGROUND, PERSON_DEPTH);
    this.textures[0].use();
    gl.bindVertexArray(this.mesh);
    gl.drawElements(gl.TRIANGLES, end - first, gl.UNSIGNED_INT, 4 * first);
  }

  /**
   * Draw layers at a depth from now on, in the change and light of the frame.
   * @param {typeof BACKGROUND} programs
   * @param {number} depth
   */
  #use(programs, depth) {
    const { gain, offset, program: own } = this.look;
    const program = programOf(this.gl, programs[own]);
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
    const places = corners ?? PICTURE_CORNERS;
    writeBuffer(gl, this.corners, Float32Array.from(places));
    const isStill = !corners && texture.width === this.size[0];
    this.#use(isStill ? STILL_SCENE : BACKGROUND, SCENE_DEPTH);
    texture.use();
    gl.bindVertexArray(this.scene);
    gl.drawElements(gl.TRIANGLE_STRIP, 4, gl.UNSIGNED_INT, 0);
    this.#drawUnseen(texture, unseenStrips(places, this.size[0], this.size[1]));
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
    this.#use(UNSEEN_SCENE, UNSEEN_DEPTH).set("fade", UNSEEN_FADE);
    gl.enable(gl.SCISSOR_TEST);
    for (const [left, top, width, height] of strips) {
      gl.scissor(left, this.size[1] - top - height, width, height);
      gl.drawElements(gl.TRIANGLE_STRIP, 4, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.SCISSOR_TEST);
    texture.useMipmaps(false);
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
