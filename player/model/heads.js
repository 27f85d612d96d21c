import { genericHead, headWithSurround } from "./head.js";
import { residualBasis } from "./shape_residual.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./head.js").Head} Head */

/** The heads of both profiles. */
export class Heads {
  /** @param {Arrays} data */
  constructor(data) {
    /** @type {Head} of the thesis profile */
    this.generic = genericHead(data);
    this.generic.residualBasis = residualBasis(data, this.generic);
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
}
