/** @typedef {import("../format/frames/frame_payload.js").FramePredictor} FramePredictor */
/** @typedef {{number: number, payload: Uint8Array, frames: Float64Array[]}} Decoded */

/** Packets that are kept for those that come late. */
const KEPT = 8;

/** Decodes the frame packets of one model, of which some may come late or never. */
export class PacketHistory {
  /**
   * @param {FramePredictor} predictor
   * @param {number} nominalFrames of a packet whose header states no other number
   */
  constructor(predictor, nominalFrames) {
    this.predictor = predictor;
    this.nominalFrames = nominalFrames;
    /** @type {Decoded[]} */
    this.kept = [];
    /** @type {Float64Array} before the oldest of those kept */
    this.firstAnchor = new Float64Array(predictor.components);
  }

  /**
   * The frames of a packet that is later than all before.
   * @param {number} number within the model
   * @param {Uint8Array} payload
   */
  decode(number, payload) {
    const decoded = this.#decoded(this.kept, number, payload);
    this.#keep([...this.kept, decoded]);
    return decoded.frames;
  }

  /**
   * Take in a late packet, and decode those after it again: the frames of the newest one.  Null: the
   * packet is there already, or is older than those kept.
   * @param {number} number
   * @param {Uint8Array} payload
   */
  insert(number, payload) {
    const later = this.kept.findIndex((each) => each.number >= number);
    const place = later < 0 ? this.kept.length : later;
    if (this.kept[place]?.number === number || (!place && this.kept.length === KEPT)) return null;
    const chain = this.kept.slice(0, place);
    for (const each of [{ number, payload }, ...this.kept.slice(place)]) {
      chain.push(this.#decoded(chain, each.number, each.payload));
    }
    this.#keep(chain);
    return chain[chain.length - 1].frames;
  }

  /** @param {Decoded[]} chain */
  #keep(chain) {
    const dropped = chain.slice(0, -KEPT).pop();
    if (dropped) this.firstAnchor = dropped.frames[dropped.frames.length - 1];
    this.kept = chain.slice(-KEPT);
  }

  /**
   * @param {Decoded[]} before
   * @param {number} number
   * @param {Uint8Array} payload
   * @returns {Decoded}
   */
  #decoded(before, number, payload) {
    const last = before[before.length - 1];
    const anchor = last ? last.frames[last.frames.length - 1] : this.firstAnchor;
    const { frames } = this.predictor.decode(payload, anchor, number, this.nominalFrames);
    return { number, payload, frames };
  }
}
