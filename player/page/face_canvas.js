import { readDataFile } from "../data_file.js";
import { ImageFilters } from "../draw/image_filters.js";
import { prepareToDraw } from "../draw/renderer.js";
import { Scene } from "../draw/scene.js";
import { geometryKey, sceneGeometry } from "../draw/scene_geometry.js";
import { TextureSynthesis } from "../draw/texture_synthesis.js";
import { FormatError } from "../format/errors.js";
import { Heads } from "../model/heads.js";
import { afterStep, codedPictures } from "../playout/models_of_call.js";

/** @typedef {import("../draw/appearance.js").Compiled} Compiled */
/** @typedef {import("../draw/scene.js").ModelPictures} ModelPictures */
/** @typedef {import("../draw/scene_geometry.js").SceneGeometry} SceneGeometry */
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
    /** @type {Compiled | null} null until it has been compiled */
    this.compiled = null;
    Promise.all([ImageFilters.load(arrays), TextureSynthesis.load(arrays)]).then(
      ([filters, synthesis]) => {
        this.compiled = { filters, synthesis };
        this.onStep();
      },
    );
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
    /** @type {Map<string, SceneGeometry | Generator<void, SceneGeometry> | null>} found, or being found; null: there is none */
    this.geometries = new Map();
    this.worker = worker;
    worker.onmessage = (/** @type {MessageEvent<Answer>} */ { data: answer }) => this.#take(answer);
    worker.postMessage({ data });
    if (this.gl) prepareToDraw(this.gl);
  }

  /** Whether all models have been decoded. */
  get isDecoded() {
    return this.compiled !== null && !this.waiting.length;
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
    this.#prepare(coded.model);
  }

  /**
   * Find the geometry of a model while the worker decodes its pictures and the page draws.
   * @param {CodedModel["model"]} model
   */
  #prepare(model) {
    const key = geometryKey(model);
    if (this.geometries.has(key)) return;
    const isAtWork = this.#unfound !== undefined;
    this.geometries.set(key, sceneGeometry(this.heads, model));
    for (const old of this.geometries.keys()) {
      if (this.geometries.size <= this.kept) break;
      this.geometries.delete(old);
    }
    if (!isAtWork) setTimeout(() => this.#goOn());
  }

  /** The first geometry that is still being found. */
  get #unfound() {
    return [...this.geometries].find(([, known]) => known && "next" in known)?.[0];
  }

  /** Take a step of finding geometries, one after the other, and so on. */
  #goOn() {
    const key = this.#unfound;
    if (key === undefined) return;
    this.#stepOf(key);
    setTimeout(() => this.#goOn());
  }

  /**
   * One step of finding a geometry; whether there are more.
   * @param {string} key
   */
  #stepOf(key) {
    const steps = this.geometries.get(key);
    if (!steps || !("next" in steps)) return false;
    try {
      const { done, value } = steps.next();
      if (done) this.geometries.set(key, value);
      return !done;
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      this.errors.push(error.message);
      this.geometries.set(key, null);
      return false;
    }
  }

  /** @param {CodedModel["model"]} model */
  #geometryOf(model) {
    this.#prepare(model);
    const key = geometryKey(model);
    while (this.#stepOf(key));
    return /** @type {SceneGeometry | null} */ (this.geometries.get(key));
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
    if (!pictures || !this.gl || !this.compiled) return false;
    const { width, height } = coded.model.call;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    if (!this.scene?.draws(coded.model, pictures)) {
      const geometry = this.#geometryOf(coded.model);
      if (!geometry) return false;
      this.scene?.close();
      this.scene = new Scene(this.gl, this.compiled, geometry, coded.model, pictures);
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
