import { AAU_STEP, EAUS } from "./parameters.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("./head.js").Head} Head */

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
      addScaled(this.neutral, head.aau[i], code * AAU_STEP);
    }
  }

  /**
   * The vertices (n, 3), mm, head frame, of actuators.
   * @param {Float64Array} eau
   */
  animate(eau) {
    const vertices = this.neutral.slice();
    for (let i = 0; i < EAUS; i++) {
      if (eau[i] > 0) addScaled(vertices, this.head.eauUp[i], eau[i]);
      if (eau[i] < 0) addScaled(vertices, this.head.eauDown[i], -eau[i]);
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
