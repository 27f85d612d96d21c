import { check } from "../format/errors.js";
import { AAU_STEP, EAUS, RESIDUAL_STEP_MM } from "./parameters.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("./head.js").Head} Head */

/** A person's head, which actuators move. */
export class Person {
  /**
   * @param {Head} head
   * @param {Float64Array[]} residualBasis of the head, see `shape_residual.js`
   * @param {ModelPacket} model
   */
  constructor(head, residualBasis, model) {
    this.head = head;
    const points = residualBasis.length;
    const isRight = [0, points].includes(model.residual.length / 3);
    check(
      isRight,
      `model packet's residual has ${model.residual.length / 3} points, not ${points}`,
    );
    this.neutral = head.vertices.slice();
    for (const [i, code] of model.aau.entries())
      addScaled(this.neutral, head.aau[i], code * AAU_STEP);
    for (const [at, code] of model.residual.entries()) {
      const row = residualBasis[Math.floor(at / 3)];
      const mm = code * RESIDUAL_STEP_MM;
      if (mm) for (let v = 0; v < head.count; v++) this.neutral[3 * v + (at % 3)] += mm * row[v];
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
