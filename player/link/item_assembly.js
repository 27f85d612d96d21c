import { check } from "../format/errors.js";
import { CHANNELS, PIECE_BYTES, pieceCount } from "./messages.js";

/** @typedef {import("./messages.js").Holding} Holding */
/** @typedef {import("./messages.js").Piece} Piece */
/** @typedef {import("./messages.js").Span} Span */
/** A packet and its number, see `Piece`. @typedef {{number: number, packet: Uint8Array}} Item */
/**
 * An item of which pieces have come; `packet` once all have, empty if it has been given away.
 * @typedef {{total: number, number: number, pieces: Map<number, Uint8Array>, packet: Uint8Array | null}} Partial
 */

const MAX_AHEAD = 4096;
const MAX_HELD_BYTES = 2 * 1024 * 1024;
const MAX_HOLDINGS = 32;
const MAX_HOLDING_BYTES = 600;
const NOTHING = new Uint8Array(0);

/** Puts items together from their pieces, of either channel. */
export class ItemAssembly {
  constructor() {
    this.lanes = Object.values(CHANNELS).map(() => ({
      below: 0,
      /** @type {Map<number, Partial>} */
      items: new Map(),
    }));
    this.heldBytes = 0;
  }

  /**
   * Items before these are not needed.
   * @param {Span[]} spans by channel
   */
  begin(spans) {
    for (const [channel, { first }] of spans.entries()) this.lanes[channel].below = first;
  }

  /**
   * Items before these are not needed any more, unless their order matters.
   * @param {Span[]} spans by channel
   */
  extend(spans) {
    const lane = this.lanes[CHANNELS.UNORDERED];
    const { first } = spans[CHANNELS.UNORDERED];
    if (first <= lane.below) return;
    lane.below = first;
    for (const [item, part] of lane.items) {
      if (item >= first) continue;
      this.#free(part);
      lane.items.delete(item);
    }
    this.#advance(CHANNELS.UNORDERED);
  }

  /** Items below which all are there, or are not needed, by channel. */
  get below() {
    return this.lanes.map(({ below }) => below);
  }

  /**
   * Whether a piece is there, or not needed.
   * @param {Piece} piece
   */
  has({ channel, item, index }) {
    const { below, items } = this.lanes[channel];
    const part = items.get(item);
    return item < below || (part !== undefined && (part.packet !== null || part.pieces.has(index)));
  }

  /**
   * The packets that are complete with a piece.
   * @param {Piece} piece
   * @returns {Item[]}
   */
  add(piece) {
    const lane = this.lanes[piece.channel];
    if (piece.item < lane.below) return [];
    check(piece.item < lane.below + MAX_AHEAD, `item ${piece.item} is too far ahead`);
    let part = lane.items.get(piece.item);
    if (!part || (part.total !== piece.total && !part.packet)) {
      if (part) this.#free(part);
      part = { total: piece.total, number: piece.number, pieces: new Map(), packet: null };
      lane.items.set(piece.item, part);
    }
    if (part.packet) {
      part.total = Math.max(part.total, piece.total);
      return [];
    }
    if (part.pieces.has(piece.index)) return [];
    const isNext = piece.item === lane.below;
    check(isNext || this.heldBytes + PIECE_BYTES <= MAX_HELD_BYTES, "too many pieces wait");
    if (part.total) {
      part.pieces.set(piece.index, piece.data);
      this.heldBytes += PIECE_BYTES;
    }
    if (part.pieces.size < pieceCount(part.total)) return [];
    return this.#complete(part, piece.channel);
  }

  /**
   * @param {Partial} part
   * @param {number} channel
   */
  #complete(part, channel) {
    const packet = new Uint8Array(part.total);
    for (const [index, data] of part.pieces) packet.set(data, index * PIECE_BYTES);
    this.#free(part);
    if (channel === CHANNELS.ORDERED) {
      part.packet = packet;
      this.heldBytes += packet.length;
      return this.#advance(channel);
    }
    part.packet = NOTHING;
    this.#advance(channel);
    return packet.length ? [{ number: part.number, packet }] : [];
  }

  /** @param {Partial} part */
  #free(part) {
    this.heldBytes -= PIECE_BYTES * part.pieces.size + (part.packet?.length ?? 0);
    part.pieces.clear();
  }

  /**
   * The packets of the items that are there without a gap.
   * @param {number} channel
   * @returns {Item[]}
   */
  #advance(channel) {
    const lane = this.lanes[channel];
    const found = [];
    for (let part = lane.items.get(lane.below); part?.packet; part = lane.items.get(lane.below)) {
      lane.items.delete(lane.below);
      lane.below++;
      this.#free(part);
      if (part.packet.length) found.push({ number: part.number, packet: part.packet });
    }
    return found;
  }

  /**
   * What has come of the items from `below` on.
   * @returns {Holding[]}
   */
  holdings() {
    const found = [];
    let size = 0;
    for (const [channel, lane] of this.lanes.entries()) {
      for (const [item, part] of [...lane.items].sort(([a], [b]) => a - b)) {
        const count = Math.max(1, pieceCount(part.total));
        const pieces = part.packet
          ? Array.from({ length: count }, (_, i) => i)
          : [...part.pieces.keys()];
        if (!pieces.length) continue;
        size += 6 + (Math.max(...pieces) >> 3);
        if (found.length === MAX_HOLDINGS || size > MAX_HOLDING_BYTES) return found;
        found.push({ channel, item, pieces });
      }
    }
    return found;
  }
}
