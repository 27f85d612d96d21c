import { readDataFile } from "../data_file.js";
import { ModelDecoder } from "../draw/model_decoder.js";
import { check, FormatError } from "../format/errors.js";

/** @typedef {import("../draw/model_decoder.js").CodedPictures} CodedPictures */
/** @typedef {import("../draw/model_decoder.js").DecodedStep} DecodedStep */
/** What a worker is told: first the data file, then models. @typedef {{data: ArrayBuffer} | CodedPictures} Order */
/** What it answers: the steps of each model in turn, up to the last one or an error. @typedef {DecodedStep | {error: string}} Answer */

/**
 * The picture in a WebP file.
 * @param {Uint8Array} data
 */
async function decodeWebp(data) {
  const options = /** @type {ImageBitmapOptions} */ ({ colorSpaceConversion: "none" });
  const blob = new Blob([data.slice()], { type: "image/webp" });
  const bitmap = await createImageBitmap(blob, options).catch(() => null);
  check(bitmap, "a WebP picture is damaged");
  const { width, height } = bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d");
  check(context, "this browser cannot decode WebP pictures");
  context.drawImage(bitmap, 0, 0);
  const pixels = context.getImageData(0, 0, width, height).data;
  return { height, width, values: Float32Array.from(pixels.filter((_, i) => i % 4 < 3)) };
}

/** Decode in this worker, one model after another in the order of the messages. */
export function runDecodeWorker() {
  /** @type {Promise<ModelDecoder>} which has answered what has been asked for */
  let decoder;
  self.onmessage = (/** @type {MessageEvent<Order>} */ { data: order }) => {
    if ("data" in order) decoder = ModelDecoder.load(readDataFile(order.data), decodeWebp);
    else decoder = decoder.then((own) => answer(own, order));
  };
}

/**
 * @param {ModelDecoder} decoder
 * @param {CodedPictures} order
 */
async function answer(decoder, order) {
  try {
    for await (const step of decoder.decode(order))
      postMessage(step, { transfer: buffersOf(step) });
  } catch (error) {
    if (!(error instanceof FormatError)) throw error;
    postMessage({ error: error.message });
  }
  return decoder;
}

/**
 * Of a step, what the decoder has no more use for: it is given away rather than copied.
 * @param {DecodedStep} step
 */
function buffersOf({ details, modes, background }) {
  const limits = details ? [details.limits.low, details.limits.high] : [];
  const lids = details ? [...details.lids.weights, details.lids.light, details.lids.least] : [];
  const bitmaps = background ? [background.moving.values, background.still?.values] : [];
  const changes = background?.changes ?? [];
  const arrays = [...limits, ...lids, ...modes, ...bitmaps, ...changes];
  return arrays.flatMap((values) => (values ? [/** @type {ArrayBuffer} */ (values.buffer)] : []));
}
