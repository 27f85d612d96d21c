import { readDataFile } from "../data_file.js";
import { ModelDecoder } from "../draw/model_decoder.js";
import { FormatError } from "../format/errors.js";

/** @typedef {import("../draw/model_decoder.js").CodedPictures} CodedPictures */
/** @typedef {import("../draw/model_decoder.js").DecodedStep} DecodedStep */
/** What a worker is told: first the data file, then models. @typedef {{data: ArrayBuffer} | CodedPictures} Order */
/** What it answers: the steps of each model in turn, up to the last one or an error. @typedef {DecodedStep | {error: string}} Answer */

/** Decode in this worker, in the order of the messages. */
export function runDecodeWorker() {
  /** @type {ModelDecoder | null} */
  let decoder = null;
  self.onmessage = (/** @type {MessageEvent<Order>} */ { data: order }) => {
    if ("data" in order) {
      decoder = new ModelDecoder(readDataFile(order.data));
      return;
    }
    try {
      for (const step of /** @type {ModelDecoder} */ (decoder).decode(order)) postMessage(step);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      postMessage({ error: error.message });
    }
  };
}
