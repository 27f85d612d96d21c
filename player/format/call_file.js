import { RecordReader } from "./call_records.js";
import { check, FormatError } from "./errors.js";
import { isEnd } from "./packets.js";

const MAGIC = "RZO2";

/**
 * The packets of a call file up to the one that ends the call.  What is damaged is left out.
 * @param {Uint8Array} file
 * @param {(error: FormatError) => void} onDamage
 * @returns {Generator<Uint8Array>}
 */
export function* packetsOf(file, onDamage) {
  const magic = String.fromCharCode(...file.subarray(0, MAGIC.length));
  check(magic === MAGIC, "this is no call file: it does not begin with RZO2");
  const reader = new RecordReader(file.subarray(MAGIC.length));
  while (reader.left) {
    try {
      const packet = reader.read();
      yield packet;
      if (isEnd(packet)) return;
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      onDamage(error);
    }
  }
}
