import { carriedBasis, genericHead, headWithSurround } from "./head.js";
import { residualBasis } from "./shape_residual.js";

/** @typedef {import("../data_file.js").Arrays} Arrays */
/** @typedef {import("./head.js").Head} Head */

/** The heads of both profiles. */
export class Heads {
  /** @param {Arrays} data */
  constructor(data) {
    this.data = data;
    /** @type {Head} of the thesis profile */
    this.generic = genericHead(data);
    /** @type {Head} of the default profile */
    this.withSurround = headWithSurround(data, this.generic);
    /** @type {Float64Array[] | null} */
    this.basis = null;
  }

  /**
   * The head of a call.
   * @param {{isThesis: boolean}} call
   */
  of({ isThesis }) {
    return isThesis ? this.generic : this.withSurround;
  }

  /**
   * How the residual shape moves the vertices of the head of a call, see `shape_residual.js`.
   * @param {{isThesis: boolean}} call
   */
  residualBasisOf({ isThesis }) {
    this.basis ??= residualBasis(this.data, this.generic);
    return isThesis ? this.basis : carriedBasis(this.data, this.basis);
  }
}
