import { interpolate } from "../model/geometry.js";
import { referenceFace } from "../model/person.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/parameters.js").Face} Face */
/** @typedef {import("./frame_decoder.js").TimedFace} TimedFace */

/** How long a lost face stays, and then takes to go to rest, seconds. */
const HELD_S = 0.4;
const TO_REST_S = 0.8;
/** Frames in which a face returns after lost packets, at most. */
const MAX_RETURN_FRAMES = 25;
/** A person who has left fades from the picture in this time. */
const FADE_S = 0.3;

/**
 * The face of a head that was lost so many seconds ago: it stays, then goes to rest.
 * @param {Face} face
 * @param {ModelPacket} model
 * @param {number} lostS
 */
export function atRest(face, model, lostS) {
  const passed = Math.min(Math.max((lostS - HELD_S) / TO_REST_S, 0), 1);
  if (!passed) return face;
  const rest = {
    ...referenceFace(model),
    layers: new Float64Array(face.layers.length),
    modes: new Float64Array(face.modes.length),
  };
  return interpolate(face, rest, passed * passed * (3 - 2 * passed));
}

/**
 * The face of a source frame between two coded ones whose packets between them are lost.
 * @param {TimedFace} before
 * @param {TimedFace} after
 * @param {number} index
 */
export function bridge(before, after, index) {
  const start = Math.max(before.time, after.time - MAX_RETURN_FRAMES);
  if (index <= start) return before.face;
  return interpolate(before.face, after.face, (index - start) / (after.time - start));
}

/**
 * How much of a person is shown who left some frames ago, 1 to 0.
 * @param {number} frames
 * @param {number} fps
 */
export function presence(frames, fps) {
  return Math.max(0, 1 - frames / Math.max(1, FADE_S * fps));
}
