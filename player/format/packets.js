import { ByteReader } from "./bytes.js";
import { check } from "./errors.js";
import { parseTimes } from "./frames/frame_times.js";
import { parseModel } from "./model_packet.js";

/** @typedef {import("./model_packet.js").ModelPacket} ModelPacket */
/**
 * A packet: of a model; of frames; a piece of a model's stream; an event at a source frame, of
 * TIMES with the deviations in ticks of the frames from there on.
 * @typedef {{kind: "model", model: ModelPacket}
 *   | {kind: "frame", sequence: number, payload: Uint8Array}
 *   | {kind: "layer", version: number, number: number, data: Uint8Array}
 *   | {kind: "control", sequence: number, event: number, frame: number, ticks?: number[]}} Packet
 */

export const SEQUENCE_MODULUS = 64;
/** Bits 7 and 6 of byte 0. */
export const KINDS = { FRAME: 0, MODEL: 1, CONTROL: 2, LAYER: 3 };
/** Of whole packets, by kind. */
export const MAX_PACKET_BYTES = [8193, 262144, 256, 16390];
/** Events of control packets. */
export const EVENTS = {
  END: 0,
  FACE_LOST: 1,
  FACE_FOUND: 2,
  TIMES: 3,
  CAMERA_OFF: 4,
  CAMERA_ON: 5,
  PERSON_GONE: 6,
  JOINED: 7,
};
const MAX_LAYER_PACKETS = 4096;
const MAX_LAYER_BYTES = 16384;

/**
 * The kind of a packet, one of `KINDS`.
 * @param {Uint8Array} packet
 */
export function kindOf(packet) {
  return packet[0] >> 6;
}

/**
 * Whether a packet begins like the control packet that ends a call.
 * @param {Uint8Array} packet
 */
export function isEnd(packet) {
  return packet.length > 1 && kindOf(packet) === KINDS.CONTROL && packet[1] === EVENTS.END;
}

/**
 * The packet in bytes.  Throws `FormatError` if no encoder writes them.
 * @param {Uint8Array} data
 * @returns {Packet}
 */
export function parsePacket(data) {
  check(data.length, "empty packet");
  const kind = kindOf(data);
  check(data.length <= MAX_PACKET_BYTES[kind], `a packet of ${data.length} bytes is too long`);
  const sequence = data[0] % SEQUENCE_MODULUS;
  const payload = data.subarray(1);
  if (kind === KINDS.FRAME) return { kind: "frame", sequence, payload };
  if (kind === KINDS.MODEL) return { kind: "model", model: parseModel(sequence, payload) };
  const reader = new ByteReader(payload, kind === KINDS.LAYER ? "layer packet" : "control packet");
  if (kind === KINDS.LAYER) {
    const number = reader.varint();
    const isWithin = reader.left > 0 && reader.left <= MAX_LAYER_BYTES;
    check(number < MAX_LAYER_PACKETS && isWithin, "layer packet is empty or out of bounds");
    return { kind: "layer", version: sequence, number, data: reader.rest() };
  }
  const event = reader.byte();
  check(event <= EVENTS.JOINED, `control packet of unknown event ${event}`);
  const frame = reader.varint();
  if (event === EVENTS.TIMES) {
    return { kind: "control", sequence, event, frame, ticks: parseTimes(reader) };
  }
  check(!reader.left, `control packet: ${reader.left} bytes too many`);
  return { kind: "control", sequence, event, frame };
}

/**
 * A difference of sequence numbers, 0 to 63.
 * @param {number} difference
 */
export function sequenceStep(difference) {
  return ((difference % SEQUENCE_MODULUS) + SEQUENCE_MODULUS) % SEQUENCE_MODULUS;
}
