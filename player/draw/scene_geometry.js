import { BackgroundMesh } from "../model/background_mesh.js";
import { Person, referenceFace } from "../model/person.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/head.js").Head} Head */
/** @typedef {import("../model/heads.js").Heads} Heads */
/** What is drawn of a model, but for its pictures. @typedef {{head: Head, person: Person, mesh: BackgroundMesh}} SceneGeometry */

/**
 * The geometry of a model, found step by step, so that a page can draw meanwhile.
 * @param {Heads} heads
 * @param {ModelPacket} model
 * @returns {Generator<void, SceneGeometry>}
 */
export function* sceneGeometry(heads, model) {
  const head = heads.of(model.call);
  const shape = heads.residualShapeOf(model);
  yield;
  const person = new Person(head, shape, model);
  const { pose, eau } = referenceFace(model);
  const vertices = person.animate(eau);
  yield;
  const mesh = yield* BackgroundMesh.found(model.call, pose, head, vertices);
  return { head, person, mesh };
}

/**
 * What tells the geometries of models from each other.
 * @param {ModelPacket} model
 */
export function geometryKey({ call, aau, residual, rotation, translation, eau }) {
  const { isThesis, width, height, focalPx } = call;
  return [isThesis, width, height, focalPx, aau, residual, rotation, translation, eau].join(";");
}
