import { check } from "../format/errors.js";
import { withPicturesOf } from "../format/model_packet.js";
import { LayerBuffer } from "../format/progressive_model.js";
import { FrameDecoder } from "./frame_decoder.js";

/** @typedef {import("../format/model_packet.js").CallParameters} CallParameters */
/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/**
 * A model with its layers, what decodes its frame packets, and the number of the first of them.
 * @typedef {object} ReceivedModel
 * @property {ModelPacket} model
 * @property {Uint8Array[]} modes
 * @property {ModelPacket} sent the model packet as it came
 * @property {FrameDecoder} decoder
 * @property {number} first
 */

/** The model in use, and the update that follows it. */
export class ReceivedModels {
  constructor() {
    /** @type {ReceivedModel | null} */
    this.current = null;
    /** @type {ReceivedModel | null} in use from the frame packet with its number on */
    this.update = null;
    this.layers = new LayerBuffer();
    /** @type {{current: ModelPacket, update: ReceivedModel, next: ReceivedModel} | null} `next`, and what it is made of */
    this.completed = null;
  }

  /** The update with the pictures that it takes over, the same object each time; null: there is none. */
  get next() {
    const { current, update } = this;
    if (!current || !update) return null;
    if (this.completed?.current !== current.model || this.completed.update !== update) {
      const next = { ...update, model: withPicturesOf(update.model, current.model) };
      this.completed = { current: current.model, update, next };
    }
    return this.completed.next;
  }

  /**
   * Enter a model packet: the first one, an update, or one that is repeated.
   * @param {ModelPacket} model
   * @param {number} first number of its first frame packet
   */
  receiveModel(model, first) {
    const received = () =>
      this.#withLayers({ model, modes: [], sent: model, decoder: new FrameDecoder(model), first });
    if (!this.current) {
      this.current = received();
      return;
    }
    const known = this.update ?? this.current;
    if (model.version > known.model.version) {
      checkUpdate(known.model.call, model.call);
      this.update = received();
    } else if (lacksPicturesOf(this.current.model, model)) {
      // Who joined at an update receives the pictures before it later.
      checkUpdate(this.current.model.call, model.call);
      this.current = { ...this.current, model: withPicturesOf(this.current.model, model) };
    }
  }

  /**
   * Enter a piece of a model's stream.
   * @param {number} version
   * @param {number} number
   * @param {Uint8Array} data
   */
  receiveLayer(version, number, data) {
    const { current, update } = this;
    if (!current || version >= current.model.version) this.layers.add(version, number, data);
    if (current?.model.version === version) this.current = this.#withLayers(current);
    if (update?.model.version === version) this.update = this.#withLayers(update);
  }

  /** Decode frame packets by the update from now on. */
  activate() {
    const { next } = this;
    if (!next) return;
    this.current = next;
    this.update = null;
    this.layers.dropBefore(next.model.version);
  }

  /**
   * @param {ReceivedModel} received
   * @returns {ReceivedModel}
   */
  #withLayers(received) {
    const { model, modes } = this.layers.apply(received.sent, received.decoder.transform);
    return { ...received, model: withPicturesOf(model, received.model), modes };
  }
}

/**
 * Whether a model has an empty picture that another one has.
 * @param {ModelPacket} model
 * @param {ModelPacket} other
 */
function lacksPicturesOf(model, other) {
  const isLacking = (/** @type {"background" | "texture"} */ name) =>
    !model[name].length && other[name].length > 0;
  return isLacking("background") || isLacking("texture");
}

/**
 * Throw `FormatError` if an update belongs to another call.
 * @param {CallParameters} call
 * @param {CallParameters} update
 */
function checkUpdate(call, update) {
  const isSame = call.isThesis === update.isThesis && isSamePicture(call, update);
  check(isSame, "an update is of another call");
}

/**
 * Whether the pictures of two calls have the same size and rate.
 * @param {CallParameters} one
 * @param {CallParameters} other
 */
export function isSamePicture(one, other) {
  return (
    one.width === other.width &&
    one.height === other.height &&
    one.rate.every((term, i) => term === other.rate[i])
  );
}
