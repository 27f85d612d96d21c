import { readDataFile } from "../data_file.js";
import { ImageFilters } from "../draw/image_filters.js";
import { prepareToDraw } from "../draw/renderer.js";
import { Scene } from "../draw/scene.js";
import { SceneGeometry } from "../draw/scene_geometry.js";
import { FormatError } from "../format/errors.js";
import { Heads } from "../model/heads.js";
import { afterStep, codedPictures } from "../playout/models_of_call.js";

/** @typedef {import("../draw/scene.js").ModelPictures} ModelPictures */
/** @typedef {import("../playout/playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {import("../playout/received_models.js").ReceivedModel} ReceivedModel */
/** @typedef {import("./decode_worker.js").Answer} Answer */
/** A model and the modes that have come. @typedef {Pick<ReceivedModel, "model" | "modes">} CodedModel */

/** Models of a live call that are kept: in use and to come, with more and fewer layers. */
export const KEPT_MODELS = 8;

/** Draws the faces of one person on a canvas, by models whose pictures a worker decodes. */
export class FaceCanvas {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {ArrayBuffer} data the player's data file
   * @param {Worker} worker that runs `runDecodeWorker`
   * @param {number} kept models: those that came before cannot be drawn any more
   */
  constructor(canvas, data, worker, kept = KEPT_MODELS) {
    this.canvas = canvas;
    const options = { alpha: false, antialias: false, preserveDrawingBuffer: true };
    this.gl = /** @type {WebGL2RenderingContext | null} */ (canvas.getContext("webgl2", options));
    const arrays = readDataFile(data);
    this.heads = new Heads(arrays);
    /** @type {ImageFilters | null} null until they have been compiled */
    this.filters = null;
    ImageFilters.load(arrays).then((filters) => {
      this.filters = filters;
      this.onStep();
    });
    this.kept = kept;
    /** @type {Map<CodedModel, ModelPictures | undefined>} as far as they have been decoded, in the order in which they came */
    this.pictures = new Map();
    /** @type {CodedModel[]} those that the worker has not finished */
    this.waiting = [];
    /** @type {ModelPictures | undefined} of the model decoded last */
    this.newest = undefined;
    /** @type {string[]} what is wrong with models and residuals */
    this.errors = [];
    /** called after each step of decoding */
    this.onStep = () => {};
    /** @type {Scene | null} */
    this.scene = null;
    /** @type {WeakMap<CodedModel["model"], SceneGeometry>} */
    this.geometries = new WeakMap();
    this.worker = worker;
    worker.onmessage = (/** @type {MessageEvent<Answer>} */ { data: answer }) => this.#take(answer);
    worker.postMessage({ data });
    if (this.gl) prepareToDraw(this.gl);
  }

  /** Whether all models have been decoded. */
  get isDecoded() {
    return this.filters !== null && !this.waiting.length;
  }

  /**
   * Take a model, whose pictures are decoded from now on.
   * @param {CodedModel} coded
   */
  addModel(coded) {
    this.pictures.set(coded, undefined);
    for (const old of this.pictures.keys()) {
      if (this.pictures.size <= this.kept) break;
      this.pictures.delete(old);
    }
    this.waiting.push(coded);
    this.worker.postMessage(codedPictures(coded));
    // Of the first model while the worker decodes its pictures, of others when they are drawn.
    if (!this.scene && this.pictures.size === 1) this.#geometryOf(coded.model);
  }

  /** @param {CodedModel["model"]} model */
  #geometryOf(model) {
    const geometry = this.geometries.get(model) ?? new SceneGeometry(this.heads, model);
    this.geometries.set(model, geometry);
    return geometry;
  }

  /** @param {Answer} answer */
  #take(answer) {
    const [coded] = this.waiting;
    if ("error" in answer) {
      this.errors.push(answer.error);
      this.waiting.shift();
      return;
    }
    this.newest = afterStep(answer, this.pictures.get(coded) ?? this.newest);
    if (this.pictures.has(coded)) this.pictures.set(coded, this.newest);
    if (answer.isLast) this.waiting.shift();
    this.onStep();
  }

  /**
   * Draw a face; false if its model has not been decoded yet.
   * @param {CodedModel} coded
   * @param {Pick<PlayoutFrame, "face" | "index" | "residual" | "presence">} frame
   */
  draw(coded, frame) {
    const pictures = this.pictures.get(coded);
    if (!pictures || !this.gl || !this.filters) return false;
    const { width, height } = coded.model.call;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    if (!this.scene?.draws(coded.model, pictures)) {
      this.scene?.close();
      this.scene = new Scene(
        this.gl,
        this.filters,
        this.#geometryOf(coded.model),
        coded.model,
        pictures,
      );
    }
    this.scene.setAppearance(pictures);
    this.#drawFrame(this.scene, frame);
    return true;
  }

  /**
   * @param {Scene} scene
   * @param {Pick<PlayoutFrame, "face" | "index" | "residual" | "presence">} frame
   */
  #drawFrame(scene, frame) {
    try {
      scene.draw(frame);
    } catch (error) {
      // A residual is damaged: the frame has been drawn without it.
      if (!(error instanceof FormatError)) throw error;
      this.errors.push(error.message);
    }
  }
}
