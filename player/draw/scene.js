import { NEAR_MM } from "../model/background_mesh.js";
import { cameraFromHead, matrixFromQuaternion } from "../model/geometry.js";
import { fieldsAtMesh, movedCorners, ownMotion, splitCoefficients } from "../model/layer_motion.js";
import { smoothstep } from "../model/parameters.js";
import { Appearance } from "./appearance.js";
import { faceArea } from "./face_area.js";
import { changeOf } from "./layer_colours.js";
import { clipFromHead, isCoarse, Renderer } from "./renderer.js";
import { ResidualPicture } from "./residual_picture.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("../model/parameters.js").Pose} Pose */
/** @typedef {import("../playout/playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {import("./appearance.js").Compiled} Compiled */
/** @typedef {import("./appearance.js").MeanTexture} MeanTexture */
/** @typedef {import("./background_pictures.js").BackgroundPictures} BackgroundPictures */
/** @typedef {import("./scene_geometry.js").SceneGeometry} SceneGeometry */
/**
 * The pictures of a model.
 * @typedef {object} ModelPictures
 * @property {MeanTexture} mean
 * @property {Float32Array[]} modes
 * @property {BackgroundPictures} background
 */

/** Light inside the mouth when the lips are closed; at this distance of the lips it is 1. */
const CLOSED_MOUTH_LIGHT = 0.35;
const OPEN_MOUTH_MM = 12;

/** One caller, ready to be drawn. */
export class Scene {
  /**
   * @param {WebGL2RenderingContext} gl whose canvas has the size of the pictures
   * @param {Compiled} compiled
   * @param {SceneGeometry} geometry
   * @param {ModelPacket} model
   * @param {ModelPictures} pictures
   */
  constructor(gl, compiled, { head, person, mesh }, model, pictures) {
    this.head = head;
    this.model = model;
    this.layers = { ...pictures.background, changes: pictures.background.changes.length };
    this.pictures = pictures;
    this.camera = model.call;
    this.person = person;
    this.mesh = mesh;
    const { fields } = pictures.background;
    this.fields = fields ? fieldsAtMesh(this.mesh, fields) : [];
    this.appearance = new Appearance(compiled, pictures.mean, pictures.modes);
    const { size } = pictures.mean;
    this.renderer = new Renderer(gl, head, this.mesh, pictures.background, size);
    this.residual = new ResidualPicture(model.call.width, model.call.height);
  }

  /**
   * Draw a frame on the canvas.
   * @param {Pick<PlayoutFrame, "face" | "index" | "residual" | "presence">} frame
   */
  draw({ face, index, residual, presence }) {
    const vertices = this.person.animate(face.eau);
    const pose = pushedBeforeCamera(face.pose, vertices);
    const layers = this.#layerState(face, pose, vertices);
    const clip = clipFromHead(this.camera, pose, matrixFromQuaternion(pose.rotation));
    this.renderer.draw(layers, {
      texture: this.appearance.synthesise(face),
      vertices,
      clip,
      mouthShading: this.model.call.isThesis ? mouthShading(this.head, vertices) : null,
      isCoarse: isCoarse(this.pictures.mean.size, this.camera, pose),
    });
    if (presence < 1 && this.pictures.background.still) this.#fade(presence, layers);
    if (residual) {
      const pixels = this.renderer.read();
      this.residual.addTo(
        pixels,
        residual,
        index,
        faceArea(this.head, this.camera, pose, vertices),
      );
      this.renderer.write(pixels);
    }
  }

  /**
   * @param {import("../model/parameters.js").Face} face
   * @param {Pose} pose
   * @param {Float64Array} vertices
   */
  #layerState(face, pose, vertices) {
    const own = splitCoefficients(this.layers, face.layers);
    const { background } = this.pictures;
    const motion = this.fields.length ? ownMotion(this.mesh, this.fields, own.motion) : null;
    const { width, height } = this.camera;
    return {
      gridPx: this.mesh.warp(pose, vertices, motion),
      change: changeOf(background.changes, background.changeSize, own.changes),
      light: own.light,
      corners: own.scene && movedCorners(width, height, own.scene),
    };
  }

  /**
   * Let the person fade from the picture drawn last.
   * @param {number} presence
   * @param {import("./background_pass.js").LayerState} layers
   */
  #fade(presence, layers) {
    const pixels = this.renderer.read();
    this.renderer.drawScene(layers);
    const empty = this.renderer.read();
    for (let i = 0; i < pixels.length; i++) {
      pixels[i] = Math.round(presence * pixels[i] + (1 - presence) * empty[i]);
    }
    this.renderer.write(pixels);
  }

  /**
   * Whether it draws a model with these pictures, limits, lids and modes apart.
   * @param {ModelPacket} model
   * @param {ModelPictures} pictures
   */
  draws(model, { mean, background }) {
    const own = this.pictures;
    const isSame = mean.mean === own.mean.mean && background === own.background;
    return isSame && model.version === this.model.version;
  }

  /**
   * Draw with these limits, lids and appearance modes from now on.
   * @param {ModelPictures} pictures
   */
  setAppearance({ mean, modes }) {
    this.appearance.mean = mean;
    this.appearance.modes = modes;
  }

  /** The pixels (height, width, 4) of the frame drawn last. */
  read() {
    return this.renderer.read();
  }

  /** Free what it holds of the graphics card. */
  close() {
    this.renderer.close();
  }
}

/**
 * The light inside a mouth, relative to that of wide open lips.
 * @param {Head} head
 * @param {Float64Array} vertices
 */
function mouthShading({ lips }, vertices) {
  const [upper, lower] = [...lips].map((v) => vertices.subarray(3 * v, 3 * v + 3));
  const opening = Math.hypot(...upper.map((value, i) => value - lower[i]));
  return CLOSED_MOUTH_LIGHT + (1 - CLOSED_MOUTH_LIGHT) * smoothstep(opening / OPEN_MOUTH_MM);
}

/**
 * The pose, moved away from the camera if a part of the head would be nearer than can be drawn.
 * @param {Pose} pose
 * @param {Float64Array} vertices
 * @returns {Pose}
 */
function pushedBeforeCamera(pose, vertices) {
  const points = cameraFromHead(pose, vertices);
  let nearest = Infinity;
  for (let i = 2; i < points.length; i += 3) nearest = Math.min(nearest, points[i]);
  if (nearest >= NEAR_MM) return pose;
  const [x, y, z] = pose.translation;
  return { rotation: pose.rotation, translation: [x, y, z + NEAR_MM - nearest] };
}
