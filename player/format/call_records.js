import { crc8, crc32 } from "./checksums.js";
import { check, FormatError } from "./errors.js";
import { isEnd, KINDS, kindOf, MAX_PACKET_BYTES, SEQUENCE_MODULUS } from "./packets.js";

/**
 * Where a record lies, by its length: its first byte, that after the head, and the ends of the body
 * and of the checksum.
 * @typedef {{start: number, body: number, bodyEnd: number, end: number, isWhole: boolean}} Place
 */

const MAX_HEAD_BYTES = 3;
/** Successive records that must be valid where a reader goes on after damage. */
const TRUSTED_RUN = 3;
/** Frame packets that may be missing before them, and bytes that are searched for them. */
const MAX_MISSING = 4;
const MAX_SEARCH_BYTES = 64 * 1024;
/** Bytes that searches may look at: at first, for each byte of the file that is read, for each look. */
const SEARCH_WORK = 4 * 1024 * 1024;
const WORK_PER_BYTE = 16;
const WORK_PER_LOOK = 16;

/** Reads the records of a call, see docs/format.md, Call file. */
export class RecordReader {
  /** @param {Uint8Array} data what follows the magic */
  constructor(data) {
    this.data = data;
    this.position = 0;
    /** end of what has been looked at */
    this.seen = 0;
    /** that a frame packet without byte 0 has */
    this.sequence = 0;
    this.work = SEARCH_WORK;
  }

  /** Number of bytes that have not been read. */
  get left() {
    return this.data.length - this.position;
  }

  /**
   * The packet of the next record.  Throws `FormatError` if it is damaged; the next call then goes on
   * after the damage.
   */
  read() {
    /** @type {number | null} end of the record, if its length is possible */
    let end = null;
    try {
      const place = this.#locate(this.position);
      end = place.end;
      const packet = this.#packet(place, this.sequence);
      check(this.#isIntact(place, packet), "the checksum of a record is wrong");
      this.sequence = sequenceAfter(packet, this.sequence);
      this.#advance(end);
      return packet;
    } catch (error) {
      if (error instanceof FormatError) this.#skip(end);
      throw error;
    }
  }

  /**
   * The record at an offset by its lengths.  Throws `FormatError` if they are not possible, or beyond
   * the file.
   * @param {number} start
   * @returns {Place}
   */
  #locate(start) {
    const { value, body } = this.#head(start);
    const isWhole = value % 2 === 1;
    const bodyEnd = body + Math.floor(value / 2);
    const length = bodyEnd - body + (isWhole ? 0 : 1);
    const checkLength = (/** @type {number} */ kind) =>
      check(length && length <= MAX_PACKET_BYTES[kind], `a record of ${length} bytes`);
    checkLength(isWhole ? KINDS.MODEL : KINDS.FRAME);
    this.#checkReach(bodyEnd);
    const kind = isWhole ? kindOf(this.data.subarray(body)) : KINDS.FRAME;
    checkLength(kind);
    const end = bodyEnd + checksumBytes(kind);
    this.#checkReach(end);
    return { start, body, bodyEnd, end, isWhole };
  }

  /** @param {number} start */
  #head(start) {
    let value = 0;
    for (let i = 0; i < MAX_HEAD_BYTES; i++) {
      this.#checkReach(start + i + 1);
      const byte = this.data[start + i];
      value += (byte & 0x7f) * 128 ** i;
      if (byte >= 0x80) continue;
      if (byte || !i) return { value, body: start + i + 1 };
      break;
    }
    throw new FormatError("the length of a record is impossible");
  }

  /** @param {number} end */
  #see(end) {
    this.seen = Math.max(this.seen, Math.min(end, this.data.length));
  }

  /** @param {number} end */
  #checkReach(end) {
    this.#see(end);
    check(end <= this.data.length, "the file ends in a record");
  }

  /**
   * @param {Place} place
   * @param {number} sequence that a frame packet without byte 0 has
   */
  #packet({ body, bodyEnd, isWhole }, sequence) {
    const sent = this.data.subarray(body, bodyEnd);
    return isWhole ? sent : Uint8Array.from([sequence, ...sent]);
  }

  /**
   * Whether the checksum of a record is right.
   * @param {Place} place
   * @param {Uint8Array} packet
   */
  #isIntact({ start, body, bodyEnd }, packet) {
    const parts = [this.data.subarray(start, body), packet];
    if (checksumBytes(kindOf(packet)) === 1) return this.data[bodyEnd] === crc8(parts);
    const sum = this.data.slice(bodyEnd, bodyEnd + 4);
    return new DataView(sum.buffer).getUint32(0) === crc32(parts);
  }

  /**
   * Go on where records are valid that follow one another; if there are none, at the end of the
   * damaged one by its length, or else at the end of the file.
   * @param {number | null} end of the damaged record by its length
   */
  #skip(end) {
    this.#see(this.position + MAX_SEARCH_BYTES);
    for (const start of this.#candidates(end)) {
      const sequence = this.#sequenceOf(this.#run(start));
      if (sequence !== null) {
        this.sequence = sequence;
        this.#advance(start);
        return;
      }
      if (this.work <= 0) break;
    }
    this.#advance(end ?? this.data.length);
  }

  /** @param {number | null} end */
  *#candidates(end) {
    if (end !== null) yield end;
    const limit = this.seen;
    for (let start = this.position + 1; start < limit; start++) yield start;
  }

  /** @param {number} position */
  #advance(position) {
    this.work = Math.min(this.work + WORK_PER_BYTE * (position - this.position), SEARCH_WORK);
    this.position = position;
  }

  /**
   * The records from an offset on, `TRUSTED_RUN` or the last ones of the call; none by lengths.
   * @param {number} start
   */
  #run(start) {
    /** @type {Place[]} */
    const places = [];
    for (let at = start; places.length < TRUSTED_RUN; ) {
      this.work -= WORK_PER_LOOK;
      const place = this.#located(at);
      if (!place) return [];
      places.push(place);
      if (place.isWhole && isEnd(this.data.subarray(place.body, place.bodyEnd))) break;
      at = place.end;
    }
    return places;
  }

  /** @param {number} start */
  #located(start) {
    try {
      return this.#locate(start);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      return null;
    }
  }

  /**
   * The sequence number with which the checksums of records are right; null: there is none.
   * @param {Place[]} places
   */
  #sequenceOf(places) {
    for (let missing = 0; places.length && missing <= MAX_MISSING; missing++) {
      const sequence = (this.sequence + missing) % SEQUENCE_MODULUS;
      if (this.#isTrusted(places, sequence)) return sequence;
    }
    return null;
  }

  /**
   * Whether the checksums of records that follow one another are right.
   * @param {Place[]} places
   * @param {number} sequence that a first frame packet without byte 0 has
   */
  #isTrusted(places, sequence) {
    let next = sequence;
    return places.every((place) => {
      this.work -= place.bodyEnd - place.start + WORK_PER_LOOK;
      const packet = this.#packet(place, next);
      next = sequenceAfter(packet, next);
      return this.#isIntact(place, packet);
    });
  }
}

/**
 * The sequence number expected after a packet.
 * @param {Uint8Array} packet
 * @param {number} before
 */
function sequenceAfter(packet, before) {
  return kindOf(packet) === KINDS.FRAME ? (packet[0] + 1) % SEQUENCE_MODULUS : before;
}

/** @param {number} kind */
function checksumBytes(kind) {
  return kind === KINDS.MODEL || kind === KINDS.LAYER ? 4 : 1;
}
