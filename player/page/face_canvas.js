import { readDataFile } from "../data_file.js";
import { Scene } from "../draw/scene.js";
import { Heads } from "../model/heads.js";
import { afterStep, codedPictures } from "../playout/models_of_call.js";

/** @typedef {import("../draw/scene.js").ModelPictures} ModelPictures */
/** @typedef {import("../letter/decode_worker.js").Answer} Answer */
/** @typedef {import("./face_message.js").ShownFace} ShownFace */
/** @typedef {import("./face_message.js").ShownModel} ShownModel */

/** Models that are kept: in use and to come, with more and fewer layers. */
const KEPT_MODELS = 8;

/** Draws the faces of one person, as they come, on a canvas. */
export class FaceCanvas {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {ArrayBuffer} data the player's data file
   * @param {Worker} worker that runs `runDecodeWorker`
   */
  constructor(canvas, data, worker) {
    this.canvas = canvas;
    const options = { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true };
    this.gl = /** @type {WebGL2RenderingContext | null} */ (canvas.getContext("webgl2", options));
    this.heads = new Heads(readDataFile(data));
    /** @type {ShownModel[]} in the order in which they came */
    this.models = [];
    /** @type {ShownModel[]} those that the worker has not finished */
    this.waiting = [];
    /** @type {Map<number, ModelPictures>} by the number of the model */
    this.pictures = new Map();
    /** @type {ModelPictures | undefined} of the model decoded last */
    this.newest = undefined;
    /** @type {Scene | null} */
    this.scene = null;
    this.worker = worker;
    worker.onmessage = (/** @type {MessageEvent<Answer>} */ { data: answer }) => this.#take(answer);
    worker.postMessage({ data });
  }

  /**
   * Take a model, whose pictures are decoded from now on.
   * @param {ShownModel} shown
   */
  addModel(shown) {
    this.models.push(shown);
    for (const old of this.models.splice(0, this.models.length - KEPT_MODELS)) {
      this.pictures.delete(old.number);
    }
    this.waiting.push(shown);
    this.worker.postMessage(codedPictures(shown));
  }

  /** @param {Answer} answer */
  #take(answer) {
    const [shown] = this.waiting;
    if ("error" in answer) {
      this.waiting.shift();
      return;
    }
    this.newest = afterStep(answer, this.pictures.get(shown.number) ?? this.newest);
    this.pictures.set(shown.number, this.newest);
    if (answer.isLast) this.waiting.shift();
  }

  /**
   * Draw a face; false if its model has not been decoded yet.
   * @param {ShownFace} shown
   */
  draw({ model: number, presence, face }) {
    const shown = this.models.find((each) => each.number === number);
    const pictures = this.pictures.get(number);
    if (!shown || !pictures || !this.gl) return false;
    const { width, height } = shown.model.call;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    if (!this.scene?.draws(shown.model, pictures)) {
      this.scene?.close();
      this.scene = new Scene(this.gl, this.heads, shown.model, pictures);
    }
    this.scene.setModes(pictures.modes);
    this.scene.draw({ face, index: 0, residual: null, presence });
    this.scene.show();
    return true;
  }
}
