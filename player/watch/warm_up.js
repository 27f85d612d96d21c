import { array } from "../data_file.js";
import { Scene } from "../draw/scene.js";
import { sceneGeometry } from "../draw/scene_geometry.js";
import { VOICES } from "../format/model_packet.js";
import { AAUS, EAUS } from "../model/parameters.js";
import { referenceFace } from "../model/person.js";

/** @typedef {import("../draw/scene.js").ModelPictures} ModelPictures */
/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../page/face_canvas.js").FaceCanvas} FaceCanvas */

const WIDTH = 640;
const HEIGHT = 480;
const DISTANCE_MM = 600;
const TEXELS = 256;
const GREY = 128;

/**
 * Draw a face that nobody has where it is not seen, unless a model comes meanwhile.  What a browser
 * does for the first time takes long, as it compiles scripts and shaders by and by: that has then
 * been done when a caller's face comes.
 * @param {FaceCanvas} faces
 * @returns whether it has been drawn
 */
export async function warmUp(faces) {
  for (const _ of steps(faces)) {
    await new Promise((resolve) => setTimeout(resolve));
    if (faces.pictures.size) return false;
  }
  return true;
}

/** @param {FaceCanvas} faces */
function* steps({ gl, compiled, heads }) {
  if (!gl || !compiled) return;
  const model = plainModel(array(heads.data, "control_points").length);
  const geometry = yield* sceneGeometry(heads, model);
  yield;
  const scene = new Scene(gl, compiled, geometry, model, plainPictures());
  try {
    yield;
    scene.draw({ face: referenceFace(model), index: 0, residual: null, presence: 1 });
    // Waits for the shaders.
    scene.read();
    // Before anybody sees it.
    gl.clear(gl.COLOR_BUFFER_BIT);
  } finally {
    scene.close();
  }
}

/**
 * The generic head, which looks into the camera.
 * @param {number} points of its residual shape
 * @returns {ModelPacket}
 */
function plainModel(points) {
  const nothing = new Uint8Array(0);
  return {
    call: {
      isThesis: false,
      isBt709: false,
      width: WIDTH,
      height: HEIGHT,
      fps: 25,
      rate: [25, 1],
      focalPx: WIDTH,
      framesPerPacket: 8,
      startFrame: 0,
      frameStep: 1,
      hasEyelids: true,
      voice: VOICES.OFF,
      sampleAspect: [1, 1],
      hasResidual: false,
    },
    version: 0,
    sequence: 0,
    aau: new Int8Array(AAUS),
    residual: new Int8Array(3 * points),
    rotation: [0, 1, 0, 0],
    translation: [0, 0, DISTANCE_MM],
    eau: new Int8Array(EAUS),
    background: nothing,
    texture: nothing,
    profileData: nothing,
    isProgressive: true,
    isExtensible: true,
  };
}

/** @returns {ModelPictures} grey ones */
function plainPictures() {
  const grey = new Uint8ClampedArray(4 * WIDTH * HEIGHT).fill(GREY);
  const picture = { height: HEIGHT, width: WIDTH, values: grey };
  return {
    mean: {
      size: TEXELS,
      mean: new Uint8Array(3 * TEXELS * TEXELS).fill(GREY),
      limits: null,
      lids: null,
    },
    modes: [],
    background: {
      moving: picture,
      still: picture,
      fields: null,
      changes: [],
      changeSize: { rows: 0, columns: 0 },
      sceneMoves: false,
      lightChanges: false,
    },
  };
}
