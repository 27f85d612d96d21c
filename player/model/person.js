import { normalise } from "./geometry.js";
import { AAU_STEP, EAU_STEP, EAUS } from "./parameters.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("./head.js").Head} Head */
/** @typedef {import("./parameters.js").Face} Face */

/** A person's head, which actuators move. */
export class Person {
  /**
   * @param {Head} head
   * @param {Float64Array} residual (n, 3) mm, what the shape has beside the AAUs
   * @param {ModelPacket} model
   */
  constructor(head, residual, model) {
    this.head = head;
    this.neutral = head.vertices.map((value, i) => value + residual[i]);
    for (const [i, code] of model.aau.entries()) {
      addScaled(this.neutral, head.aau.at(i), code * AAU_STEP);
    }
  }

  /**
   * The vertices (n, 3), mm, head frame, of actuators.
   * @param {Float64Array} eau
   */
  animate(eau) {
    const vertices = this.neutral.slice();
    for (let i = 0; i < EAUS; i++) {
      if (eau[i] > 0) addScaled(vertices, this.head.eauUp.at(i), eau[i]);
      if (eau[i] < 0) addScaled(vertices, this.head.eauDown.at(i), -eau[i]);
    }
    return vertices;
  }
}

/**
 * @param {Float64Array} sum written
 * @param {Float32Array} field
 * @param {number} factor
 */
function addScaled(sum, field, factor) {
  for (let i = 0; i < field.length; i++) sum[i] += factor * field[i];
}

/**
 * The face of a model's background picture.
 * @param {ModelPacket} model
 * @returns {Face}
 */
export function referenceFace(model) {
  const none = new Float64Array(0);
  const pose = { rotation: normalise(model.rotation), translation: model.translation };
  return {
    pose,
    eau: Float64Array.from(model.eau, (code) => code * EAU_STEP),
    layers: none,
    modes: none,
  };
}
