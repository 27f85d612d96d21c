import { crc16 } from "../format/checksums.js";
import { sessionInHello } from "./messages.js";
import {
  baseKey,
  bytesOf,
  derivedKey,
  integerOf,
  parseHeader,
  protect,
  ReplayWindow,
  sessionKey,
  unprotect,
} from "./sframe.js";

/** @typedef {import("./sframe.js").Key} Key */
/**
 * What guards the payloads of a decoder.
 * @typedef {object} Protection
 * @property {Uint8Array} session of this decoder
 * @property {(data: Uint8Array) => Uint8Array} protect a payload for a message
 * @property {(data: Uint8Array) => Uint8Array | null} unprotect a message; null: of nobody we know
 * @property {(session: Uint8Array) => void} onPeer take an encoder that has echoed our session
 */

const HELLO_KEY_ID = 0;
const POSITION_BYTES = 4;
const COUNTER_LIMIT = 2n ** 64n;
const NOTHING = new Uint8Array(0);

/** SFrame with the key of an invitation. @implements {Protection} */
export class SFrameProtection {
  /**
   * @param {Uint8Array} key of the invitation
   * @param {string} call
   * @param {Uint8Array} session random
   */
  constructor(key, call, session) {
    this.session = session;
    this.receivedBase = baseKey(key, "encoder", call);
    const sentBase = baseKey(key, "decoder", call);
    this.sentKey = sessionKey(sentBase, session);
    this.sentHelloKey = derivedKey(sentBase, HELLO_KEY_ID);
    this.receivedHelloKey = derivedKey(this.receivedBase, HELLO_KEY_ID);
    this.counter = 0;
    /** @type {Map<string, number>} counters of the HELLO of sessions that have not echoed ours */
    this.heard = new Map();
    /** @type {{session: Uint8Array, key: Key, window: ReplayWindow} | null} */
    this.peer = null;
  }

  /** @param {Uint8Array} data */
  protect(data) {
    const counter = this.counter++;
    if (!sessionInHello(data)) {
      return protect(this.sentKey, BigInt(counter), data, this.peer?.session ?? NOTHING);
    }
    const message = Uint8Array.from([...bytesOf(counter, POSITION_BYTES), ...data]);
    const sent = (integerOf(this.session) + BigInt(counter)) % COUNTER_LIMIT;
    return protect(this.sentHelloKey, sent, message, NOTHING);
  }

  /** @param {Uint8Array} data */
  unprotect(data) {
    const { keyId, counter } = parseHeader(data);
    if (keyId === HELLO_KEY_ID) return this.#hello(data);
    if (!this.peer || this.peer.key.keyId !== keyId) return null;
    // What a decoder receives has no metadata.
    const plaintext = unprotect(this.peer.key, data, NOTHING);
    return plaintext && this.peer.window.take(counter) ? plaintext : null;
  }

  /** @param {Uint8Array} session */
  onPeer(session) {
    const position = this.heard.get(session.join());
    if (position === undefined) return;
    const window = new ReplayWindow(position);
    this.peer = { session, key: sessionKey(this.receivedBase, session), window };
    this.heard.clear();
  }

  /** @param {Uint8Array} data */
  #hello(data) {
    const plaintext = unprotect(this.receivedHelloKey, data, NOTHING);
    const message = plaintext?.subarray(POSITION_BYTES);
    const session = message && sessionInHello(message);
    if (!plaintext || !message || !session) return null;
    const position = integerOf(plaintext.subarray(0, POSITION_BYTES));
    if (this.peer?.session.join() === session.join()) {
      return this.peer.window.take(position) ? message : null;
    }
    this.heard.set(session.join(), Number(position));
    return message;
  }
}

/** A checksum of two bytes, without keys. @implements {Protection} */
export class PlainProtection {
  /** @param {Uint8Array} session random */
  constructor(session) {
    this.session = session;
    /** @type {Uint8Array} session of the encoder */
    this.encoder = NOTHING;
  }

  /** @param {Uint8Array} data */
  protect(data) {
    return Uint8Array.from([...data, ...bytesOf(this.#checksum(data), 2)]);
  }

  /** @param {Uint8Array} data */
  unprotect(data) {
    const body = data.slice(0, -2);
    const isRight =
      data.length > 2 && integerOf(data.subarray(-2)) === BigInt(this.#checksum(body));
    return isRight ? body : null;
  }

  /** @param {Uint8Array} session */
  onPeer(session) {
    this.encoder = session;
  }

  /**
   * The checksum of the encoder's session and the data; of a HELLO that of the data alone.
   * @param {Uint8Array} data
   */
  #checksum(data) {
    return crc16([sessionInHello(data) ? NOTHING : this.encoder, data]);
  }
}
