import {
  conjugate,
  interpolate,
  multiply,
  normalise,
  quaternionFromVector,
  vectorFromQuaternion,
  withFocalChange,
} from "../model/geometry.js";
import { clipEau } from "../model/parameters.js";
import { referenceFace } from "../model/person.js";

/** @typedef {import("../format/model_packet.js").ModelPacket} ModelPacket */
/** @typedef {import("../model/parameters.js").Face} Face */
/** @typedef {import("./frame_decoder.js").TimedFace} TimedFace */
/**
 * What leads from one face to another.
 * @typedef {object} FaceChange
 * @property {number[]} turn axis-angle vector, radians, camera frame
 * @property {number[]} shift mm, camera frame
 * @property {Float64Array} eau
 * @property {Float64Array} modes
 * @property {Float64Array} layers
 */

/** How long a lost face stays, and then takes to go to rest, seconds. */
const HELD_S = 0.4;
const TO_REST_S = 0.8;
/** Frames in which a wrong face returns to the true one, at least and at most. */
const RETURN_FRAMES = 4;
const MAX_RETURN_FRAMES = 25;
/** A person who has left fades from the picture in this time. */
const FADE_S = 0.3;

/**
 * The face of a head that was lost so many seconds ago: it stays, then goes to rest.
 * @param {Face} face
 * @param {ModelPacket} model
 * @param {number} lostS
 */
export function atRest(face, model, lostS) {
  const passed = Math.min(Math.max((lostS - HELD_S) / TO_REST_S, 0), 1);
  if (!passed) return face;
  const rest = {
    ...referenceFace(model),
    layers: new Float64Array(face.layers.length),
    modes: new Float64Array(face.modes.length),
  };
  return interpolate(face, rest, passed * passed * (3 - 2 * passed));
}

/**
 * The face of a source frame between two coded ones whose packets between them are lost, and whether
 * it is the one before: the way takes at most `MAX_RETURN_FRAMES`.
 * @param {TimedFace} before
 * @param {TimedFace} after
 * @param {number} index
 */
export function bridge(before, after, index) {
  const start = Math.max(before.time, after.time - MAX_RETURN_FRAMES);
  if (index <= start) return { face: before.face, isHeld: true };
  const share = (index - start) / (after.time - start);
  return { face: interpolate(before.face, after.face, share), isHeld: false };
}

/**
 * How much of a person is shown who left some frames ago, 1 to 0.
 * @param {number} frames
 * @param {number} fps
 */
export function presence(frames, fps) {
  return Math.max(0, 1 - frames / Math.max(1, FADE_S * fps));
}

/**
 * What leads from one face to another; none of modes or layers if their numbers differ.
 * @param {Face} first
 * @param {Face} second
 * @returns {FaceChange}
 */
function changeBetween(first, second) {
  const rotation = multiply(second.pose.rotation, conjugate(first.pose.rotation));
  return {
    turn: vectorFromQuaternion(rotation),
    shift: second.pose.translation.map((value, i) => value - first.pose.translation[i]),
    eau: difference(first.eau, second.eau),
    modes: difference(first.modes, second.modes),
    layers: difference(first.layers, second.layers),
  };
}

/**
 * @param {Float64Array} first
 * @param {Float64Array} second
 */
function difference(first, second) {
  const isSame = first.length === second.length;
  return second.map((value, i) => (isSame ? value - first[i] : 0));
}

/**
 * How far head, position and actuators move: radians, mm, units.
 * @param {FaceChange} change
 */
function sizesOf({ turn, shift, eau }) {
  return [Math.hypot(...turn), Math.hypot(...shift), Math.max(...eau.map(Math.abs))];
}

/**
 * A face with a share of a change; without that of modes or layers if their numbers differ.
 * @param {Face} face
 * @param {FaceChange} change
 * @param {number} share
 * @returns {Face}
 */
function changed(face, change, share) {
  const turn = quaternionFromVector(change.turn.map((angle) => share * angle));
  const rotation = normalise(multiply(turn, face.pose.rotation));
  const translation = face.pose.translation.map((value, i) => value + share * change.shift[i]);
  const added = (/** @type {Float64Array} */ values, /** @type {Float64Array} */ by) =>
    values.length === by.length ? values.map((value, i) => value + share * by[i]) : values;
  return {
    pose: { rotation, translation },
    eau: clipEau(added(face.eau, change.eau)),
    layers: added(face.layers, change.layers),
    modes: added(face.modes, change.modes),
  };
}

/** Leads from concealed faces back to the true ones, no faster than the face has moved before. */
export class SmoothReturn {
  constructor() {
    /** @type {Face | null} the face of the frame before */
    this.shown = null;
    /** focal length of the camera that saw it */
    this.focalPx = 0;
    /** as `sizesOf`, of one frame */
    this.fastest = [0, 0, 0];
    /** @type {FaceChange | null} */
    this.error = null;
    this.frames = 0;
    this.framesLeft = 0;
    this.isInterrupted = false;
  }

  /** The next face is reached from the one shown last, however far away it is. */
  interrupt() {
    this.isInterrupted = this.shown !== null;
  }

  /**
   * Return to the true faces.
   * @param {Face} trueFace that of the frame before
   */
  correct(trueFace) {
    if (!this.shown) return;
    this.error = changeBetween(trueFace, this.shown);
    const ratios = sizesOf(this.error).map((size, i) => size / Math.max(this.fastest[i], 1e-9));
    const needed = Math.ceil(Math.max(...ratios));
    this.frames = Math.min(Math.max(needed, RETURN_FRAMES), MAX_RETURN_FRAMES);
    this.framesLeft = this.frames;
  }

  /**
   * The face to show next where this is the true one.
   * @param {Face} face
   * @param {number} focalPx of the camera
   * @returns {Face}
   */
  show(face, focalPx) {
    if (this.shown && focalPx !== this.focalPx) {
      this.shown = withFocalChange(this.shown, focalPx / this.focalPx);
    }
    this.focalPx = focalPx;
    if (this.isInterrupted) {
      this.isInterrupted = false;
      this.correct(face);
    }
    let shown = face;
    if (this.error) {
      this.framesLeft--;
      shown = changed(face, this.error, this.framesLeft / this.frames);
      if (!this.framesLeft) this.error = null;
    } else if (this.shown) {
      const sizes = sizesOf(changeBetween(this.shown, face));
      this.fastest = this.fastest.map((size, i) => Math.max(size, sizes[i]));
    }
    this.shown = shown;
    return shown;
  }
}
