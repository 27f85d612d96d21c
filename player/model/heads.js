import { array } from "../data_file.js";
import { check } from "../format/errors.js";
import { carriedValues, genericHead, headWithSurround } from "./head.js";
import { RESIDUAL_STEP_MM } from "./parameters.js";
import { residualShape } from "./shape_residual.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./head.js").Head} Head */
/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */

/** The heads of both profiles. */
export class Heads {
  /** @param {Arrays} data */
  constructor(data) {
    this.data = data;
    /** @type {Head} of the thesis profile */
    this.generic = genericHead(data);
    /** @type {Head} of the default profile */
    this.withSurround = headWithSurround(data, this.generic);
  }

  /**
   * The head of a call.
   * @param {{isThesis: boolean}} call
   */
  of({ isThesis }) {
    return isThesis ? this.generic : this.withSurround;
  }

  /**
   * The residual shape of a model: the displacement (n, 3), mm, of the vertices of its head.
   * @param {ModelPacket} model
   */
  residualShapeOf({ call, residual }) {
    const points = array(this.data, "control_points").length;
    const isRight = [0, points].includes(residual.length / 3);
    check(isRight, `model packet's residual has ${residual.length / 3} points, not ${points}`);
    const controlMm = Float64Array.from(residual, (code) => code * RESIDUAL_STEP_MM);
    const shape = residualShape(this.data, this.generic, controlMm);
    return call.isThesis ? shape : carriedValues(this.data, shape);
  }
}
