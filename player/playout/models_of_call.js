/** @typedef {import("../draw/model_decoder.js").CodedPictures} CodedPictures */
/** @typedef {import("../draw/model_decoder.js").DecodedStep} DecodedStep */
/** @typedef {import("../draw/scene.js").ModelPictures} ModelPictures */
/** @typedef {import("./playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {import("./received_models.js").ReceivedModel} ReceivedModel */

/**
 * The models of a call in the order of their use, each with what layers had brought by then.
 * @param {PlayoutFrame[]} frames
 */
export function modelsOf(frames) {
  return [...new Set(frames.map((frame) => frame.received))];
}

/**
 * What is coded of the pictures of a model.
 * @param {Pick<ReceivedModel, "model" | "modes">} received
 * @returns {CodedPictures}
 */
export function codedPictures({ model, modes }) {
  const { isThesis, width, height } = model.call;
  return { isThesis, width, height, texture: model.texture, modes, background: model.background };
}

/**
 * The pictures of a model after a step of its decoding.
 * @param {DecodedStep} step
 * @param {ModelPictures | undefined} before those after the step before, or of the model before
 * @returns {ModelPictures}
 */
export function afterStep({ mean, details, modes, background }, before) {
  const known = mean || !before ? [] : before.modes;
  const newest = mean ?? before?.mean;
  const ownMean = newest && details ? { ...newest, ...details } : newest;
  const ownBackground = background ?? before?.background;
  if (!ownMean || !ownBackground) throw new Error("a model builds on one that is not decoded");
  return { mean: ownMean, modes: [...known, ...modes], background: ownBackground };
}
