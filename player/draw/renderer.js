import { BackgroundPass } from "./background_pass.js";
import { CanvasPicture, programOf } from "./gl.js";
import { HeadPass } from "./head_pass.js";
import { BACKGROUND, CHANGED, EDGE, HEAD, STILL_SCENE } from "./shaders.js";

/** @typedef {import("../model/background_mesh.js").BackgroundMesh} BackgroundMesh */
/** @typedef {import("../model/geometry.js").Camera} Camera */
/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("../model/parameters.js").Pose} Pose */
/** @typedef {import("./background_pass.js").LayerState} LayerState */
/** @typedef {import("./background_pictures.js").BackgroundPictures} BackgroundPictures */
/** @typedef {import("./head_pass.js").HeadState} HeadState */

/** Depth that is drawn before and behind the head's origin, but nothing nearer than the second. */
const DEPTH_RANGE_MM = 500;
const NEAR_MM = 10;
/** A texture with more texels a pixel is averaged. */
const COARSE_TEXELS_PER_PX = 3;
const ATLAS_MM = 200;

/** Draws a head over its background, on the canvas. */
export class Renderer {
  /**
   * @param {WebGL2RenderingContext} gl whose canvas has the size of the pictures
   * @param {Head} head
   * @param {BackgroundMesh} mesh
   * @param {BackgroundPictures} pictures
   * @param {number} textureSize
   */
  constructor(gl, head, mesh, pictures, textureSize) {
    const { width, height } = mesh.camera;
    this.gl = gl;
    this.picture = new CanvasPicture(gl);
    this.background = new BackgroundPass(gl, pictures, mesh);
    this.head = new HeadPass(gl, head, width, height, textureSize);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.clearColor(0, 0, 0, 1);
  }

  /**
   * Draw a frame.
   * @param {LayerState} layers
   * @param {HeadState} head
   */
  draw(layers, head) {
    this.#clear();
    this.background.draw(layers);
    this.head.draw(head);
  }

  /**
   * Draw the scene of a frame alone.
   * @param {LayerState} layers
   */
  drawScene(layers) {
    this.#clear();
    this.background.drawScene(layers.corners);
  }

  #clear() {
    this.picture.use();
    this.gl.clear(this.gl.COLOR_BUFFER_BIT | this.gl.DEPTH_BUFFER_BIT);
  }

  /** The pixels (height, width, 4) of the picture drawn last. */
  read() {
    return this.picture.read();
  }

  /**
   * Replace the picture drawn last.
   * @param {Uint8ClampedArray} pixels (height, width, 4)
   */
  write(pixels) {
    this.picture.write(pixels);
  }

  /** Free the textures. */
  close() {
    this.background.close();
    this.head.close();
    this.picture.close();
  }
}

/**
 * Make the programs before they are needed: that takes long where there is no graphics card.
 * @param {WebGL2RenderingContext} gl
 */
export function prepareToDraw(gl) {
  for (const shaders of [BACKGROUND[CHANGED], STILL_SCENE[0], HEAD, EDGE]) programOf(gl, shaders);
}

/**
 * The matrix (4, 4), row by row, from head-frame mm to clip coordinates with y down.
 * @param {Camera} camera
 * @param {Pose} pose
 * @param {number[]} rotation its matrix
 */
export function clipFromHead({ width, height, focalPx }, { translation }, rotation) {
  const near = Math.max(translation[2] - DEPTH_RANGE_MM, NEAR_MM);
  const far = Math.max(translation[2] + DEPTH_RANGE_MM, near + DEPTH_RANGE_MM);
  const row = (
    /** @type {number} */ k,
    /** @type {number} */ scale,
    /** @type {number} */ offset,
  ) => [
    ...rotation.slice(3 * k, 3 * k + 3).map((value) => scale * value),
    scale * translation[k] + offset,
  ];
  return [
    ...row(0, (2 * focalPx) / width, 0),
    ...row(1, (2 * focalPx) / height, 0),
    ...row(2, (far + near) / (far - near), (-2 * far * near) / (far - near)),
    ...row(2, 1, 0),
  ];
}

/**
 * Whether a texture of so many texels a side has several of them a pixel.
 * @param {number} size
 * @param {Camera} camera
 * @param {Pose} pose
 */
export function isCoarse(size, { focalPx }, { translation }) {
  return size > (COARSE_TEXELS_PER_PX * ATLAS_MM * focalPx) / Math.max(translation[2], NEAR_MM);
}
