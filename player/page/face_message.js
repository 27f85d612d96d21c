import { parseTransform } from "../format/frames/frame_transform.js";
import { parsePacket } from "../format/packets.js";
import { EAUS } from "../model/parameters.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/parameters.js").Face} Face */
/**
 * A face as `risorius/call_page/face_message.py` sends it, after the header of a picture.
 * @typedef {{model: number, presence: number, face: Face}} ShownFace
 */
/** A model and its number. @typedef {{number: number, model: ModelPacket, modes: Uint8Array[]}} ShownModel */

/**
 * @param {ArrayBuffer} data
 * @param {number} start of the face in it
 * @returns {ShownFace}
 */
export function parseFace(data, start) {
  const view = new DataView(data, start);
  const layers = view.getUint16(8, true);
  const modes = view.getUint16(10, true);
  let at = 12;
  const take = (/** @type {number} */ count) =>
    Float64Array.from({ length: count }, () => {
      at += 4;
      return view.getFloat32(at - 4, true);
    });
  const pose = { rotation: [...take(4)], translation: [...take(3)] };
  const face = { pose, eau: take(EAUS), layers: take(layers), modes: take(modes) };
  return { model: view.getUint32(0, true), presence: view.getFloat32(4, true), face };
}

/**
 * The model in a message.  Throws `FormatError` if it is damaged.
 * @param {ArrayBuffer} data
 * @returns {ShownModel}
 */
export function parseModelMessage(data) {
  const packet = parsePacket(new Uint8Array(data, 8));
  if (packet.kind !== "model") throw new Error("a model message without a model");
  const { model } = packet;
  const modes = model.call.isThesis ? [] : parseTransform(model.profileData).modes;
  return { number: new DataView(data).getUint32(4, true), model, modes };
}
