// SFrame (RFC 9605), AES_128_CTR_HMAC_SHA256_32; see docs/format.md, SFrame.
import { ctr } from "@noble/ciphers/aes.js";
import { hkdf } from "@noble/hashes/hkdf.js";
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { check } from "../format/errors.js";

/** @typedef {{keyId: number, cipher: Uint8Array, authentication: Uint8Array, salt: Uint8Array}} Key */

const CIPHER_SUITE = 3;
const TAG_BYTES = 4;
const NONCE_BYTES = 12;
const SHORT = 8;
const SESSION_KEY_IDS = 7;
/** How far a packet may be behind the newest one, and ahead of it. */
const REPLAY_WINDOW = 1024;
const MAX_AHEAD = 2 ** 20;

/** @param {string} text */
function ascii(text) {
  return Uint8Array.from(text, (character) => character.charCodeAt(0));
}

/** @param {(Uint8Array | number[])[]} parts */
function joined(...parts) {
  return Uint8Array.from(parts.flatMap((part) => [...part]));
}

/**
 * An integer in so many bytes, the highest first.
 * @param {bigint | number} value
 * @param {number} length
 */
export function bytesOf(value, length) {
  const bytes = new Uint8Array(length);
  let rest = BigInt(value);
  for (let i = length - 1; i >= 0; i--, rest >>= 8n) bytes[i] = Number(rest & 0xffn);
  return bytes;
}

/** @param {Uint8Array} bytes */
export function integerOf(bytes) {
  return bytes.reduce((value, byte) => (value << 8n) | BigInt(byte), 0n);
}

/**
 * @param {Uint8Array} base
 * @param {Uint8Array} info
 * @param {number} length
 */
function expanded(base, info, length) {
  return hkdf(sha256, base, new Uint8Array(0), info, length);
}

/**
 * The base key of one direction of a call.
 * @param {Uint8Array} invitationKey
 * @param {"encoder" | "decoder"} sender
 * @param {string} call
 */
export function baseKey(invitationKey, sender, call) {
  return expanded(invitationKey, ascii(`risorius 1\0${sender}\0${call}`), 16);
}

/**
 * @param {Uint8Array} base
 * @param {number} keyId
 * @returns {Key}
 */
export function derivedKey(base, keyId) {
  const label = joined(bytesOf(keyId, 8), bytesOf(CIPHER_SUITE, 2));
  const key = expanded(base, joined(ascii("SFrame 1.0 Secret key "), label), 48);
  const salt = expanded(base, joined(ascii("SFrame 1.0 Secret salt "), label), NONCE_BYTES);
  return { keyId, cipher: key.slice(0, 16), authentication: key.slice(16), salt };
}

/**
 * The key of most packets of a sender that has this session.
 * @param {Uint8Array} base
 * @param {Uint8Array} session
 */
export function sessionKey(base, session) {
  const info = joined(ascii("risorius session\0"), session);
  const keyId = 1 + Number(integerOf(session) % BigInt(SESSION_KEY_IDS));
  return derivedKey(expanded(base, info, 16), keyId);
}

/**
 * @param {number} keyId
 * @param {bigint} counter
 */
function header(keyId, counter) {
  if (counter < SHORT) return Uint8Array.from([(keyId << 4) | Number(counter)]);
  const length = Math.ceil(counter.toString(16).length / 2);
  return joined([(keyId << 4) | SHORT | (length - 1)], bytesOf(counter, length));
}

/**
 * Key ID, counter and length of the header of a packet.
 * @param {Uint8Array} packet
 */
export function parseHeader(packet) {
  check(packet.length, "protected packet: empty");
  const keyId = packet[0] >> 4;
  const code = packet[0] & 15;
  check(keyId < SHORT, "protected packet: unknown key");
  const length = code < SHORT ? 1 : code - SHORT + 2;
  const counter = code < SHORT ? BigInt(code) : integerOf(packet.subarray(1, length));
  check(packet.length >= length, "protected packet: cut off");
  return { keyId, counter, length };
}

/**
 * @param {Key} key
 * @param {bigint} counter
 */
function nonceOf({ salt }, counter) {
  return bytesOf(integerOf(salt) ^ counter, NONCE_BYTES);
}

/**
 * @param {Key} key
 * @param {Uint8Array} nonce
 * @param {Uint8Array} authenticated
 * @param {Uint8Array} ciphertext
 */
function tagOf(key, nonce, authenticated, ciphertext) {
  const sizes = [authenticated.length, ciphertext.length, TAG_BYTES].map((size) =>
    bytesOf(size, 8),
  );
  const content = joined(...sizes, nonce, authenticated, ciphertext);
  return hmac(sha256, key.authentication, content).subarray(0, TAG_BYTES);
}

/**
 * Encrypts and decrypts alike.
 * @param {Key} key
 * @param {Uint8Array} nonce
 * @param {Uint8Array} data
 */
function inCounterMode(key, nonce, data) {
  if (!data.length) return new Uint8Array(0);
  return ctr(key.cipher, joined(nonce, new Uint8Array(16 - NONCE_BYTES))).encrypt(
    Uint8Array.from(data),
  );
}

/**
 * A packet under a key, with a counter that none had before; metadata is authenticated, not sent.
 * @param {Key} key
 * @param {bigint} counter
 * @param {Uint8Array} plaintext
 * @param {Uint8Array} metadata
 */
export function protect(key, counter, plaintext, metadata) {
  const head = header(key.keyId, counter);
  const nonce = nonceOf(key, counter);
  const ciphertext = inCounterMode(key, nonce, plaintext);
  return joined(head, ciphertext, tagOf(key, nonce, joined(head, metadata), ciphertext));
}

/**
 * The plaintext of a packet; null if it is of another key, or not as it was sent.
 * @param {Key} key
 * @param {Uint8Array} packet
 * @param {Uint8Array} metadata
 */
export function unprotect(key, packet, metadata) {
  const { keyId, counter, length } = parseHeader(packet);
  const end = packet.length - TAG_BYTES;
  if (keyId !== key.keyId || end < length) return null;
  const ciphertext = packet.subarray(length, end);
  const nonce = nonceOf(key, counter);
  const expected = tagOf(key, nonce, joined(packet.subarray(0, length), metadata), ciphertext);
  let difference = 0;
  for (let i = 0; i < TAG_BYTES; i++) difference |= expected[i] ^ packet[end + i];
  return difference ? null : inCounterMode(key, nonce, ciphertext);
}

/** Which counters of a key have come. */
export class ReplayWindow {
  /** @param {number} newest it and all before count as come */
  constructor(newest) {
    this.begin = newest;
    this.newest = newest;
    /** @type {Set<number>} */
    this.seen = new Set();
  }

  /**
   * Note a counter; false: it came before, or is too old or too far ahead to tell.
   * @param {bigint} value
   */
  take(value) {
    const counter = Number(value);
    const isWithin = counter > this.newest - REPLAY_WINDOW && counter <= this.newest + MAX_AHEAD;
    if (!isWithin || counter <= this.begin || this.seen.has(counter)) return false;
    this.seen.add(counter);
    if (counter > this.newest) {
      this.newest = counter;
      for (const old of this.seen) if (old <= counter - REPLAY_WINDOW) this.seen.delete(old);
    }
    return true;
  }
}
