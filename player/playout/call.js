import { packetsOf } from "../format/call_file.js";
import { FormatError } from "../format/errors.js";
import { parsePacket } from "../format/packets.js";
import { Playout } from "./playout.js";

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
  const playout = new Playout();
  /** @type {string[]} */
  const damages = [];
  /** @type {PlayoutFrame[]} */
  const frames = [];
  const note = (/** @type {FormatError} */ error) => damages.push(error.message);
  for (const packet of packetsOf(file, note)) {
    try {
      frames.push(...playout.receive(parsePacket(packet)));
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      note(error);
    }
  }
  if (!frames.length) throw new FormatError(damages[0] ?? "the call has no picture");
  return { frames, isComplete: playout.ended, damages, bytes: file.length };
}
