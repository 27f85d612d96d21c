import { ByteReader } from "./bytes.js";
import { crc8, crc32 } from "./checksums.js";
import { check, FormatError } from "./errors.js";
import { KINDS, kindOf, MAX_PACKET_BYTES, SEQUENCE_MODULUS } from "./packets.js";

const MAGIC = "RZO2";

/**
 * The packets of a call file.  A damaged record is left out, with all after it that cannot be
 * found again by its length.
 * @param {Uint8Array} file
 * @param {(error: FormatError) => void} onDamage
 * @returns {Generator<Uint8Array>}
 */
export function* packetsOf(file, onDamage) {
  const magic = String.fromCharCode(...file.subarray(0, MAGIC.length));
  check(magic === MAGIC, "this is no call file: it does not begin with RZO2");
  const reader = new ByteReader(file.subarray(MAGIC.length), "call file");
  let sequence = 0;
  while (reader.left) {
    try {
      const packet = readRecord(reader, sequence);
      if (!packet) {
        onDamage(new FormatError("the checksum of a record is wrong"));
        continue;
      }
      if (kindOf(packet) === KINDS.FRAME) sequence = (packet[0] + 1) % SEQUENCE_MODULUS;
      yield packet;
      if (kindOf(packet) === KINDS.CONTROL && packet[1] === 0) return;
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      onDamage(error);
      return;
    }
  }
}

/**
 * The packet of the next record; null if its checksum is wrong.
 * @param {ByteReader} reader
 * @param {number} sequence that a frame packet without byte 0 has
 */
function readRecord(reader, sequence) {
  const start = reader.position;
  const value = reader.varint();
  const head = reader.data.subarray(start, reader.position);
  const body = reader.take(Math.floor(value / 2));
  const packet = value % 2 ? body : Uint8Array.from([sequence, ...body]);
  check(packet.length && (packet.length > 1 || value % 2), "a record is empty");
  const kind = kindOf(packet);
  check(packet.length <= MAX_PACKET_BYTES[kind], `a packet of ${packet.length} bytes is too long`);
  if (kind === KINDS.MODEL || kind === KINDS.LAYER) {
    const sum = reader.take(4);
    return new DataView(sum.slice().buffer).getUint32(0) === crc32([head, packet]) ? packet : null;
  }
  return reader.byte() === crc8([head, packet]) ? packet : null;
}
