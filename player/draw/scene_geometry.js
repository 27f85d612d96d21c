import { BackgroundMesh } from "../model/background_mesh.js";
import { Person, referenceFace } from "../model/person.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/heads.js").Heads} Heads */

/** What is drawn of a model, but for its pictures. */
export class SceneGeometry {
  /**
   * @param {Heads} heads
   * @param {ModelPacket} model
   */
  constructor(heads, model) {
    this.head = heads.of(model.call);
    this.person = new Person(this.head, heads.residualShapeOf(model), model);
    const { pose, eau } = referenceFace(model);
    this.mesh = new BackgroundMesh(model.call, pose, this.head, this.person.animate(eau));
  }
}
