import { readDataFile } from "../data_file.js";
import { Scene } from "../draw/scene.js";
import { Heads } from "../model/heads.js";
import { readCall } from "../playout/call.js";
import { afterStep, codedPictures, modelsOf } from "../playout/models_of_call.js";

/** @typedef {import("../draw/scene.js").ModelPictures} ModelPictures */
/** @typedef {import("../playout/received_models.js").ReceivedModel} ReceivedModel */
/** @typedef {import("./decode_worker.js").Answer} Answer */

/** A call on a canvas: its frames, and what draws them. */
export class CallPlayer {
  /**
   * Throws `FormatError` if the file is no call.
   * @param {HTMLCanvasElement} canvas
   * @param {Uint8Array} file
   * @param {ArrayBuffer} data the player's data file
   * @param {Worker} worker that runs `runDecodeWorker`
   */
  constructor(canvas, file, data, worker) {
    this.call = readCall(file);
    this.frames = this.call.frames;
    this.startS = this.frames[0].timeS;
    const { width, height, fps } = this.frames[0].received.model.call;
    canvas.width = width;
    canvas.height = height;
    const options = { alpha: false, antialias: false, depth: false };
    this.gl = /** @type {WebGL2RenderingContext | null} */ (canvas.getContext("webgl2", options));
    this.durationS = this.frames[this.frames.length - 1].timeS - this.startS + 1 / fps;
    this.heads = new Heads(readDataFile(data));
    this.models = modelsOf(this.frames);
    /** @type {Map<ReceivedModel, ModelPictures>} as far as they have been decoded */
    this.pictures = new Map();
    this.decoded = 0;
    /** @type {string[]} what is wrong with models */
    this.errors = [];
    this.onMore = () => {};
    /** @type {{received: ReceivedModel, scene: Scene} | null} */
    this.shown = null;
    this.#decode(worker, data);
  }

  /**
   * @param {Worker} worker
   * @param {ArrayBuffer} data
   */
  #decode(worker, data) {
    worker.onmessage = (/** @type {MessageEvent<Answer>} */ { data: answer }) => {
      const received = this.models[this.decoded];
      if ("error" in answer) {
        this.errors.push(answer.error);
        this.decoded++;
        return;
      }
      const known = this.pictures.get(received) ?? this.pictures.get(this.models[this.decoded - 1]);
      const pictures = afterStep(answer, known);
      this.pictures.set(received, pictures);
      if (answer.isLast) this.decoded++;
      this.onMore();
    };
    worker.postMessage({ data });
    for (const received of this.models) worker.postMessage(codedPictures(received));
  }

  /** Whether all models have been decoded. */
  get isDecoded() {
    return this.decoded === this.models.length;
  }

  /** What is wrong with the call, in one line; empty: nothing. */
  get damage() {
    const [first] = [...this.errors, ...this.call.damages];
    if (first) return `damaged: ${first}`;
    return this.call.isComplete ? "" : "the call has no end: shown up to its last packet";
  }

  /**
   * The frame at a time from the first frame, seconds.
   * @param {number} timeS
   */
  frameAt(timeS) {
    let low = 0;
    let high = this.frames.length - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.frames[middle].timeS - this.startS <= timeS + 1e-6) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /**
   * Draw a frame; false if its model has not been decoded yet.
   * @param {number} index
   */
  draw(index) {
    const frame = this.frames[index];
    const pictures = this.pictures.get(frame.received);
    if (!pictures || !this.gl) return this.isDecoded;
    this.shown = this.#sceneOf(this.gl, frame.received, pictures);
    this.shown.scene.draw(frame);
    this.shown.scene.show();
    return true;
  }

  /**
   * What draws a model: as before where only modes have been added since.
   * @param {WebGL2RenderingContext} gl
   * @param {ReceivedModel} received
   * @param {ModelPictures} pictures
   */
  #sceneOf(gl, received, pictures) {
    const { shown } = this;
    if (shown?.scene.draws(received.model, pictures)) {
      shown.scene.setModes(pictures.modes);
      return { received, scene: shown.scene };
    }
    shown?.scene.close();
    return { received, scene: new Scene(gl, this.heads, received.model, pictures) };
  }
}
