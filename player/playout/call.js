import { packetsOf } from "../format/call_file.js";
import { FormatError } from "../format/errors.js";
import { parsePacket } from "../format/packets.js";
import { SmoothReturn } from "./concealment.js";
import { Playout } from "./playout.js";

/** @typedef {import("./playout.js").PlayoutFrame} PlayoutFrame */
/**
 * A whole call: its frames in order; whether it has its end; what was wrong with packets.
 * @typedef {{frames: PlayoutFrame[], isComplete: boolean, damages: string[], bytes: number}} Call
 */

/**
 * The frames of a call file in order, and whether it has its end.
 * @param {Uint8Array} file
 * @param {(error: FormatError) => void} onDamage called with what is wrong with packets
 */
export function playCall(file, onDamage) {
  const playout = new Playout();
  const smoothReturn = new SmoothReturn();
  /** @type {PlayoutFrame[]} */
  const frames = [];
  for (const packet of packetsOf(file, onDamage)) {
    try {
      for (const frame of playout.receive(parsePacket(packet))) {
        const face = smoothReturn.show(frame.face, frame.received.model.call.focalPx);
        frames.push({ ...frame, face });
      }
      const repaired = playout.takeRepaired();
      if (repaired) smoothReturn.correct(repaired);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      onDamage(error);
    }
  }
  return { frames, isComplete: playout.ended };
}

/**
 * The call in the bytes of a file.  Throws `FormatError` if it has no frame.
 * @param {Uint8Array} file
 * @returns {Call}
 */
export function readCall(file) {
  /** @type {string[]} */
  const damages = [];
  const { frames, isComplete } = playCall(file, ({ message }) => damages.push(message));
  if (!frames.length) throw new FormatError(damages[0] ?? "the call has no picture");
  return { frames, isComplete, damages, bytes: file.length };
}
