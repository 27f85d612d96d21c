import { hasWebAssembly } from "../format/pictures/picture_codec.js";
import { PlayoutDelay } from "../playout/playout_delay.js";
import { runDecodeWorker } from "./decode_worker.js";
import { FaceCanvas, KEPT_MODELS } from "./face_canvas.js";
import { parseFace, parseModelMessage } from "./face_message.js";

/** @typedef {import("./face_message.js").ShownFace} ShownFace */
/** @typedef {import("./face_message.js").ShownModel} ShownModel */

/** Names of renderers without a graphics card. */
const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

/** Draws the faces that a call's program sends. */
class FaceDrawer {
  /**
   * @param {ArrayBuffer} data the player's data file
   * @param {string} script address of this script
   * @param {number} kept models: the faces of older ones cannot be drawn any more
   */
  constructor(data, script, kept) {
    this.kept = kept;
    this.faces = new FaceCanvas(document.createElement("canvas"), data, new Worker(script), kept);
    /** @type {ShownModel[]} */
    this.models = [];
  }

  /** What draws; null: nothing has been drawn. */
  get scene() {
    return this.faces.scene;
  }

  /**
   * Take a model.  Throws `FormatError` if it is damaged.
   * @param {ArrayBuffer} message
   */
  addModel(message) {
    const shown = parseModelMessage(message);
    this.models = [...this.models.slice(1 - this.kept), shown];
    this.faces.addModel(shown);
  }

  /**
   * Draw a face; the canvas, or null if its model has not been decoded yet.
   * @param {ShownFace} shown
   */
  draw({ model, presence, face }) {
    const coded = this.models.find(({ number }) => number === model);
    const frame = { face, index: 0, residual: null, presence };
    return coded && this.faces.draw(coded, frame) ? this.faces.canvas : null;
  }
}

/**
 * Whether this browser can draw faces with a graphics card; in software the host does it for less.
 * @param {boolean} isForced whether software will do
 */
function canDraw(isForced) {
  const options = { failIfMajorPerformanceCaveat: !isForced };
  const gl = /** @type {WebGL2RenderingContext | null} */ (
    document.createElement("canvas").getContext("webgl2", options)
  );
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const renderer = info ? gl?.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  return gl !== null && hasWebAssembly() && (isForced || !SOFTWARE.test(renderer));
}

if (typeof document === "undefined") runDecodeWorker();
else {
  const script = /** @type {HTMLScriptElement} */ (document.currentScript).src;
  const make = (/** @type {ArrayBuffer} */ data, kept = KEPT_MODELS) =>
    new FaceDrawer(data, script, kept);
  Object.assign(window, { faces: { canDraw, make, parse: parseFace, PlayoutDelay } });
}
