import { check } from "../format/errors.js";
import { withPicturesOf } from "../format/model_packet.js";
import { LayerBuffer } from "../format/progressive_model.js";
import { FrameDecoder } from "./frame_decoder.js";

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
    if (model.version <= (this.update ?? this.current).model.version) return;
    const { call } = this.current.model;
    const isSame = ["isThesis", "width", "height", "fps"].every(
      (key) => /** @type {any} */ (call)[key] === /** @type {any} */ (model.call)[key],
    );
    check(isSame, "an update is of another call");
    this.update = received();
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
    if (!this.current || !this.update) return;
    const model = withPicturesOf(this.update.model, this.current.model);
    this.current = { ...this.update, model };
    this.update = null;
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
