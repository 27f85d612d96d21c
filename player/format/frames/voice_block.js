import { ByteReader, signedFrom } from "../bytes.js";
import { check } from "../errors.js";
import { VOICES } from "../model_packet.js";
import { PITCH_AND_ENERGY, SPECTRUM, VOICING } from "./codec2_codes.js";

/**
 * The speech of a frame packet.
 * @typedef {object} VoiceBlock
 * @property {number} frames of speech, silent ones among them
 * @property {number} displacement of the first one from the expected one
 * @property {boolean} hasFace
 * @property {{place: number, data: Uint8Array}[]} opus the spoken frames of that codec, and which they are of all
 */

/** Reads bits, the highest of a byte first. */
class BitReader {
  /** @param {ByteReader} bytes */
  constructor(bytes) {
    this.bytes = bytes;
    this.byte = 0;
    this.left = 0;
  }

  /** @param {number} count */
  take(count) {
    let value = 0;
    for (let i = 0; i < count; i++) {
      if (!this.left) {
        this.byte = this.bytes.byte();
        this.left = 8;
      }
      this.left--;
      value = 2 * value + ((this.byte >> this.left) & 1);
    }
    return value;
  }

  /** Skip the bits that fill the last byte, which are zeros. */
  finish() {
    check(!(this.byte & (2 ** this.left - 1)), "voice: bits that are not 0 after the last one");
    this.left = 0;
  }
}

/**
 * The voice block at the start of a payload, and the face.
 * @param {Uint8Array} payload
 * @param {number} voice codec
 * @returns {{block: VoiceBlock, face: Uint8Array}}
 */
export function splitVoice(payload, voice) {
  const reader = new ByteReader(payload, "voice");
  const head = reader.varint();
  const frames = Math.floor(head / 8);
  check(frames <= 255, `voice: ${frames} speech frames, limit 255`);
  const displacement = head & 2 ? signedFrom(reader.varint()) : 0;
  let spoken = Array.from({ length: frames }, (_, i) => i);
  if (head & 1) {
    const mask = new BitReader(reader);
    spoken = spoken.filter(() => mask.take(1));
    mask.finish();
  }
  const opus = voice === VOICES.OPUS ? takeOpus(reader, spoken) : [];
  if (voice !== VOICES.OPUS) skipCodec2(reader, voice, spoken.length);
  const hasFace = !(head & 4);
  const face = reader.rest();
  check(hasFace || !face.length, "voice: bytes after a block without a face");
  return { block: { frames, displacement, hasFace, opus }, face };
}

/**
 * @param {ByteReader} reader
 * @param {number[]} spoken
 */
function takeOpus(reader, spoken) {
  return spoken.map((place) => {
    const data = reader.take(reader.byte());
    check(data.length, "voice: empty frame");
    return { place, data };
  });
}

/**
 * @param {ByteReader} reader
 * @param {number} voice
 * @param {number} count
 */
function skipCodec2(reader, voice, count) {
  const bits = new BitReader(reader);
  for (let i = 0; i < count; i++) {
    if (voice === VOICES.CODEC2_700C) bits.take(28);
    else
      for (const code of [VOICING, PITCH_AND_ENERGY, PITCH_AND_ENERGY, SPECTRUM]) skip(bits, code);
    if (voice === VOICES.CODEC2_1200) bits.take(18);
  }
  bits.finish();
}

/**
 * Skip a symbol of a canonical prefix code.
 * @param {BitReader} bits
 * @param {number[]} counts how many symbols have each length
 */
function skip(bits, counts) {
  let code = 0;
  let first = 0;
  for (let length = 1; length < counts.length; length++) {
    code = 2 * code + bits.take(1);
    first *= 2;
    if (code - first < counts[length]) return;
    first += counts[length];
  }
  check(false, "voice: unknown code");
}
