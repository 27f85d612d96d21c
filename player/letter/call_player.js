import { FaceCanvas } from "../page/face_canvas.js";
import { readCall } from "../playout/call.js";
import { modelsOf } from "../playout/models_of_call.js";

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
    this.durationS = this.frames[this.frames.length - 1].timeS - this.startS + 1 / fps;
    const models = modelsOf(this.frames);
    this.faces = new FaceCanvas(canvas, data, worker, models.length);
    for (const received of models) this.faces.addModel(received);
  }

  /** What is wrong with the call, in one line; empty: nothing. */
  get damage() {
    const [first] = [...this.faces.errors, ...this.call.damages];
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
    return this.faces.draw(frame.received, frame) || this.faces.isDecoded;
  }
}
