import { sameBytes } from "./bytes.js";
import { check } from "./errors.js";
import { MAX_IMAGE_BYTES } from "./model_packet.js";

/** @typedef {import("./frames/frame_transform.js").FrameTransform} FrameTransform */
/** @typedef {import("./model_packet.js").ModelPacket} ModelPacket */
/**
 * A model with what layer packets have brought.
 * @typedef {{model: ModelPacket, modes: Uint8Array[]}} CompletedModel
 */

/** Texture and background come before the modes. */
const PICTURES = 2;
const MAX_ITEMS = PICTURES + 64;
const LIMIT_BYTES = 524288;
const OVERHEAD_BYTES = 64;

/** The layer packets of a call, received in any order, by the version of their model. */
export class LayerBuffer {
  constructor() {
    /** @type {Map<number, Map<number, Uint8Array>>} */
    this.pieces = new Map();
    this.bytes = 0;
  }

  /**
   * Add a piece, unless it is there.
   * @param {number} version
   * @param {number} number
   * @param {Uint8Array} data
   */
  add(version, number, data) {
    const pieces = this.pieces.get(version) ?? new Map();
    this.pieces.set(version, pieces);
    if (pieces.has(number)) return;
    const bytes = this.bytes + data.length + OVERHEAD_BYTES;
    check(bytes <= LIMIT_BYTES, `layer packets of more than ${LIMIT_BYTES} bytes`);
    pieces.set(number, data);
    this.bytes = bytes;
  }

  /**
   * Remove the pieces of versions before one.
   * @param {number} version
   */
  dropBefore(version) {
    for (const [old, pieces] of this.pieces) {
      if (old >= version) continue;
      for (const data of pieces.values()) this.bytes -= data.length + OVERHEAD_BYTES;
      this.pieces.delete(old);
    }
  }

  /**
   * A model and the modes of its transform with all items received without a gap.
   * @param {ModelPacket} model
   * @param {FrameTransform | null} transform
   * @returns {CompletedModel}
   */
  apply(model, transform) {
    const items = this.#items(model.version);
    const modes = transform?.modes ?? [];
    if (!items.length) return { model, modes };
    const hasLayers = transform && (model.isProgressive || transform.reservedModes);
    check(hasLayers, `layer packets for model ${model.version}, which has no layers`);
    const known = model.isProgressive ? [] : modes.slice(0, modes.length - transform.reservedModes);
    const [texture, background, ...sent] = items;
    const room = modes.length - known.length;
    const isValid = sent.length <= room && sent.every((mode) => mode.length);
    check(isValid, `${sent.length} modes in layers, expected at most ${room}`);
    const hasPictures = texture.length || background?.length;
    check(model.isProgressive || !hasPictures, "pictures in layers of a model with its own");
    const missing = Array(room - sent.length).fill(new Uint8Array(0));
    return {
      model: {
        ...model,
        texture: texture.length ? texture : model.texture,
        background: background?.length ? background : model.background,
      },
      modes: [...known, ...sent, ...missing],
    };
  }

  /**
   * The items of a stream that are whole.
   * @param {number} version
   */
  #items(version) {
    const stream = this.#stream(version);
    const items = [];
    let position = 0;
    while (position < stream.length) {
      let length = 0;
      let scale = 1;
      let byte = 0x80;
      while (byte >= 0x80) {
        if (position >= stream.length) return items;
        byte = stream[position++];
        length += (byte & 0x7f) * scale;
        scale *= 128;
        check(length <= MAX_IMAGE_BYTES && scale <= 128 ** 4, "an item of the layers is too long");
      }
      check(items.length < MAX_ITEMS, `more than ${MAX_ITEMS} items in layers`);
      if (position + length > stream.length) return items;
      items.push(stream.subarray(position, position + length));
      position += length;
    }
    return items;
  }

  /**
   * The pieces received without a gap.
   * @param {number} version
   */
  #stream(version) {
    const pieces = this.pieces.get(version) ?? new Map();
    const bytes = [];
    for (let number = 0; pieces.has(number); number++) bytes.push(...pieces.get(number));
    return Uint8Array.from(bytes);
  }
}

/**
 * Whether two models are the same but for what layers have brought.
 * @param {ModelPacket} one
 * @param {ModelPacket} other
 */
export function isSameModel(one, other) {
  return one.version === other.version && sameBytes(one.profileData, other.profileData);
}
