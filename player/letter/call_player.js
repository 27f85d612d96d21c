import { readDataFile } from "../data_file.js";
import { Scene } from "../draw/scene.js";
import { Heads } from "../model/heads.js";
import { readCall } from "../playout/call.js";
import { codedPictures, completed, modelsOf } from "../playout/models_of_call.js";

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
    this.gl = canvas.getContext("webgl2", options);
    this.durationS = this.frames[this.frames.length - 1].timeS - this.startS + 1 / fps;
    this.heads = new Heads(readDataFile(data));
    this.models = modelsOf(this.frames);
    /** @type {Map<ReceivedModel, ModelPictures | string>} pictures, or what is wrong with them */
    this.pictures = new Map();
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
      const received = this.models[this.pictures.size];
      const before = this.pictures.get(this.models[this.pictures.size - 1]);
      const known = typeof before === "object" ? before : undefined;
      this.pictures.set(received, "error" in answer ? answer.error : completed(answer, known));
    };
    worker.postMessage({ data });
    for (const received of this.models) worker.postMessage(codedPictures(received));
  }

  /** Whether all models have been decoded. */
  get isDecoded() {
    return this.pictures.size === this.models.length;
  }

  /** What is wrong with the call, in one line; empty: nothing. */
  get damage() {
    const broken = [...this.pictures.values()].filter((each) => typeof each === "string");
    const [first] = [...broken, ...this.call.damages];
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
    if (pictures === undefined || !this.gl) return false;
    if (typeof pictures === "string") return true;
    if (this.shown?.received !== frame.received) {
      this.shown?.scene.close();
      const head = this.heads.of(frame.received.model.call);
      this.shown = { received: frame.received, scene: new Scene(this.gl, head, frame.received, pictures) };
    }
    this.shown.scene.draw(frame);
    this.shown.scene.show();
    return true;
  }
}
