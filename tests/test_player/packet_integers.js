// What is in packets, in integers, as the player finds it; as a decoder of ours does it:
// `tests/packet_integers.py`.
import { crc32 } from "../../player/format/checksums.js";
import { FormatError } from "../../player/format/errors.js";
import { KINDS, parsePacket } from "../../player/format/packets.js";
import { FrameDecoder } from "../../player/playout/frame_decoder.js";
import { bytesOf } from "./vectors.js";

/** @typedef {import("../../player/format/model_packet.js").CallParameters} CallParameters */
/** @typedef {import("../../player/format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../../player/format/packets.js").Packet} Packet */

export const FINE = 2 ** 20;
export const OF_EAU = 2 ** 12;
export const COARSE = 2 ** 10;
const BESIDE = 0.41421356;

/**
 * @param {Iterable<number>} values
 * @param {number} cells
 */
export function onGrid(values, cells) {
  return Array.from(values, (value) => Math.floor(value * cells + BESIDE));
}

/**
 * What has been found, with -2 for what is damaged.
 * @param {number[]} found
 * @param {() => number[]} find what else there is
 */
export function guarded(found, find) {
  try {
    return [...found, ...find()];
  } catch (error) {
    if (!(error instanceof FormatError)) throw error;
    return [...found, -2];
  }
}

/** @param {CallParameters} call */
function callIntegers(call) {
  return [
    Number(call.isThesis),
    Number(call.isBt709),
    call.width,
    call.height,
    ...call.rate,
    ...onGrid([call.focalPx], COARSE),
    call.framesPerPacket,
    call.startFrame,
    call.frameStep,
    Number(call.hasEyelids),
    call.voice,
    ...call.sampleAspect,
    Number(call.hasResidual),
  ];
}

/** @param {ModelPacket} model */
export function fieldIntegers(model) {
  return [
    ...callIntegers(model.call),
    model.version,
    model.sequence,
    Number(model.isProgressive),
    Number(model.isExtensible),
    ...model.aau,
    ...onGrid(model.rotation, FINE),
    ...onGrid(model.translation, COARSE),
    ...model.eau,
    model.residual.length,
    ...model.residual,
    crc32([model.texture]),
    crc32([model.background]),
  ];
}

/**
 * The fields of a packet, its kind in front.
 * @param {Packet} packet
 */
function packetIntegers(packet) {
  switch (packet.kind) {
    case "frame":
      return [KINDS.FRAME, packet.sequence, packet.payload.length, crc32([packet.payload])];
    case "layer": {
      const { version, number, data } = packet;
      return [KINDS.LAYER, version, number, data.length, crc32([data])];
    }
    case "control": {
      const { sequence, event, frame, ticks = [] } = packet;
      return [KINDS.CONTROL, sequence, event, frame, ...ticks];
    }
    case "model":
      return [KINDS.MODEL, ...fieldIntegers(packet.model), crc32([packet.model.profileData])];
  }
}

/**
 * What is in packets, one in hexadecimal digits on each line; -2 at the end of a model's: its
 * transform is refused.
 * @param {string} lines
 */
export function packetsIntegers(lines) {
  return lines
    .trim()
    .split("\n")
    .map((line) =>
      guarded([], () => {
        const packet = parsePacket(bytesOf(line));
        return guarded(packetIntegers(packet), () =>
          packet.kind === "model" ? [new FrameDecoder(packet.model).newest] : [],
        );
      }),
    );
}
