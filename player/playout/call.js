import { packetsOf } from "../format/call_file.js";
import { FormatError } from "../format/errors.js";
import { Receiver } from "./receiver.js";

/** @typedef {import("./playout.js").PlayoutFrame} PlayoutFrame */
/**
 * A whole call: its frames in order; whether it has its end; what was wrong with packets.
 * @typedef {{frames: PlayoutFrame[], isComplete: boolean, damages: string[], bytes: number}} Call
 */

/**
 * The call in the bytes of a file.  Throws `FormatError` if it has no frame.
 * @param {Uint8Array} file
 * @returns {Call}
 */
export function readCall(file) {
  /** @type {string[]} */
  const damages = [];
  const note = (/** @type {FormatError} */ error) => damages.push(error.message);
  const receiver = new Receiver(note);
  /** @type {PlayoutFrame[]} */
  const frames = [];
  for (const packet of packetsOf(file, note)) {
    frames.push(...receiver.receive({ packet, number: null, session: 0 }, 0));
  }
  if (!frames.length) throw new FormatError(damages[0] ?? "the call has no picture");
  return { frames, isComplete: receiver.ended, damages, bytes: file.length };
}
